"""The runner: studies whose results are not in the store, in worker processes, then figures, the page and the table."""

import ast
import functools
import hashlib
import importlib
import io
import json
import logging
import platform
import time
from concurrent.futures import FIRST_COMPLETED, wait
from importlib.metadata import version
from pathlib import Path

import matplotlib.pyplot as plt
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

import coupled
import surrogate
import thermofem as th
from thermofem.campaign.stored_tasks import Store, processes
from thermofem.data import files

from .page import page
from .study import FIGURES, STUDIES, Result, needs

HERE = Path(__file__).parents[1]
SAVE = {"data": th.save, "models": surrogate.save_model}
LOAD = {"nc": th.load, "json": surrogate.load_model}
for script in sorted(HERE.glob("[!_]*.py")):
    importlib.import_module(f"paper.{script.stem}")


def run(out, *, quick=False, workers=None, console=None):
    """Reproduce the paper into ``out``: report.html, ring.html, figures/ and data/; return what was made.

    A result that an earlier run stored under the same code is taken, not computed again.
    """
    out, console, begin = Path(out), console or Console(), time.monotonic()
    logging.getLogger("thermofem").setLevel(logging.ERROR)  # the reference stack ends where that of the paper does
    names = [name for name, study in STUDIES.items() if study.quick or not quick]
    figures = [name for name, draw in FIGURES.items() if set(needs(draw)) <= set(names)]
    with files.own_folder(out, ("figures",)), Store(out / "data", "").opened():
        left = [name for name in names if load(out, name) is None]
        failed = compute_all(out, left, workers, console) if left else {}
        results = {name: found for name in names if (found := load(out, name))}
        figures = [name for name in figures if set(needs(FIGURES[name])) <= set(results)]
        with console.status("figures, and the page that computes"):
            pictures = {name: draw(out, name, results) for name in figures}
            text, rows = page(results, pictures, explore(out / "ring.html"), quick)
        table = json.dumps(rows, indent=1, ensure_ascii=False) + "\n"
        files.write_whole(out / "report.html", lambda path: path.write_text(text, encoding="utf-8"))
        files.write_whole(out / "data" / "table.json", lambda path: path.write_text(table, encoding="utf-8"))
    shown = Table("", "the paper", "here", title="Next to the paper (the whole table is in the report)")
    for row in rows:
        if row["key"]:
            shown.add_row(row["quantity"], row["paper"], row["ours"])
    console.print(shown)
    console.print(f"{len(names)} studies ({len(names) - len(left)} of an earlier run), {len(pictures)} figures")
    console.print(f"report: {out / 'report.html'} ({time.monotonic() - begin:.0f} s)")
    for name, error in failed.items():  # the report is without what needs it
        raise RuntimeError(f"{name} could not be computed; the report is without it") from error
    agree = [row["agrees"] for row in rows if row["agrees"] is not None]
    counts = {"studies": len(names), "kept": len(names) - len(left), "figures": len(pictures)}
    return {"report": out / "report.html", **counts, "compared": len(agree), "agree": sum(agree)}


def compute_all(out, left, workers, console):
    """Compute studies in processes, each as soon as what it needs is there, those with the longest way behind first.

    Where one raises, those that do not need it are finished; the errors are returned by name.
    """

    def behind(name):
        return STUDIES[name].weight + max((behind(n) for n in left if name in needs(STUDIES[n])), default=0)

    waiting, running, failed = sorted(left, key=behind, reverse=True), {}, {}
    columns = SpinnerColumn(), TextColumn("{task.description:<60}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console) as bars, processes(workers) as pool:
        bar = bars.add_task("", total=sum(STUDIES[name].weight for name in left))
        while True:
            unfinished = {*waiting, *running.values(), *failed}
            for name in [name for name in waiting if not unfinished & set(needs(STUDIES[name]))]:
                running[pool.submit(compute, out, name)] = name
                waiting.remove(name)
            if not running:
                break
            bars.update(bar, description=", ".join(STUDIES[name].words for name in running.values())[:60])
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                name = running.pop(future)
                bars.advance(bar, STUDIES[name].weight)
                if future.exception():
                    failed[name] = future.exception()
    return failed


def compute(out, name):
    """Compute and store one result; in a worker process."""
    store, key, study = Store(out / "data", ""), keys()[name], STUDIES[name]
    given, begin = [load(out, need) for need in needs(study)], time.process_time()
    found = study(*given)
    content = {"study": name, "cpu_seconds": time.process_time() - begin, "files": []}
    for kind, save in SAVE.items():
        for part, one in getattr(found, kind).items():
            file = f"{key}.{kind}.{part}.{'nc' if kind == 'data' else 'json'}"
            save(one, store.path(file))
            store.enter(file)
            content["files"].append(file)
    content["numbers"] = files.plain(found.numbers)
    store.write(f"{key}.json", (json.dumps(content, indent=1, default=float) + "\n").encode())


def load(out, name):
    """A stored result, or None where it is incomplete or damaged."""
    store, key = Store(out / "data", ""), keys()[name]
    content = json.loads(store.read(f"{key}.json") or b"null")
    if content is None or store.intact(content["files"]) != set(content["files"]):
        return None
    parts = {"data": {}, "models": {}}
    for file in content["files"]:
        kind, part = file.removeprefix(f"{key}.").split(".", 1)
        part, ending = part.rsplit(".", 1)
        parts[kind][part] = LOAD[ending](store.path(file))
    listed = [f"data/results/{file}" for file in (f"{key}.json", *content["files"])]
    return Result(content["numbers"], **parts, seconds=content["cpu_seconds"], files=listed)


@functools.cache
def keys():
    """Key of every study: its name and a hash of the code, the libraries and the keys of what it needs."""
    packages = [Path(package.__file__).parent for package in (th, surrogate, coupled)]
    sources = [path for root in packages for path in sorted(root.rglob("*.?p?")) + sorted(root.rglob("*.py"))]
    code = hashlib.sha256(b"".join(path.read_bytes() for path in sources if "plot" not in str(path)))
    libraries = [platform.python_version(), *map(version, ("numpy", "scipy", "scikit-fem", "numba", "pysindy"))]

    @functools.cache
    def key(name):
        own = computing(STUDIES[name].__module__.rsplit(".", 1)[1])
        tree = [code.hexdigest(), libraries, own, [key(need) for need in needs(STUDIES[name])]]
        return f"{name}-{files.digest_tree(tree)[:10]}"

    return {name: key(name) for name in STUDIES}


@functools.cache
def computing(script):
    """The syntax that decides a script's results, without figures and expected numbers, and that of what it imports."""
    nodes = ast.parse((HERE / f"{script}.py").read_text(encoding="utf-8")).body
    imported = [node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.level == 1]
    others = [computing(name) for name in imported if "." not in name]
    kept = [node for node in nodes if not isinstance(node, (ast.Expr, ast.Import, ast.ImportFrom))]
    return others + [dump for dump in map(ast.dump, kept) if "decorator_list=[Name(id='figure'" not in dump]


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
