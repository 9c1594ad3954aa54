"""k(T) against constant k: cost of one 20 us pulse at 145 K rise to 1e-3, and the error beside it.

The error is that of time integration, against the same run at rtol = 1e-6. All are stepped, as k(T) must be; what the
closed form of the linear run takes stands beside them. CPU times are medians, in one process, warm (the linear runs
keep factors and fields of the run before); they take turns so that a busy machine slows all.

    python benchmarks/bench_nonlinear.py
"""

from __future__ import annotations

import time
from dataclasses import replace
from statistics import median

import numpy as np

import thermofem as th

TIMES = np.linspace(0, 40e-6, 401)


def problems() -> dict[str, th.fem.HeatProblem]:
    strip = th.strip_ring()
    silicon = replace(th.materials.find("Si"), conductivity_law=th.materials.PowerLaw(-1.3))
    oxide = replace(th.materials.find("SiO2"), conductivity_law=th.materials.PowerLaw(0.33))
    warm = replace(oxide, specific_heat_law=th.materials.PowerLaw(0.5))
    return {
        "constant k": th.assemble(strip),
        "constant k, closed form": th.assemble(strip),
        "k(T)": th.assemble(replace(strip, materials=(silicon, oxide))),
        "k(T), c_p(T)": th.assemble(replace(strip, materials=(silicon, warm))),
    }


def rows(repeats: int = 7) -> list[dict[str, object]]:
    """One row for each kind of conduction, as `table.table` takes them."""
    pulse, heats = th.Pulse(power=20e-3, width=20e-6), problems()
    exact = {
        name: th.solve(heat, pulse, TIMES, rtol=1e-6, method="stepping").delta_T.values for name, heat in heats.items()
    }
    took, data = {name: [] for name in heats}, {}
    for _ in range(repeats):
        for name, heat in heats.items():
            start = time.process_time()
            data[name] = th.solve(heat, pulse, TIMES, rtol=1e-3, method="auto" if "closed" in name else "stepping")
            took[name].append(time.process_time() - start)
    made = []
    for name, found in data.items():
        rise, a = found.delta_T.values, found.attrs
        made.append(
            {
                "who": name,
                "how": f"peak {rise.max():.0f} K, {a['steps']} {'pieces' if 'closed' in name else 'steps'}, "
                f"{a['solves']} solves, {a['factorizations']} factorizations",
                "error": float(np.abs(rise - exact[name]).max() / rise.max()),
                "seconds": median(took[name]),
                "ratio": median(t / linear for t, linear in zip(took[name], took["constant k"], strict=True)),
            }
        )
    return made


def main() -> None:
    for row in rows():
        print(f"{row['who']:25}{row['seconds'] * 1e3:8.0f} ms{row['ratio']:8.2f}{row['error']:10.1e}  {row['how']}")


if __name__ == "__main__":
    main()
