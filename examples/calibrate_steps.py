"""What is inside a packaged device, from its measured thermal step.

    python examples/calibrate_steps.py [folder of the measured steps] [folder of the picture]

The folder holds led_t3ster.csv, led_t3ster_2.csv, mosfet_dry.csv and mosfet_tim.csv: columns of time (s) and thermal
impedance (K/W) or rise (K), from github.com/nizie002/PyRth (MIT, Copyright 2024 Nils Jonas Ziegeler). Without it the
steps are synthetic ones, of members drawn at random with 0.5 % of noise.

The device is a heated die on an attach layer, a metal tab and a contact to the cold plate. Heat conduction knows no
length: a body 1/L as large warms 1/L^2 as fast and has L times the thermal resistance, with contacts L times as good.
The family is that of a package 300 times smaller, where the times of these records are those that families are made
for. The power of the MOSFET is not stated; 3 W are assumed, and areas scale with it. Draws calibrate_steps.png.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import surrogate
import thermofem as th
from thermofem.campaign import Drive, Variation
from thermofem.plot import CYCLE

plt.rcParams["axes.prop_cycle"] = plt.cycler(color=CYCLE)  # the colours of all figures

L, MILLIMETRE, WATT = 300, 1e-3 / 300, 1e-3
ASSUMED = {"mosfet_dry": 3.0, "mosfet_tim": 3.0}  # W
FIRST = 2e-4  # s, below which the records were extrapolated
SHOWN = {
    "led_t3ster": "LED",
    "led_t3ster_2": "LED, repeated",
    "mosfet_dry": "MOSFET, dry",
    "mosfet_tim": "MOSFET, paste",
}
UNITS = {"die": (1 / MILLIMETRE, "mm"), "tab": (1 / MILLIMETRE, "mm"), "contact": (1 / L, "W/m²/K")}
DIE = ("part.die.outer_radius", "part.junction.outer_radius")
VARIED = (
    Variation("die", DIE, "m", low=0.8 * MILLIMETRE, high=4 * MILLIMETRE),
    Variation("tab", ("layer.tab.thickness",), "m", low=0.15 * MILLIMETRE, high=3 * MILLIMETRE),
    Variation("attach", ("material.solder.conductivity",), "W/m/K", low=0.5, high=60.0, logarithmic=True),
    Variation("metal", ("material.metal.conductivity",), "W/m/K", low=20.0, high=400.0, logarithmic=True),
    Variation("contact", ("boundary.bottom.convection",), "W/m^2/K", low=300 * L, high=3e4 * L, logarithmic=True),
)  # fmt: skip


def package() -> th.CrossSection:
    """A die of silicon on a tab, 300 times smaller than it is."""
    mm = MILLIMETRE

    def material(name: str, conductivity: float, density: float, specific_heat: float) -> th.Material:
        return th.Material(name, conductivity=conductivity, density=density, specific_heat=specific_heat)

    return th.CrossSection(
        "package",
        7.5 * mm,
        layers=(
            th.Layer("tab", "metal", 1.3 * mm),
            th.Layer("attach", "solder", 0.05 * mm, datum=True),
            th.Layer("mould", "epoxy", 1.0 * mm),
        ),
        parts=(
            th.Part("die", "Si", 0.0, 2 * mm, bottom=0.0, height=0.29 * mm),
            th.Part("junction", "Si", 0.0, 2 * mm, bottom=0.29 * mm, height=0.01 * mm, heated=True),
        ),
        bottom=th.Boundary("convection", 3e3 * L),
        materials=(
            material("solder", 40.0, 9000.0, 150.0),
            material("epoxy", 0.8, 1800.0, 1000.0),
            material("metal", 390.0, 8960.0, 385.0),
        ),
    )


def family() -> surrogate.family.Family:
    """All packages in the ranges of VARIED, to 2 %."""
    drive = Drive("step", th.Constant(WATT), (0.0, 1e-6))
    return surrogate.train_family(th.Campaign(package().to_toml(), VARIED, (drive,), samples=1), 2e-2, held_out=4)


def steps(folder: Path | None, packages: surrogate.family.Family):
    """Names, and times and impedances of the package as it is."""
    if folder is not None and folder.is_dir():
        for name in SHOWN:
            times, rise, _ = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1).T
            late = times > FIRST
            yield name, times[late], rise[late] / ASSUMED.get(name, 1.0)
        return
    rng, times = np.random.default_rng(1), np.geomspace(FIRST, 60.0, 110)
    for name, row in zip(SHOWN, packages.box.at(rng.uniform(0.2, 0.8, (len(SHOWN), len(VARIED)))), strict=True):
        rise = packages.at(dict(zip(packages.names, map(float, row), strict=True))).step_response(times / L**2) / L
        yield name, times, rise * (1 + 5e-3 * rng.standard_normal(times.size))


def shown(name: str, value: float) -> str:
    """A parameter of the package as it is."""
    factor, unit = UNITS.get(name, (1.0, "W/m/K"))
    return f"{name} {value * factor:.3g} {unit}"


def main() -> None:
    """Train, calibrate every record, draw."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    target = Path(sys.argv[2] if len(sys.argv) > 2 else ".")
    target.mkdir(parents=True, exist_ok=True)
    packages = family()
    fig, (ax, below) = plt.subplots(
        2, 1, figsize=(6.4, 5.4), sharex=True, height_ratios=(3, 1), layout="constrained"
    )  # fmt: skip
    for k, (name, times, rise) in enumerate(steps(folder, packages)):
        trace = th.dataset.build(
            np.append(0.0, times / L**2), np.append(0.0, rise * L * WATT), th.Constant(WATT)
        )  # fmt: skip
        fit = surrogate.calibrate(packages, trace)
        model = fit.model.step_response(times / L**2) / L
        off = (model - rise) / rise[-1]
        values = ", ".join(shown(n, v) for n, v in fit.values.items())
        print(f"{SHOWN[name]}: rms {np.sqrt(np.mean(off**2)):.2%}, correlation {fit.correlation:.2f}: {values}")
        for text in fit.unseen:
            print(f"  not determined: {text}")
        ax.semilogx(times, rise, ".", color=f"C{k}", ms=4, alpha=0.6)
        ax.semilogx(times, model, color=f"C{k}", lw=1.2, label=SHOWN[name])
        below.semilogx(times, 100 * off, color=f"C{k}", lw=1)
    dots = "measured" if folder else "synthetic"
    ax.set(ylabel="thermal impedance (K/W)", title=f"Dots: {dots}; lines: calibrated packages")
    ax.legend(frameon=False)
    below.set(xlabel="time (s)", ylabel="difference\n(% of the end)")
    fig.savefig(target / "calibrate_steps.png", dpi=160)


if __name__ == "__main__":
    main()
