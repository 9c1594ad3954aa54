"""The runner: studies whose results are not in the store, in worker processes, then figures, the page and the table."""

import ast
import functools
import hashlib
import importlib
import io
import json
import platform
import time
from importlib.metadata import version
from pathlib import Path

import matplotlib.pyplot as plt
from rich.console import Console

import coupled
import surrogate
import thermofem as th
from thermofem.campaign.stored_tasks import Store, completed
from thermofem.data import files

from .page import page
from .study import FIGURES, STUDIES, Result, needs

SCRIPTS = sorted(Path(__file__).parents[1].glob("[!_]*.py"))
SAVE = {"data": (".nc", th.save, th.load), "models": (".json", surrogate.save_model, surrogate.load_model)}
for script in SCRIPTS:
    importlib.import_module(f"paper.{script.stem}")


def run(out, *, quick=False, workers=None, console=None):
    """Reproduce the paper into ``out``: report.html, ring.html, figures/ and data/; return what was made.

    A result that an earlier run stored under the same code is taken, not computed again. Rows of the table that lack a
    number have a dash and are named on the screen; "incomplete" counts them.
    """
    out, console, begin = Path(out), console or Console(), time.monotonic()
    names = [name for name, study in STUDIES.items() if study.quick or not quick]
    with files.own_folder(out, ("figures",)), Store(out / "data", "").opened():
        left = [name for name in names if load(out, name) is None]
        failed = compute_all(out, left, workers, console)
        results = {name: found for name in names if (found := load(out, name))}
        with console.status("figures, and the page that computes"):
            pictures = {name: draw(out, name, results) for name in FIGURES if set(needs(FIGURES[name])) <= set(results)}
            text, rows = page(results, pictures, explore(out / "ring.html"), quick)
        table = json.dumps(rows, indent=1, ensure_ascii=False) + "\n"
        for path, content in ((out / "report.html", text), (out / "data" / "table.json", table)):
            files.write_whole(path, lambda path, content=content: path.write_text(content, encoding="utf-8"))
    agree = [row["agrees"] for row in rows if row["agrees"] is not None]
    console.print(f"{len(names)} studies ({len(names) - len(left)} of an earlier run), {len(pictures)} figures")
    console.print(f"{sum(agree)} of {len(agree)} compared statements agree; the table says why the others do not")
    console.print(f"report: {out / 'report.html'} ({time.monotonic() - begin:.0f} s)")
    incomplete = [entry for entry in rows if entry["missing"]]
    for entry in incomplete:
        console.print(f"no number: {entry['quantity']} ({', '.join(entry['missing'])})")
    for name, error in failed.items():
        raise RuntimeError(f"{name} could not be computed; the report has dashes in its place") from error
    counts = {"studies": len(names), "kept": len(names) - len(left), "compared": len(agree), "agree": sum(agree)}
    counts |= {"rows": len(rows), "incomplete": len(incomplete)}
    return {"report": out / "report.html", "figures": len(pictures), **counts}


def compute_all(out, left, workers, console):
    """Compute studies in processes, those first that need no other; return the errors of those that failed, by name."""
    failed, task = {}, functools.partial(compute, out, keys())
    while ready := [name for name in left if not {*left, *failed} & set(needs(STUDIES[name]))]:
        for name, future in completed(task, ready, workers=workers):
            console.print(f"{STUDIES[name].words}{': failed' if future.exception() else ''}")
            if future.exception():
                failed[name] = future.exception()
        left = [name for name in left if name not in ready]
    return failed


def compute(out, code, name):
    """Compute and store one result; in a worker process."""
    store, key, study, begin = Store(out / "data", ""), code[name], STUDIES[name], time.process_time()
    found = study(*(load(out, need, code) for need in needs(study)))
    content = {"study": name, "cpu_seconds": time.process_time() - begin, "files": []}
    for kind, (ending, save, _) in SAVE.items():
        for part, one in getattr(found, kind).items():
            content["files"].append(f"{key}.{kind}.{part}{ending}")
            save(one, store.path(content["files"][-1]))
            store.enter(content["files"][-1])
    content["numbers"] = files.plain(found.numbers)
    store.write(f"{key}.json", (json.dumps(content, indent=1, default=float) + "\n").encode())


def load(out, name, code=None):
    """A stored result, or None where it is incomplete or damaged."""
    store, key = Store(out / "data", ""), (code or keys())[name]
    content = json.loads(store.read(f"{key}.json") or b"null")
    if content is None or store.intact(content["files"]) != set(content["files"]):
        return None
    parts = {"data": {}, "models": {}}
    for file in content["files"]:
        kind, part = file.removeprefix(f"{key}.").split(".", 1)
        ending, _, read = SAVE[kind]
        parts[kind][part.removesuffix(ending)] = read(store.path(file))
    listed = [f"data/results/{file}" for file in (f"{key}.json", *content["files"])]
    return Result(content["numbers"], **parts, seconds=content["cpu_seconds"], files=listed)


@functools.cache
def keys():
    """Key of every study: its name and a hash of the libraries, of the packages without plots, and of the scripts.

    Of the scripts the figures do not count, which are drawn in every run.
    """
    versions = [platform.python_version(), *map(version, ("numpy", "scipy", "scikit-fem", "pysindy"))]
    code = hashlib.sha256(repr(versions).encode())
    for package in (th, surrogate, coupled):
        for path in sorted(Path(package.__file__).parent.rglob("*.[chp]*")):
            if path.suffix in (".cpp", ".hpp", ".py") and "plot" not in str(path):
                code.update(path.read_bytes())
    for path in SCRIPTS:
        nodes = [ast.dump(node) for node in ast.parse(path.read_text(encoding="utf-8")).body]
        code.update("".join(node for node in nodes if "Name(id='figure'" not in node).encode())
    return {name: f"{name}-{code.hexdigest()[:10]}" for name in STUDIES}


def draw(out, name, results):
    """A panel as SVG, also in figures/: letters as outlines, which look the same everywhere, and no date."""
    with plt.rc_context({"svg.fonttype": "path", "svg.hashsalt": name, "font.size": 9.5}):
        ax, buffer = FIGURES[name](*(results[need] for need in needs(FIGURES[name]))), io.BytesIO()
        ax.figure.savefig(buffer, format="svg", dpi=200, metadata={"Date": None})
        plt.close(ax.figure)
    files.write_whole(out / "figures" / f"{name}.svg", lambda path: path.write_bytes(buffer.getvalue()))
    return buffer.getvalue()


def explore(path):
    """Write the page that computes the reference ring; return its text."""
    heat = th.assemble(th.strip_ring())
    models = {"certified reduction": surrogate.reduce(heat.system, tolerance=1e-4)}
    models |= surrogate.train_all(heat, names=["Newton", "second order", "Foster, trained (5)"]).models
    coupled.explore(coupled.borghi2021(), models, path, heat=heat)
    return path.read_text(encoding="utf-8")
