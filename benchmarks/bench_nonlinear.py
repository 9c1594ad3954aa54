"""k(T) against constant k: cost of one 20 us pulse at 145 K rise to 1e-3, and the error beside it.

The error is that of time integration, against the same run at rtol = 1e-6. Wall times are the best of five, in one
process, warm; peers are measured in turns so that a busy machine slows both.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

import thermofem as th

TIMES = np.linspace(0, 40e-6, 401)


def problems() -> dict[str, th.HeatProblem]:
    strip = th.strip_ring()
    silicon = replace(th.materials.find("Si"), conductivity_law=th.Power(-1.3))
    oxide = replace(th.materials.find("SiO2"), conductivity_law=th.Power(0.33))
    warm = replace(oxide, specific_heat_law=th.Power(0.5))
    return {
        "constant k": th.assemble(strip),
        "k(T)": th.assemble(replace(strip, materials=(silicon, oxide))),
        "k(T), c_p(T)": th.assemble(replace(strip, materials=(silicon, warm))),
    }


def main() -> None:
    pulse, heats = th.Pulse(power=20e-3, width=20e-6), problems()
    exact = {name: th.solve(heat, pulse, TIMES, rtol=1e-6).delta_T.values for name, heat in heats.items()}
    best, data = dict.fromkeys(heats, np.inf), {}
    for _ in range(5):
        for name, heat in heats.items():
            start = time.perf_counter()
            data[name] = th.solve(heat, pulse, TIMES, rtol=1e-3)
            best[name] = min(best[name], time.perf_counter() - start)
    print(f"{'':14}{'ms':>8}{'ratio':>8}{'peak K':>9}{'error':>10}", end="")
    print(f"{'steps':>7}{'solves':>8}{'factors':>9}{'imbalance':>11}")
    for name, found in data.items():
        rise, a = found.delta_T.values, found.attrs
        error = np.abs(rise - exact[name]).max() / rise.max()
        ratio = best[name] / best["constant k"]
        print(f"{name:14}{best[name] * 1e3:8.0f}{ratio:8.2f}{rise.max():9.2f}{error:10.1e}", end="")
        print(f"{a['steps']:7}{a['solves']:8}{a['factorizations']:9}{a['heat_imbalance']:11.1e}")


if __name__ == "__main__":
    main()
