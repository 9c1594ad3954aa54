"""A ring whose self-pulsing settles at a period of 900 ns.

    python examples/design_period.py [folder]

Trains one family of strip rings over radius, core width and buried oxide, asks for the member with that period at the
paper's working point (8 dBm, zero detuning), certifies it on its own mesh and draws design_period.png into the folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th

RING, POWER = coupled.borghi2021(), 6.31e-3  # W, 8 dBm
FREE = {
    "part.core.radius": (6e-6, 9e-6),
    "part.core.width": (400e-9, 600e-9),
    "layer.box.thickness": (1e-6, 3e-6),
}
LABELS = {
    "part.core.radius": "radius (µm)",
    "part.core.width": "core width (µm)",
    "layer.box.thickness": "buried oxide (µm)",
}


def settled_period(model: th.Foster) -> float:
    """Period in s of the limit cycle on which the ring settles; InputError where it does not pulse."""
    return float(coupled.limit_cycle(RING, model, power=POWER, detuning=0.0).attrs["period"])


def figure(found: surrogate.Design, path: Path) -> None:
    """The settled period along each parameter through the design."""
    fig, axes = plt.subplots(1, len(FREE), figsize=(9.6, 3.4), layout="constrained", sharey=True)
    for ax, (name, (low, high)) in zip(axes, FREE.items(), strict=True):
        values, periods = np.linspace(low, high, 9), []
        for value in values:
            try:
                periods.append(settled_period(found.family.at({**found.values, name: float(value)})))
            except th.InputError:  # it comes to rest
                periods.append(np.nan)
        ax.plot(values * 1e6, np.array(periods) * 1e9, "-o", ms=3)
        ax.plot(found.values[name] * 1e6, found.achieved["settled_period"] * 1e9, "k*", ms=12)
        ax.axhline(900, color="#999999", lw=0.8, ls="--")
        ax.set(xlabel=LABELS[name])
        ax.grid(alpha=0.25, linewidth=0.5)
    axes[0].set_ylabel("settled period (ns)")
    fig.savefig(path, dpi=200)


def main() -> None:
    """Train, search, certify and draw."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    found = surrogate.design(th.strip_ring(), FREE, target={settled_period: 900e-9})
    print(found.message)
    for name, value in found.values.items():
        slope = found.sensitivity["settled_period"][name]
        print(f"{name} = {value * 1e6:.4f} um, {slope * 1e9 * 1e-8:+.1f} ns for 10 nm more")
    certified = surrogate.reduce(found.certified.heat.system, 1e-4).model
    print(f"on its own mesh: {settled_period(certified) * 1e9:.1f} ns, R_th off by {found.certified.error:.1e}")
    figure(found, folder / "design_period.png")


if __name__ == "__main__":
    main()
