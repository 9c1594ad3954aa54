# Each target does its own set-up: a virtual environment in .venv with the project installed.
PYTHON ?= python3
# the vectors are short: more threads only get in each other's way
export OMP_NUM_THREADS ?= 1
BIN := .venv/bin

.PHONY: demo test check lint types bench clean

demo: .venv/installed
	$(BIN)/thermofem reproduce --quick -o out

test: .venv/installed-dev
	$(BIN)/python -m pytest

check: lint types test

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/installed-dev
	$(BIN)/mypy

bench: .venv/installed-dev
	for script in benchmarks/bench_*.py; do $(BIN)/python $$script || exit 1; done

clean:
	rm -rf .venv out .pytest_cache .mypy_cache .ruff_cache

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/installed: .venv/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

.venv/installed-dev: .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@
