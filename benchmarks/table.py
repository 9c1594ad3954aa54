"""Runs the benchmarks against named peers and writes docs/benchmarks.md, with a figure of how the cost grows.

    python benchmarks/table.py [--quick] [--again]

Each part runs in a process of its own and is kept in out/benchmarks.json: started again, only what is missing runs
(``--again``: everything). ``--quick`` takes small sizes and one repeat, to see that it works; not for committing.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "out" / "benchmarks.json"
PAGE, FIGURE = ROOT / "docs" / "benchmarks.md", ROOT / "docs" / "images" / "cost.png"
PEERS = ("numpy", "scipy", "scikit-fem", "qdldl", "ngsolve", "femwell", "pymor")

PARTS = {
    "transient": "import bench_peers, json; print(json.dumps(bench_peers.main({accuracy}, {repeats})))",
    "nonlinear": "import bench_nonlinear, json; print(json.dumps(bench_nonlinear.rows({repeats})))",
    "reduction": "import bench_reduce, json; print(json.dumps(bench_reduce.rows({accuracy}, {repeats})))",
    "family": "import bench_family, json; print(json.dumps(bench_family.rows({members})))",
    "coupled": "import bench_coupled, json; print(json.dumps(bench_coupled.rows({repeats})))",
    "circuit": "import bench_circuit, json; print(json.dumps(bench_circuit.rows({repeats})))",
    "scaling": "import bench_scaling, json; print(json.dumps(bench_scaling.main({most})))",
}
WORDS = {
    "transient": (
        "Full-order heat: one pulse on the reference strip",
        """2 mW for 20 µs, 40 µs recorded, error below 1e-3 of the largest rise from 1 ns after each edge on, {unknowns}
quadratic unknowns. What the ratios mean: for piecewise linear power we use a closed form on some twenty basis fields;
no time stepping is as fast; the second row is ours for every other power. The two marches by hand take equal
steps, as one writes them first, and pay for the short times after an edge everywhere; steps that grow after each edge
would close most of their gap to the second row, at the price of a factorization for each. PETSc's adaptive
Rosenbrock-W method is the closest comparison: it factorizes in every step, where our step ladder re-uses seven
factorizations, and it gains where it gives more than it was asked for. femwell is another problem on the same
triangles (planar, linear elements, hence four times fewer unknowns), and its undamped Crank–Nicolson steps do not
reach the error; its time and error are those of its default use.""",
    ),
    "nonlinear": (
        "Conductivity and heat capacity that depend on temperature: a pulse to 145 K",
        """20 mW for 20 µs, 40 µs recorded, 2508 unknowns, rtol 1e-3. The error is that of the time integration,
against a run at rtol 1e-6. Every row is the full-order FEM in time steps, except the second one, which is
in closed form. The linear runs reuse the factors and fields of an earlier run.""",
    ),
    "reduction": (
        "Reduction: the same matrices to a handful of poles",
        """The error is the largest of |Z − Z_r|/R_th over 60 frequencies from 1 kHz to 100 GHz. Ours comes with a
proven bound. pyMOR's balanced truncation and IRKA are general methods for any linear system and do not use that heat
is symmetric; this explains most of the ratio. Their order is ours for 1e-4 (balanced truncation) and 10
(IRKA).""",
    ),
    "family": (
        "Families: one model for all rings in a range",
        """Radius 4 to 12 µm, width 400 to 600 nm, box 1 to 3 µm. The error is the largest of the step response from 1
ns to 100 µs over random members that neither has seen, on meshes of accuracy 1e-4. scikit-learn's way, as one writes it
first: logarithms of as many solved step responses, 12 principal components, a Gaussian process for each; it gives no
network and no bound.

A campaign of 1000 of these rings, a step at 41 times each, accuracy 1e-3, two workers, takes 44 s with its start.
Before meshes moved with the geometry it took 118 s (commit 24c6f54). Both ran in turns on an idle machine with two
cores, the new code twice (44.4 and 44.5 s).""",
    ),
    "coupled": (
        "Coupled dynamics: 20 µs of self-pulsing",
        """(8 dBm, 0 GHz), 2001 output times, tolerances chosen for equal errors, root mean square over all states.
SciPy's LSODA integrates our compiled right-hand side: its ratio is the cost of calling Python in every step.""",
    ),
    "circuit": (
        "Circuits: several rings with heat between them",
        """Three tasks: one ring and sixteen separate rings, compared with as many runs of `simulate`; sixteen rings
with full crosstalk on one bus under 1 GHz symbols, compared with SciPy's LSODA on the same compiled right-
hand side, restarted at every edge; and three rings under 100 MHz symbols for 1 ms. The seconds for 100 µs
are scaled from a shorter run. The errors are those of the energies (in the first two rows after 2 µs). The
last column compares the first two rows with `simulate`, and LSODA with our run of the nearest error.""",
    ),
}


