"""What the page of `coupled.explore` takes in Chromium, with Python's time for the same beside it.

    python benchmarks/bench_explore.py [repeats]

Needs playwright and Chromium. The two take turns, so that a busy machine slows them alike; times are medians of wall
time in ms, smallest in brackets. A slider that moves is also measured in CPU time of the whole browser (on Linux),
which other work on the machine changes less. Work: the self-pulsing ring at (8 dBm, 0 GHz) with the certified reduction
of the reference strip (14 poles) and with the second-order equation (2).
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright

import coupled
import surrogate
import thermofem as th

RING, POWER = coupled.borghi2021(), 10**0.8 * 1e-3
POWERS, DETUNINGS = np.geomspace(2e-3, 1e-2, 40), np.linspace(-30e9, 30e9, 40)
READY = """
const p = ringPage, data = JSON.parse(document.getElementById("data").textContent);
await p.loadKernel(data.kernel);
const system = p.systemOf(data.rings[0], data.models[k]), drive = p.driveOf(system, 10 ** 0.8 * 1e-3);
const run = p.integrate(system, drive, 0, p.cold(system), 20000, { method: "rodas4", rtol: 1e-6 });
const found = p.classify(p.columns(run.rows, 0, run.count));
const begin = performance.now();
"""
SCRIPTS = {
    "20 us trace, rtol 1e-6": "p.integrate(system, drive, 0, p.cold(system), 20000, { method: 'rodas4', rtol: 1e-6 });",
    "20 us trace, rtol 1e-5": "p.integrate(system, drive, 0, p.cold(system), 20000, { method: 'rodas4', rtol: 1e-5 });",
    "settled cycle, from 20 us": """p.limitCycle(system, drive, 0, run.y, found.level, {
        rough: { method: "rodas4", rtol: 1e-5 }, fine: { method: "rodas4", rtol: 1e-6 }, period: found.period });""",
    "40 x 40 linear stability": """
        const nu = Float64Array.from({ length: 40 }, (_, j) => p.turnOf((-30 + 60 * j / 39) * 1e9));
        for (let i = 0; i < 40; i++) p.survey(nu, p.driveOf(system, 2e-3 * 5 ** (i / 39)), system);""",
}
# a slider that moves at every frame for 3 s: frames and new traces in a second
MOVING = """async ([name, low, high]) => {
    const slider = document.getElementById(`${name}-slider`), seen = new Set();
    let frames = 0;
    const begin = performance.now();
    while (performance.now() - begin < 3000) {
        const phase = (performance.now() - begin) / 3000;
        slider.value = Math.round(Number(slider.max) * (low + (high - low) * phase));
        slider.dispatchEvent(new Event("input"));
        await new Promise(requestAnimationFrame);
        frames++;
        seen.add(ringPage.shown.trace);
    }
    return [frames / 3, seen.size / 3];
}"""
# one setting after the other, each answered and drawn
STEPPING = """async ([name, low, high, steps]) => {
    const slider = document.getElementById(`${name}-slider`);
    for (let k = 0; k < steps; k++) {
        const before = ringPage.shown.trace;
        slider.value = Math.round(Number(slider.max) * (low + (high - low) * k / steps));
        slider.dispatchEvent(new Event("input"));
        do await new Promise(requestAnimationFrame); while (ringPage.shown.trace === before);
    }
}"""
# from another carrier lifetime to the coarse and to the fine plane, ms
PLANE = """async (lifetime) => {
    const field = document.getElementById("lifetime"), times = [];
    field.value = lifetime;
    const begin = performance.now();
    field.dispatchEvent(new Event("input"));
    for (let map = ringPage.shown.map; times.length < 3; ) {
        await new Promise(requestAnimationFrame);
        if (ringPage.shown.map === map) continue;
        map = ringPage.shown.map;
        times.push(performance.now() - begin);
    }
    return times;
}"""


def in_python(model: th.Foster) -> dict[str, Callable[[], Any]]:
    """The same work; the settled cycle begins cold."""
    return {
        "20 us trace, rtol 1e-6": lambda: coupled.simulate(RING, model, power=POWER, duration=20e-6, rtol=1e-6),
        "20 us trace, rtol 1e-5": lambda: coupled.simulate(RING, model, power=POWER, duration=20e-6, rtol=1e-5),
        "settled cycle, from 20 us": lambda: coupled.limit_cycle(RING, model, power=POWER),
        "40 x 40 linear stability": lambda: coupled.stability_map(RING, model, POWERS, DETUNINGS),
    }


def cpu_of_the_browser() -> float:
    """CPU time in s of all processes that this one has started, and that those have started."""
    taken, children = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue  # ended meanwhile
        taken[path.parent.name] = int(fields[11]) + int(fields[12])
        children.setdefault(fields[1], []).append(path.parent.name)
    found = [str(os.getpid())]
    for name in found:
        found += children.get(name, [])
    return sum(taken[name] for name in found[1:]) / os.sysconf("SC_CLK_TCK")


def main(repeats: int) -> None:
    models = {
        "14 poles": surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-4).model,
        "2 poles": th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6]),
    }
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
        path = Path(folder) / "ring.html"
        coupled.explore(RING, models, path)
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = running.chromium.launch(executable_path=program, args=["--headless", "--no-sandbox", "--disable-gpu"])
        page = browser.new_page(bypass_csp=True)
        begin = time.perf_counter()
        page.goto(path.as_uri())
        page.wait_for_function("ringPage.shown.trace")
        print(
            f"first answer after opening: {time.perf_counter() - begin:.2f} s; file {path.stat().st_size / 1e3:.0f} kB"
        )
        page.wait_for_timeout(4000)
        for name, low, high in (("power", 0.5, 0.8), ("detuning", 0.4, 0.6), ("lifetime", 0.5, 0.7)):
            for _ in range(2):
                frames, traces = page.evaluate(MOVING, [name, low, high])
            page.wait_for_timeout(3000)
            before = cpu_of_the_browser()
            page.evaluate(STEPPING, [name, low, high, 60])
            each = 1e3 * (cpu_of_the_browser() - before) / 60
            print(f"{name} slider moves: {frames:.0f} frames, {traces:.0f} traces a second; CPU {each:.0f} ms each")
            page.wait_for_timeout(3000)
        planes = np.array([page.evaluate(PLANE, 20 + k % 3) for k in range(repeats)])
        times = [f"{np.median(column):.0f} ({column.min():.0f})" for column in planes.T]
        print(f"plane: coarse after {times[0]} ms, fine after {times[2]} ms")
        for k, (poles, model) in enumerate(models.items()):
            python = in_python(model)
            for name, script in SCRIPTS.items():
                times: list[tuple[float, float]] = []
                for _ in range(repeats + 3):  # three for the compilers
                    theirs = page.evaluate(f"async k => {{ {READY} {script} return performance.now() - begin; }}", k)
                    start = time.perf_counter()
                    python[name]()
                    times.append((theirs, 1e3 * (time.perf_counter() - start)))
                js, py = np.median(times[3:], axis=0)
                least = np.min(times[3:], axis=0)
                print(f"{name}, {poles}: page {js:.1f} ({least[0]:.1f}) ms, Python {py:.1f} ({least[1]:.1f}) ms")
        browser.close()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 15)
