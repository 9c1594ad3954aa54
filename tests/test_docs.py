"""The documentation: code that runs, commands that exist, links that lead somewhere, pages that are up to date."""

from __future__ import annotations

import ast
import contextlib
import importlib
import inspect
import io
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from paths import ROOT, module_of

import coupled
import surrogate
import thermofem as th
from thermofem.data.variables import VARIABLES
from thermofem.models.model_files import KINDS

pytestmark = pytest.mark.slow

DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
BLOCK = re.compile(r'(<!-- not run: [^>]*-->\n)?^```(\w+)(?: title="([^"]+)")?\n(.*?)^```', re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"[+-]?\d+\.?\d*(?:e[+-]?\d+)?")
RUN = [
    page for page in TEXTS if any(language in ("python", "sh") for _, language, _, _ in BLOCK.findall(page.read_text()))
]


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """Language, file name and content of every code block that is to run."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [(language, title, content) for skip, language, title, content in found if not skip]


def commands(page: Path) -> list[list[str]]:
    """Arguments of every thermofem command on a page, in blocks and in the text."""
    text = page.read_text(encoding="utf-8")
    shell = "\n".join(content for _, language, _, content in BLOCK.findall(text) if language == "sh")
    lines = [line for line in shell.splitlines() if line.startswith("thermofem ")]
    lines += [" ".join(m.split()) for m in re.findall(r"(?<!`)`(thermofem (?!thermal model)[^`]+)`(?!`)", text)]
    return [shlex.split(line, comments=True)[1:] for line in lines]


def same_text(found: str, expected: str) -> None:
    """Equal but for numbers, which may differ by 0.3 % or one in the last digit: meshes and round-off change."""
    assert NUMBER.sub("#", found.strip()) == NUMBER.sub("#", expected.strip())
    for ours, printed in zip(NUMBER.findall(found), NUMBER.findall(expected), strict=True):
        digits = len(printed.partition("e")[0].partition(".")[2])
        last = 10.0**-digits * float("1" + (printed[printed.find("e") :] if "e" in printed else ""))
        assert float(ours) == pytest.approx(float(printed), rel=3e-3, abs=1.01 * last)


@pytest.mark.parametrize("page", RUN, ids=lambda page: page.stem)
def test_every_block_runs_and_prints_what_stands_there(page, tmp_path, monkeypatch, needs_mesher):
    from typer.testing import CliRunner

    from thermofem_cli import app

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    printed, scope = "", {"__name__": page.stem}
    for language, title, content in blocks(page):
        if title:
            Path(title).write_text(content, encoding="utf-8")
        elif language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(compile(content, str(page), "exec", dont_inherit=True), scope)
            printed = out.getvalue()
        elif language == "sh":
            for line in content.splitlines():
                if line.startswith("make "):  # tests of their own
                    continue
                arguments = shlex.split(line, comments=True)
                assert arguments[0] == "thermofem", line
                done = CliRunner().invoke(app, arguments[1:])
                assert done.exit_code == 0, (line, done.output, done.exception)
                printed = done.output
        elif language == "text":
            same_text(printed, content)


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.stem)
def test_every_command_and_option_exists(page):
    from typer.main import get_command

    from thermofem_cli import app

    root = get_command(app)
    for name, *arguments in commands(page):
        if name.startswith("-"):
            assert name in ("--version", "--install-completion", "--show-completion"), name
            continue
        assert name in root.commands, f"{page.name}: thermofem {name}"
        known = {opt for p in root.commands[name].params for opt in (*p.opts, *p.secondary_opts)}
        for option in (a for a in arguments if a.startswith("-") and not re.match(r"-\d", a)):
            assert option in known, f"{page.name}: thermofem {name} {option}"


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.stem)
def test_every_python_block_compiles_and_every_link_leads_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for _, language, _, content in BLOCK.findall(text):
        if language == "python":
            compile(content, str(page), "exec")
    for target in re.findall(r"(?:\]\(|src=\")([^)\s\"]+)[)\"\s]", BLOCK.sub("", text)):
        if target.startswith("http"):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name} links to {target}"
        if anchor:
            heads = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w]+", "-", head.lower()).strip("-") for head in heads}
            assert anchor in slugs, f"{page.name} links to {target}"


SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
FILES = (".py", ".toml", ".nc", ".json", ".hpp", ".cpp", ".mjs", ".wasm", ".c", ".cir", ".va", ".fmu", ".csv", ".html")
OF_FILES = {"domain_error", "heater_power", "ring_heat", "white_noise"}  # of results, pins and Verilog-A, too
INSIDE = {
    "CONTRIBUTING.md",
    "commands.md",
    "geometry-reference.md",
}  # names of the sources; of commands and keys of files


def names_in_text(page: Path) -> list[str]:
    """Return the names in backticks outside code blocks, without arguments: `th.solve(heat, wave)` gives th.solve."""
    text = BLOCK.sub("", page.read_text(encoding="utf-8"))
    found = [re.match(r"[A-Za-z_]\w*(?:\.\w+)*", span) for span in SPAN.findall(text) if not span.endswith(FILES)]
    return [match[0] for match in found if match]


def exists(name: str) -> bool:
    """Return whether a dotted name that begins with a package can be imported, down to attributes and fields."""
    parts = re.sub(r"^th(?=\.|$)", "thermofem", name).split(".")
    thing = None
    for length in range(len(parts), 0, -1):  # a function may have the name of the folder that it is in
        with contextlib.suppress(ModuleNotFoundError):
            thing = importlib.import_module(".".join(parts[:length]))
            break
    for part in parts[length:]:
        if not hasattr(thing, part):
            return part in getattr(thing, "__dataclass_fields__", {})
        thing = getattr(thing, part)
    return True


@cache
def functions_of_modules() -> set[str]:
    """Return the functions of all modules that are of several words: one word alone may mean something else."""
    functions = set()
    for package in ("thermofem", "surrogate", "coupled"):
        for file in (ROOT / package).rglob("*.py"):
            body = ast.parse(file.read_text(encoding="utf-8")).body
            functions |= {node.name for node in body if isinstance(node, ast.FunctionDef)}
    return {name for name in functions if "_" in name.strip("_") and not name.startswith("_")}


def test_names_that_do_not_exist_are_seen():
    assert exists("th.solve")
    assert exists("coupled.cycles.limit_cycle.continue_cycle")
    assert exists("th.Foster.tau")
    assert not exists("coupled.power_for_drop")
    assert not exists("th.Foster.taus")


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: page.stem)
def test_every_name_in_the_text_is_written_as_it_is_imported(page):
    from thermofem_cli import COMMANDS

    names = names_in_text(page)
    dotted = [name for name in names if name.partition(".")[0] in ("th", "thermofem", "surrogate", "coupled")]
    assert [name for name in dotted if not exists(name) and name != "th.NAME"] == []
    if page.name in INSIDE:
        return
    public = {name for package in (th, surrogate, coupled) for name in package.__all__} | functions_of_modules()
    kinds = set(KINDS) if page.stem == "models" else set()  # what stands in model files
    bare = public - set(COMMANDS) - set(VARIABLES) - OF_FILES - kinds
    assert [name for name in names if name.partition(".")[0] in bare] == []


def test_generated_pages_are_up_to_date():
    generate = module_of(DOCS / "generate.py")
    for name, text in generate.pages().items():
        assert (DOCS / name).read_text(encoding="utf-8") == text, f"run: python docs/generate.py ({name})"
    required = {
        table: [k for k, words in keys.items() if "**required**" in words] for table, keys in generate.WORDS.items()
    }
    given = {
        "[[layer]]": 'name = "a"\nmaterial = "Si"\nthickness = "1 um"\ndatum = true\n',
        "[[part]]": 'name = "core"\nmaterial = "Si"\nradius = "5 um"\nwidth = "1 um"\nbottom = "0 um"\n'
        'height = "1 um"\n',
    }
    for table, text in given.items():
        for key in required[table]:
            others = "".join(f"{head}\n{body}" for head, body in given.items() if head != table)
            left = "".join(line for line in text.splitlines(True) if not line.startswith(key))
            with pytest.raises(th.InputError, match=f"{key} is missing"):
                th.CrossSection.from_toml_text(f'outer_radius = "60 um"\n{others}{table}\n{left}')


def test_the_names_in_the_table_of_symbols_exist():
    rows = re.findall(r"^\| [^|]*\| [^|]*\| [^|]*\| (.*) \|$", (DOCS / "equations.md").read_text(), re.MULTILINE)
    names = [name for row in rows for name in re.findall(r"`([\w.]+)`", row)]
    assert len(names) > 40
    ring, model = coupled.borghi2021(), surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1e-6, eta=0.31)
    owners = [th, th.models, surrogate, coupled, ring, model, th.Material, th.Boundary, *th.waveforms.KINDS.values()]
    spoken = {*VARIABLES, "kappa", "eta", "tau_f", "tau_s", "tau_th", "heat_capacity"}
    for name in names:
        first, _, rest = re.sub(r"^(th|coupled|surrogate)\.(models\.)?(?=[A-Z])", "", name).partition(".")
        found = [getattr(o, first) for o in owners if hasattr(o, first)] + [coupled] * (first == "coupled")
        assert found or name in spoken, name
        assert not rest or hasattr(found[0], rest) or rest in found[0].__dataclass_fields__, name


def test_the_site_builds_without_a_warning(tmp_path):
    # not --quiet: it would hide the warnings from --strict
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-f", ROOT / "mkdocs.yml", "-d", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    page = (tmp_path / "equations.html").read_text(encoding="utf-8")
    assert "<table>" in page
    assert not re.findall(r'(?:src|href)="https?://(?:fonts|cdn)', page)  # nothing is fetched by the reader
    assert 'href="api.html"' in page  # opens from disk: no folders that a server would turn into their index.html
    for package in (th, surrogate, coupled):
        api = (tmp_path / "api.html").read_text(encoding="utf-8")
        short = "th" if package is th else package.__name__
        assert [name for name in package.__all__ if f">{short}.{name}<" not in re.sub(r"\s", "", api)] == []


def test_every_public_name_is_in_one_group_of_the_api_page():
    names = [name for group in module_of(DOCS / "hooks.py").groups() for name in group["names"]]
    packages = {"th": th, "surrogate": surrogate, "coupled": coupled}
    assert sorted(names) == sorted(f"{short}.{name}" for short, package in packages.items() for name in package.__all__)


def test_every_public_name_has_an_example_that_runs(tmp_path, monkeypatch, needs_mesher):
    monkeypatch.chdir(tmp_path)
    cells = module_of(DOCS / "hooks.py").examples()
    for short, package in {"th": th, "surrogate": surrogate, "coupled": coupled}.items():
        for name in package.__all__:
            thing = getattr(package, name)
            has = ">>>" in (inspect.getdoc(thing) or "") or f"{short}.{name}" in cells or inspect.ismodule(thing)
            assert has, f"{short}.{name} has no example: docs/api_examples.py"
    scope = {"__name__": "examples"}
    for code in dict.fromkeys(cells.values()):
        exec(compile(code, "docs/api_examples.py", "exec", dont_inherit=True), scope)
