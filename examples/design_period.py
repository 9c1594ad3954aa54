"""A ring whose self-pulsing settles at a period of 900 ns.

    python examples/design_period.py [folder]

Trains one family of the paper's ring (radius 7.955 um, core 450 x 220 nm) over the oxides below and above the core,
asks for the member with that period at the paper's working point (8 dBm, zero detuning), certifies it on its own mesh
and draws design_period.png into the folder: the settled period over both oxides, and the design.
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
BOX, OXIDE = "layer.box.thickness", "layer.cladding.thickness"
FREE = {BOX: (1e-6, 4e-6), OXIDE: (0.7e-6, 3e-6)}  # the cladding is measured from the bottom of the core
WANTED = 900e-9  # s


def settled_period(model: th.Foster) -> float:
    """Period in s of the limit cycle on which the ring settles; InputError where it does not pulse."""
    return float(coupled.limit_cycle(RING, model, power=POWER, detuning=0.0).attrs["period"])


def figure(found, path: Path) -> None:
    """The settled period over both oxides, the line of the wanted one and the design."""
    box, oxide = (np.linspace(*FREE[name], 13) for name in (BOX, OXIDE))
    periods = np.full((oxide.size, box.size), np.nan)
    for i, top in enumerate(oxide):
        for j, bottom in enumerate(box):
            periods[i, j] = settled_period(found.family.at({BOX: float(bottom), OXIDE: float(top)}))
    height = 0.22  # um, of the core
    fig, ax = plt.subplots(figsize=(5.7, 3.9), layout="constrained")
    drawn = ax.contourf(
        box * 1e6, oxide * 1e6 - height, periods * 1e9, levels=np.arange(500, 1101, 50), extend="both", cmap="viridis"
    )
    fig.colorbar(drawn, ax=ax, label="settled period (ns)")
    line = ax.contour(box * 1e6, oxide * 1e6 - height, periods * 1e9, levels=[WANTED * 1e9], colors="white")
    ax.clabel(line, fmt="%g ns", inline_spacing=8)
    at = found.values[BOX] * 1e6, found.values[OXIDE] * 1e6 - height
    ax.plot(*at, "*", color="white", mec="black", ms=16)
    where = f"{at[0]:.2f} µm below,\n{at[1]:.2f} µm above"
    ax.annotate(where, at, xytext=(-14, 14), textcoords="offset points", color="white", ha="right")
    ax.set(xlabel="buried oxide (µm)", ylabel="oxide above the core (µm)", title="Self-pulsing at 8 dBm, 0 GHz")
    fig.savefig(path, dpi=220)


def main() -> None:
    """Train, search, certify and draw."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    found = surrogate.design(th.strip_ring(), FREE, target={settled_period: WANTED})
    print(found.message)
    for name, value in found.values.items():
        slope = found.sensitivity["settled_period"][name]
        print(f"{name} = {value * 1e6:.3f} um, {slope * 1e9 * 1e-7:+.1f} ns for 100 nm more")
    certified = surrogate.reduce(found.certified.heat.system, 1e-4).model
    print(f"on its own mesh: {settled_period(certified) * 1e9:.1f} ns, family off by {found.certified.error:.1e}")
    figure(found, folder / "design_period.png")


if __name__ == "__main__":
    main()
