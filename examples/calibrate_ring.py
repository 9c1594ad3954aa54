"""Which stacks a measured ring can have: the resistance that its bistable loops ask for, as oxides.

    python examples/calibrate_ring.py folder [folder of the picture]

The folder holds full_loops_2018-01-12.csv, see measured_bistability.py. The loops are steady states, so the heat enters
through its thermal resistance alone. For each of many resistances power, cold wavelength, loss and carrier lifetime are
fitted again; the misfit has a minimum, which a family of this ring turns into pairs of oxides below and above the core.
The misfit is systematic (4 %, the loops repeat to 0.3 %), so the region is no standard error: it holds the resistances
whose misfit is at most 5 % larger than the smallest. Draws calibrate_ring.png.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import measured_bistability as measured
import numpy as np

import surrogate
import thermofem as th
from thermofem.campaign import Drive, Variation
from thermofem.plot import CYCLE

plt.rcParams["axes.prop_cycle"] = plt.cycler(color=CYCLE)  # the colours of all figures

WORSE = 1.05  # times the smallest misfit
CORE = 0.22  # um, height of silicon, from whose bottom the cladding is measured
VARIED = (
    Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=4e-6),
    Variation("cladding", ("layer.cladding.thickness",), "m", low=0.72e-6, high=3.22e-6),
)


def family() -> surrogate.family.Family:
    """This ring in all stacks."""
    drive = Drive("step", th.Constant(1e-3), (0.0, 1e-6))
    plan = th.Campaign(th.strip_ring(**measured.GEOMETRY).to_toml(), VARIED, (drive,), samples=1)
    return surrogate.train_family(plan, 5e-3, held_out=4)


def misfits(folder: Path, resistances: np.ndarray, lumped: bool) -> np.ndarray:
    """Rms of ln P at every thermal resistance, all else fitted."""
    data = measured.load(folder / "full_loops_2018-01-12.csv")
    return np.array([measured.fit(data, lumped=lumped, model=th.Foster([R], [1e-6]))[1] for R in resistances])


def main() -> None:
    """Profile the misfit, train the family, draw."""
    folder, target = Path(sys.argv[1]), Path(sys.argv[2] if len(sys.argv) > 2 else ".")
    target.mkdir(parents=True, exist_ok=True)
    resistances = np.linspace(8e3, 22e3, 43)
    fig, (left, right) = plt.subplots(2, 1, figsize=(5.7, 6.6), layout="constrained")
    kept = {}
    for lumped, words in ((True, "lumped dispersion"), (False, "two-term dispersion")):
        rms = misfits(folder, resistances, lumped)
        inside = resistances[rms <= WORSE * rms.min()]
        ends = rms.argmin() in (0, rms.size - 1)
        if not ends:
            kept[words] = inside.min(), inside.max()
        left.plot(resistances / 1e3, 100 * rms, label=words)
        best = resistances[rms.argmin()]
        span = f"{inside.min() / 1e3:.1f} to {inside.max() / 1e3:.1f}"
        found = (
            f"no minimum, {rms.min():.2%} at the end" if ends else f"{best / 1e3:.1f} K/mW, {span}, rms {rms.min():.2%}"
        )
        print(f"{words}: {found}")
    left.set(xlabel="thermal resistance (K/mW)", ylabel="misfit of the loops (%)")
    left.legend(frameon=False)
    rings = family()
    box, cladding = (np.linspace(v.low, v.high, 61) for v in VARIED)
    R = rings.thermal_resistance(box=box, cladding=cladding[:, None]) / 1e3
    above = cladding * 1e6 - CORE
    lines = right.contour(box * 1e6, above, R, levels=np.arange(8, 24, 2), colors="0.5", linewidths=0.8)
    right.clabel(lines, fmt="%g K/mW", fontsize="small")
    for k, (words, (low, high)) in enumerate(kept.items()):
        right.contourf(box * 1e6, above, R, levels=[low / 1e3, high / 1e3], colors=[f"C{k}"], alpha=0.35)
        right.plot([], [], color=f"C{k}", lw=6, alpha=0.35, label=words)
    right.legend(loc="upper right", fontsize="small")
    right.set(xlabel="buried oxide (µm)", ylabel="oxide above the core (µm)")
    fig.savefig(target / "calibrate_ring.png", dpi=220)


if __name__ == "__main__":
    main()
