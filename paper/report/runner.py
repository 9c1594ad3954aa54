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
from thermofem.campaign.store import Store
from thermofem.campaign.workers import processes
from thermofem.data import files

from .page import page
from .study import FIGURES, STUDIES, Result, needs

HERE = Path(__file__).parents[1]
for script in sorted(HERE.glob("[!_]*.py")):
    importlib.import_module(f"paper.{script.stem}")


def run(out, *, quick=False, workers=None, console=None):
    """Reproduce the paper into ``out``: report.html, ring.html, figures/ and data/; return what was made.

    A result that an earlier run stored under the same code is taken, not computed again.
    """
    out, console = Path(out), console or Console()
    names = [name for name, study in STUDIES.items() if study.quick or not quick]
    store, keys, begin = Store(out / "data", ""), keys_of(), time.monotonic()
    logging.getLogger("thermofem").setLevel(logging.ERROR)  # the reference stack ends where that of the paper does
    with files.own_folder(out, ("figures",)), store.opened():
        results = {name: found for name in names if (found := load(store, keys[name]))}
        kept = len(results)
        figures = [name for name, draw in FIGURES.items() if set(needs(draw)) <= set(names)]
        compute_all(out, [name for name in names if name not in results], workers, console)
        results = {name: load(store, keys[name]) for name in names}
        with console.status("figures and the page that computes"):
            pictures = {name: draw(out, name, results) for name in figures}
            explorer = explore(out / "ring.html")
            text, rows = page(results, pictures, explorer, quick, {name: listed(store, keys[name]) for name in names})
        files.write_whole(out / "report.html", lambda path: path.write_text(text, encoding="utf-8"))
        table = json.dumps(rows, indent=1, ensure_ascii=False) + "\n"
        files.write_whole(out / "data" / "table.json", lambda path: path.write_text(table, encoding="utf-8"))
    shown = Table("", "the paper", "here", title="Next to the paper (the whole table is in the report)")
    for row in rows:
        if row["key"]:
            shown.add_row(row["quantity"], row["paper"], row["ours"])
    console.print(shown)
    console.print(f"{len(names)} studies ({kept} taken from an earlier run), {len(pictures)} figures")
    console.print(f"report: {out / 'report.html'} ({time.monotonic() - begin:.0f} s)")
    compared = [row["agrees"] for row in rows if row["agrees"] is not None]
    counts = {"studies": len(names), "kept": kept, "figures": len(pictures), "compared": len(compared)}
    return {"report": out / "report.html", **counts, "agree": sum(compared)}


def compute_all(out, left, workers, console):
    """Compute studies in processes, each as soon as what it needs is there, those with the longest way behind first."""
    if not left:
        return
    behind = functools.cache(
        lambda name: STUDIES[name].weight + max((behind(n) for n in left if name in needs(STUDIES[n])), default=0)
    )
    waiting, running = sorted(left, key=behind, reverse=True), {}
    columns = SpinnerColumn(), TextColumn("{task.description:<60}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console) as bars, processes(workers) as pool:
        bar = bars.add_task("", total=sum(STUDIES[name].weight for name in left))
        while waiting or running:
            unfinished = {*waiting, *running.values()}
            for name in [name for name in waiting if not unfinished & set(needs(STUDIES[name]))]:
                running[pool.submit(compute, out, name)] = name
                waiting.remove(name)
            bars.update(bar, description=", ".join(STUDIES[name].words for name in running.values())[:60])
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                future.result()
                bars.advance(bar, STUDIES[running.pop(future)].weight)


def compute(out, name):
    """Compute and store one result; in a worker process."""
    store, keys, study = Store(out / "data", ""), keys_of(), STUDIES[name]
    given = {need: load(store, keys[need]) for need in needs(study)}
    begin = time.process_time()
    found = study(**given)
    seconds = time.process_time() - begin
    content = {"study": name, "cpu_seconds": seconds, "files": [], "numbers": files.plain(found.numbers)}
    for kind, ending, save in (("data", "nc", th.save), ("models", "json", surrogate.save_model)):
        for part, one in getattr(found, kind).items():
            key = f"{keys[name]}.{kind}.{part}.{ending}"
            save(one, store.path(key))
            store.enter(key)
            content["files"].append(key)
    store.write(f"{keys[name]}.json", (json.dumps(content, indent=1, default=float) + "\n").encode())


def load(store, key):
    """A stored result, or None where it is incomplete or damaged."""
    content = store.read(f"{key}.json")
    if content is None:
        return None
    content = json.loads(content)
    if store.intact(content["files"]) != set(content["files"]):
        return None
    parts = {"data": {}, "models": {}}
    for name in content["files"]:
        kind, part = name.removeprefix(f"{key}.").rsplit(".", 1)[0].split(".", 1)
        parts[kind][part] = (th.load if kind == "data" else surrogate.load_model)(store.path(name))
    return Result(content["numbers"], **parts, seconds=content["cpu_seconds"])


def listed(store, key):
    """Paths of the files of a result, from ``out``, its numbers first."""
    names = [f"{key}.json", *json.loads(store.read(f"{key}.json"))["files"]]
    return [store.path(name).relative_to(store.folder.parent).as_posix() for name in names]


@functools.cache
def keys_of():
    """Key of every study: its name and a hash of the code, the libraries and the keys of what it needs."""
    packages = [Path(package.__file__).parent for package in (th, surrogate, coupled)]
    sources = [path for root in packages for path in sorted(root.rglob("*.?p?")) + sorted(root.rglob("*.py"))]
    code = hashlib.sha256(b"".join(path.read_bytes() for path in sources if "plot" not in str(path)))
    libraries = [platform.python_version(), *map(version, ("numpy", "scipy", "scikit-fem", "numba", "pysindy"))]
    shared = [code.hexdigest(), libraries]

    @functools.cache
    def key(name):
        own = computing(STUDIES[name].__module__.rsplit(".", 1)[1])
        return f"{name}-{files.digest_tree([shared, own, [key(need) for need in needs(STUDIES[name])]])[:10]}"

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
        ax, buffer = FIGURES[name](**{need: results[need] for need in needs(FIGURES[name])}), io.BytesIO()
        ax.figure.savefig(buffer, format="svg", dpi=200, metadata={"Date": None})
        plt.close(ax.figure)
    files.write_whole(out / "figures" / f"{name}.svg", lambda path: path.write_bytes(buffer.getvalue()))
    return buffer.getvalue()


def explore(path):
    """Write the page that computes the reference ring; return its text."""
    heat = th.assemble(th.strip_ring())
    names = ["Newton", "second order", "Foster, trained (5)"]
    models = {"certified reduction": surrogate.reduce(heat.system, tolerance=1e-4)}
    coupled.explore(coupled.borghi2021(), models | surrogate.train_all(heat, names=names).models, path, heat=heat)
    return path.read_text(encoding="utf-8")
