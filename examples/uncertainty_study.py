"""What fabrication tolerances make of a ring: Sobol indices, and the probability that it pulses.

    python examples/uncertainty_study.py [folder]

Trains one family of the paper's ring over core width, core height and both oxides, draws members from normal
distributions and draws uncertainty_study.png into the folder: which tolerance matters for the thermal resistance, the
time constant and the settled period at (8 dBm, 0 GHz), and the probability of self-pulsing at every point of a map.

The deviations are typical of silicon photonics. Geometry moves the optics, too: the family knows modes and couplers of
its members, and the paper's measured ring follows them in proportion.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats

import coupled
import surrogate
import thermofem as th
from coupled.ring_family import MovingRing, PulsingMap, SettledPeriod
from thermofem.campaign import Drive, Variation
from thermofem.plot import CYCLE

plt.rcParams["axes.prop_cycle"] = plt.cycler(color=CYCLE)  # the colours of all figures

RING, POWER = coupled.borghi2021(), 6.31e-3  # W, 8 dBm
SPREAD = {
    "width": stats.norm(450e-9, 5e-9),
    "height": stats.norm(220e-9, 2e-9),
    "box": stats.norm(2e-6, 40e-9),
    "cladding": stats.norm(2.22e-6, 100e-9),
}
PATHS = {
    "width": "part.core.width",
    "height": "part.core.height",
    "box": "layer.box.thickness",
    "cladding": "layer.cladding.thickness",
}
LIGHT = """
[light]
wavelength = "1549.5 nm"
[[bus]]
gap = "250 nm"
straight = "3 um"
[[bus]]
name = "drop"
gap = "250 nm"
straight = "3 um"
"""
POWERS, DETUNINGS = 1e-3 * 10 ** (np.linspace(2, 10, 15) / 10), np.linspace(-30e9, 30e9, 25)


def family() -> surrogate.family.Family:
    """All rings within five standard deviations."""
    vary = tuple(
        Variation(name, (PATHS[name],), "m", low=one.mean() - 5 * one.std(), high=one.mean() + 5 * one.std())
        for name, one in SPREAD.items()
    )
    drive = Drive("step", th.Constant(1e-3), (0.0, 1e-6))
    return surrogate.train_family(th.Campaign(th.strip_ring().to_toml() + LIGHT, vary, (drive,), samples=1))


def figure(studies, probability, path: Path) -> None:
    """Bars of Sobol indices beside the map of the probability."""
    fig, (left, right) = plt.subplots(2, 1, figsize=(5.7, 7), layout="constrained")
    names, bar = list(SPREAD), 0.26
    for k, (label, data) in enumerate(studies.items()):
        total = data.total_order.sel(parameter=names)
        spread = data.attrs["standard_deviation"] / data.attrs["mean"]
        left.bar(np.arange(len(names)) + (k - 1) * bar, total, bar, label=f"{label}, ± {spread:.1%}")
    deviations = [f"{name}\n± {1e9 * SPREAD[name].std():.0f} nm" for name in names]
    left.set(
        ylabel="total Sobol index",
        ylim=(0, 1.3),
        yticks=np.arange(0, 1.1, 0.2),
        xticks=range(len(names)),
        xticklabels=deviations,
    )
    left.legend(frameon=False, loc="upper center", ncols=1)
    dBm = 10 * np.log10(POWERS / 1e-3)
    drawn = right.pcolormesh(DETUNINGS / 1e9, dBm, probability["mean"], vmin=0, vmax=1, cmap="magma", shading="nearest")
    fig.colorbar(drawn, ax=right, label="probability of self-pulsing")
    right.set(xlabel="detuning (GHz)", ylabel="power (dBm)")
    fig.savefig(path, dpi=220)


def main() -> None:
    """Train, draw members and draw the figure."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    rings = family()
    optics = MovingRing(rings, RING)
    studies = {
        "thermal resistance": surrogate.uncertainty(rings, SPREAD, samples=1024),
        "time constant": surrogate.uncertainty(rings, SPREAD, "time_constant", samples=1024, interpolate=100),
        "settled period": surrogate.uncertainty(
            rings, SPREAD, SettledPeriod(RING, POWER), samples=1024, optics=optics, interpolate=150
        ),
    }
    for name, data in studies.items():
        shares = ", ".join(f"{p} {float(s):.2f}" for p, s in zip(SPREAD, data.total_order, strict=True))
        error = data.attrs.get("interpolation_error")
        note = "" if error is None else f"; interpolated to {error:.1e} rms"
        print(f"{name}: +- {data.attrs['standard_deviation'] / data.attrs['mean']:.2%}, total indices {shares}{note}")
    probability = surrogate.uncertainty(rings, SPREAD, PulsingMap(RING, POWERS, DETUNINGS), samples=32, optics=optics)
    unsure = float(((probability["mean"] > 0.05) & (probability["mean"] < 0.95)).mean())
    print(f"{unsure:.0%} of the map pulse with a probability between 5 and 95 %")
    figure(studies, probability, folder / "uncertainty_study.png")


if __name__ == "__main__":
    main()