def run(part: str, quick: bool) -> Any:
    """The rows of one part, from a process of its own."""
    sizes = {"accuracy": 1e-3 if quick else 1e-4, "repeats": 1 if quick else 3, "most": 7e3 if quick else 4.5e5}
    sizes["members"] = 4 if quick else 10
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-W", "ignore", "-c", PARTS[part].format(**sizes)]
    done = subprocess.run(
        command, cwd=Path(__file__).parent, env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def machine() -> str:
    """CPU model, number of cores, system and versions; no names of hosts."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        cpu = next((line.split(":")[1].strip() for line in info.read_text().splitlines() if "model name" in line), cpu)
    versions = []
    for name in PEERS:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{name} not installed")
    return (
        f"{cpu}, {os.cpu_count()} cores, one thread; {platform.system()}, Python {platform.python_version()}; "
        + ", ".join(versions)
        + "."
    )


def table(rows: list[dict[str, Any]], what: str) -> str:
    """Markdown rows; ``what`` the first one is, which the ratios refer to."""
    text = f"| | how | error | CPU s | times {what} |\n|---|---|---|---|---|\n"
    for row in rows:
        if "seconds" in row:
            text += (
                f"| {row['who']} | {row['how']} | {row['error']:.1e} | {row['seconds']:.3g} | {row['ratio']:.3g} |\n"
            )
        else:
            text += f"| {row['who']} | {row['how']} | | | |\n"
    return text


def slopes(curves: dict[str, list[list[float]]]) -> str:
    """Range and exponent of every cost curve."""
    text = "| cost of | sizes | seconds | slope |\n|---|---|---|---|\n"
    for name, points in curves.items():
        size, seconds = np.array(points).T
        slope = np.polyfit(np.log(size), np.log(seconds), 1)[0] if size.size > 1 else float("nan")
        ends = f"{size[0]:.4g} to {size[-1]:.4g} | {seconds[0]:.2g} to {seconds[-1]:.2g}"
        text += f"| {name} | {ends} | {slope:.2f} |\n"
    return text


def draw(curves: dict[str, list[list[float]]], path: Path) -> None:
    """CPU time over size, both over those of the smallest size: how each cost grows, on one scale.

    The campaign is in the table alone: its wall time contains the start of its worker.
    """
    import matplotlib.pyplot as plt

    curves = {name: points for name, points in curves.items() if not name.startswith("campaign")}

    colours = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9"
    fig, ax = plt.subplots(figsize=(5.7, 4.6), layout="constrained")
    for colour, (name, points) in zip(colours, curves.items(), strict=True):
        size, seconds = np.array(points).T
        slope = np.polyfit(np.log(size), np.log(seconds), 1)[0] if size.size > 1 else float("nan")
        words = f"{name}: {slope:.2f}"
        ax.loglog(size / size[0], seconds / seconds[0], "o-", color=colour, markersize=4, label=words)
    ends = np.array([1, max(points[-1][0] / points[0][0] for points in curves.values())])
    ax.loglog(ends, ends, ":", color="#222222", linewidth=1, label="in proportion: 1")
    ax.set(xlabel="size over the smallest", ylabel="time over that of the smallest")
    ax.grid(alpha=0.25, which="major")
    ax.legend(frameon=False, fontsize="small", title="slope of", title_fontsize="small", alignment="left")
    fig.savefig(path, dpi=150)


def main(quick: bool, again: bool) -> None:
    """Run what is missing, then write page and figure."""
    KEPT.parent.mkdir(exist_ok=True)
    key = "quick" if quick else "full"
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    results = {} if again else kept.get(key, {})
    for part in PARTS:
        if part not in results:
            print(f"{part} ...", flush=True)
            results[part] = run(part, quick)
            KEPT.write_text(json.dumps({**kept, key: results}))
    unknowns = results["transient"][0]["unknowns"]
    text = "# Benchmarks\n\nWritten by `make bench`, in an environment of its own with the peers. Medians of runs that "
    text += f"take turns, CPU time, the error beside each.\n\nMachine: {machine()}\n"
    if quick:
        text += "\nSmall sizes and one repeat (`make bench BENCH=--quick`), on a machine that others were using.\n"
    for part, (title, words) in WORDS.items():
        what = "linear" if part == "nonlinear" else "ours"
        text += f"\n## {title}\n\n{words.format(unknowns=unknowns)}\n\n{table(results[part], what)}"
    text += "\n## How the cost grows\n\nOne run each; the campaign in wall seconds of one worker process, its start "
    text += f"included.\n\n{slopes(results['scaling'])}\n![Cost against size](images/{FIGURE.name})\n"
    page, figure = (PAGE, FIGURE) if not quick else (KEPT.with_name("benchmarks.md"), KEPT.with_name("cost.png"))
    page.write_text(text, encoding="utf-8")
    draw(results["scaling"], figure)
    print(f"wrote {page.relative_to(ROOT)} and {figure.relative_to(ROOT)}")


if __name__ == "__main__":
    main("--quick" in sys.argv, "--again" in sys.argv)
