"""The ring's own numbers, and Fig. 3(b): how carriers made by a short pulse recombine."""

from __future__ import annotations

import numpy as np

import coupled

from .stages import Job
from .store import Result

START = (
    1e23  # 1/m^3, left by the pump pulse: from here carriers fall by nearly two decades in 300 ns, as the paper says
)
KAPPA_SQUARED = 0.063  # power coupling into each bus, Section 2
FAINT = 1e-7  # W: -40 dBm, too little for anything nonlinear
WINDOWS = {"slow": (0.0, 50e-9), "fast": (250e-9, 300e-9)}  # s, in which the paper takes its two slopes
TIMES = np.linspace(0, 300e-9, 601)


def ring(job: Job) -> Result:
    """What follows from the paper's table of parameters alone."""
    from scipy.constants import c

    own = coupled.borghi2021()
    perimeter = job.inputs["elements"].numbers["perimeter_m"]
    model = job.inputs["elements"].models["reduction"]
    last = coupled.simulate(own, model, power=FAINT, detuning=0.0, duration=40e-6).isel(time=-1)
    return Result(
        {
            "loaded_q": own.loaded_q,
            "intrinsic_q": own.intrinsic_q,
            "bus_rate_from_kappa": KAPPA_SQUARED * c / (own.group_index * perimeter) / 2,
            "bus_rate": own.bus_rate,
            "shift_Hz_per_K": own.thermal_shift / (2 * np.pi),
            "faint": {name: float(last[name]) / FAINT for name in ("drop", "through", "absorbed")},
        }
    )


def carriers(job: Job) -> Result:
    """Decay of the carriers with the printed and with the exchanged lifetimes."""
    printed = coupled.borghi2021()
    rings = {"printed": printed, "exchanged": printed.with_swapped_srh()}
    laws = {name: ring.carriers for name, ring in rings.items() if isinstance(ring.carriers, coupled.ShockleyReadHall)}
    data, numbers = {}, {}
    for name, law in laws.items():
        data[name] = coupled.carrier_decay(law, START, TIMES)
        N = data[name]["carriers"].values
        slopes = {which: _lifetime(TIMES, N, window) for which, window in WINDOWS.items()}
        numbers[name] = {
            "slow_s": slopes["slow"],
            "fast_s": slopes["fast"],
            "low_injection_s": law.tau0,
            "high_injection_s": law.tau0 * law.a / law.b,
            "dropped_by": float(N[0] / N[-1]),
        }
    return Result(numbers, data)


def _lifetime(times: np.ndarray, N: np.ndarray, window: tuple[float, float]) -> float:
    """Mean lifetime in a window: minus one over the slope of ln N, as the paper's dashed lines."""
    inside = (times >= window[0]) & (times <= window[1])
    return float(-1 / np.polyfit(times[inside], np.log(N[inside]), 1)[0])
