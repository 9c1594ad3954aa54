# Each target does its own set-up: a virtual environment in .venv with the project installed.
PYTHON ?= python3
# the vectors are short: more threads only get in each other's way
export OMP_NUM_THREADS ?= 1
BIN := .venv/bin
# Python compiles the files that it imports; compiling all 12000 takes longer
INSTALL := -m pip install --quiet --disable-pip-version-check --no-compile
# some machines set it; every process would then compile the sources again
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-slow check lint types validation docs wheel wheels sanitize gdsfactory bench fuzz audit clean

demo: .venv/installed
	$(BIN)/python -m paper -o out

# ALL=1 runs the slow tests, too, as continuous integration does: two processes then wait less for each other than in two runs
test: .venv/installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile $(if $(ALL),,-m "not slow")

# the slow and violent tests, which `make test` leaves out
test-slow: .venv/installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile -m slow

check: lint types test

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: .venv/installed-dev
	$(BIN)/mypy

# the tests' own numbers into the validation page
validation: .venv/installed-dev
	$(BIN)/python -m pytest -n auto --dist loadfile --validation
	$(BIN)/python docs/generate.py

# the pages made from code and tests, then the site, with warnings as errors; a test of `make test` builds it, too
docs: .venv/installed-dev
	$(BIN)/python docs/generate.py
	$(BIN)/python -m mkdocs build --strict -d out/site

# sdist, a wheel from it, and a first solution in an environment that has nothing else
wheel:
	rm -rf out/dist out/build out/fresh
	$(PYTHON) -m venv out/build
	out/build/bin/python $(INSTALL) build
	out/build/bin/python -m build --outdir out/dist .
	$(PYTHON) -m venv out/fresh
	out/fresh/bin/python $(INSTALL) out/dist/thermofem-*.whl
	cd out/fresh && env -u PYTHONPATH bin/thermofem solve --pulse "20 us" --figure heat.png

# a wheel for each platform, cross-compiled here, and what is in them
TARGETS := x86_64-linux-gnu.2.17 aarch64-linux-gnu.2.17 x86_64-linux-musl aarch64-linux-musl \
	x86_64-macos.11.0 aarch64-macos.11.0 x86_64-windows-gnu
wheels:
	rm -rf out/wheels out/build
	$(PYTHON) -m venv out/build
	out/build/bin/python $(INSTALL) build
	for target in $(TARGETS); do KERNEL_TARGET=$$target out/build/bin/python -m build --wheel --outdir out/wheels . || exit 1; done
	for wheel in out/wheels/*.whl; do $(PYTHON) -m zipfile -l $$wheel | grep coupled/kernel/ring || exit 1; done

# the kernel under the address and undefined-behaviour sanitizers
sanitize: .venv/installed-dev
	$(BIN)/python tests/audit/sanitized.py

# the import from gdsfactory, in an environment of its own: gdsfactory pins an older typer
gdsfactory: .venv-gdsfactory/installed
	.venv-gdsfactory/bin/python -m pytest -q tests/thermofem/test_gdsfactory.py

.venv-gdsfactory/installed: pyproject.toml
	$(PYTHON) -m venv .venv-gdsfactory
	.venv-gdsfactory/bin/python $(INSTALL) --editable ".[gdsfactory]" pytest pytest-xdist hypothesis
	touch $@

# random edits of valid files; MINUTES=5 for less
MINUTES ?= 60
fuzz: .venv/installed-dev
	$(BIN)/python tests/fuzz/readers.py $(MINUTES)

# bounds, verdicts and errors of random reductions, rings, families and geometries; parameters of rings found again
audit: .venv/installed-dev
	$(BIN)/python tests/audit/accuracy.py 200
	$(BIN)/python tests/audit/reductions.py 1500
	$(BIN)/python tests/audit/verdicts.py 4000
	$(BIN)/python tests/audit/families.py
	$(BIN)/python tests/audit/pulls.py
	$(BIN)/python tests/audit/layouts.py 200

# against named peers, in an environment of its own; goes on where it was; BENCH=--quick, BENCH=--again
bench: .venv-bench/installed
	.venv-bench/bin/python benchmarks/table.py $(BENCH)

.venv-bench/installed: pyproject.toml
	$(PYTHON) -m venv .venv-bench
	.venv-bench/bin/python $(INSTALL) --editable . ngsolve femwell pymor
	touch $@

clean:
	rm -rf .venv .venv-bench .venv-gdsfactory out .pytest_cache .mypy_cache .ruff_cache

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/installed: .venv/bin/python pyproject.toml
	$(BIN)/python $(INSTALL) --editable .
	touch $@

.venv/installed-dev: .venv/bin/python pyproject.toml
	$(BIN)/python $(INSTALL) --editable ".[dev]"
	touch .venv/installed $@
