"""Fig. 3: how carriers made by a short pulse recombine."""

from __future__ import annotations

import numpy as np

import coupled

from .stages import Job
from .store import Result

START = 1e23  # 1/m^3, left by the pump pulse; the paper is concerned with 1e15 to 1e18 cm^-3
WINDOWS = {"slow": (0.0, 50e-9), "fast": (250e-9, 300e-9)}  # s, in which the paper takes its two slopes
TIMES = np.linspace(0, 300e-9, 601)


def carriers(job: Job) -> Result:
    """Decay of the carriers with the printed and with the exchanged lifetimes."""
    printed = coupled.borghi2021()
    rings = {"printed": printed, "exchanged": printed.with_swapped_srh()}
    laws = {name: ring.carriers for name, ring in rings.items() if isinstance(ring.carriers, coupled.ShockleyReadHall)}
    data, numbers = {}, {}
    for name, law in laws.items():
        data[name] = coupled.carriers.pump_probe.carrier_decay(law, START, TIMES)
        N = data[name]["carriers"].values
        slopes = {which: _lifetime(TIMES, N, window) for which, window in WINDOWS.items()}
        numbers[name] = {
            "slow_s": slopes["slow"],
            "fast_s": slopes["fast"],
            "low_injection_s": law.tau0,
            "high_injection_s": law.tau0 * law.a / law.b,
            "dropped_by": float(N[0] / np.interp(WINDOWS["fast"][0], TIMES, N)),
        }
    return Result(numbers, data)


def _lifetime(times: np.ndarray, N: np.ndarray, window: tuple[float, float]) -> float:
    """Mean lifetime in a window: minus one over the slope of ln N, as the paper's dashed lines."""
    inside = (times >= window[0]) & (times <= window[1])
    return float(-1 / np.polyfit(times[inside], np.log(N[inside]), 1)[0])
