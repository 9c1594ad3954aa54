"""Figures of published devices, computed from the geometry files of docs/measured.

python tests/support/devices.py          prints the figures of every device of docs/measured.toml
python tests/support/devices.py figure   draws docs/images/shifters.png
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from paths import ROOT

import surrogate
import thermofem as th
import thermofem.readout
from thermofem.data import quantity

MEASURED = ROOT / "docs" / "measured.toml"
CONTENT: dict[str, list[dict[str, Any]]] = tomllib.loads(MEASURED.read_text(encoding="utf-8"))
DEVICES, SHIFTERS = CONTENT["device"], CONTENT["shifter"]
GROUP_INDEX = 4.2  # of a silicon wire, where the source states none
WAVELENGTH = 1550e-9


@dataclass(frozen=True)
class Device:
    """A published device with one of its unknowns set, or as its file has it."""

    row: dict[str, Any]
    unknown: str | None = None

    @cached_property
    def geometry(self) -> th.CrossSection:
        geometry = th.CrossSection.from_toml(MEASURED.parent / "measured" / self.row["geometry"])
        return geometry if self.unknown is None else geometry.with_({self.row["vary"]["path"]: self.unknown})

    @cached_property
    def heat(self) -> th.fem.HeatProblem:
        return th.assemble(self.geometry, accuracy=5e-3)

    @cached_property
    def system(self) -> th.StateSpace:
        heated, read = self.row["heated"], self.row["read"]
        return self.heat.channels(heated, (read,)).channel(heated, read)

    @cached_property
    def resistance(self) -> float:
        return self.heat.thermal_resistance(self.row["heated"], self.row["read"])

    @cached_property
    def step(self) -> tuple[np.ndarray, np.ndarray]:
        times = np.geomspace(10e-9, 10e-3, 600)
        data = th.solve(self.heat, th.Constant(1.0), times, heated=self.row["heated"], read=self.row["read"])
        return times, data.delta_T.values / self.resistance

    def reached(self, share: float) -> float:
        """Time after which the step has that share of its last value, s."""
        times, rise = self.step
        return float(np.exp(np.interp(share, rise, np.log(times))))

    def trained(self, period: float) -> Any:
        wave = th.SquareWave(2e-3, period, 0.33)
        return th.solve_periodic(self.heat, wave, heated=self.row["heated"], read=self.row["read"])

    def pi_power(self) -> float:
        """λ / (2 L dn/dT R_th), mW."""
        length = quantity.parse(self.row["length"], "m")
        return 1e3 * WAVELENGTH / (2 * length * self.row["dn_dT"] * self.resistance)

    def time(self) -> float:
        return 1e6 * self.reached(1 - np.exp(-1))

    def rise_time(self) -> float:
        return 1e6 * (self.reached(0.9) - self.reached(0.1))

    @cached_property
    def reduced(self) -> Any:
        heated, read = self.row["heated"], self.row["read"]
        return surrogate.reduce(self.heat.channels(heated, (read,)), tolerance=1e-4).model

    def bandwidth(self) -> float:
        """-3 dB of the temperature, as of an electrical signal, kHz."""
        return 1e-3 * th.MZI().bandwidth(self.reduced, decibels="electrical")

    def light_bandwidth(self) -> float:
        """-3 dB of the optical power, kHz."""
        return 1e-3 * th.MZI().bandwidth(self.reduced)

    def edges(self, half_period: str) -> th.readout.EdgeTimes:
        """Times of the light behind an interferometer whose phase swings as `drive` of the row says."""
        drive, half = self.row["drive"], quantity.parse(half_period, "s")
        shift = np.pi * drive["swing"] / self.resistance
        mzi = th.MZI(bias=np.pi * drive["bias"], shift=shift)
        return mzi.edge_times(self.reduced, th.SquareWave(1.0, 2 * half, 0.5))

    def tuning(self) -> float:
        """Shift of a resonance, λ/n_g dn/dT R_th, nm/mW."""
        return 1e9 * WAVELENGTH / GROUP_INDEX * self.row["dn_dT"] * self.resistance * 1e-3

    def settling(self) -> float:
        """Time between 10 and 90 % of the way after a plain step, ns."""
        return 1e3 * self.rise_time()

    def pulsed(self, factor: float) -> float:
        """Time in ns after which a power that is ``factor`` times the last one has brought the last temperature."""
        return 1e9 * self.reached(1 / factor)

    def removed_near(self) -> float:
        return self.removed("near")

    def removed_far(self) -> float:
        return self.removed("far")

    def removed(self, read: str) -> float:
        """Phase in rad that the trench keeps from another guide."""
        kept = self.heat.thermal_resistance(self.row["heated"], read)
        power, length = quantity.parse(self.row["power"], "W"), quantity.parse(self.row["length"], "m")
        without = self.whole.thermal_resistance(self.row["heated"], read) - kept
        return 2 * np.pi * length / WAVELENGTH * self.row["dn_dT"] * power * without

    @cached_property
    def corners(self) -> list[float]:
        """Corner frequencies of two poles fitted to 150 us of a step, kHz."""
        times = np.linspace(0, 150e-6, 3000)
        data = th.solve(self.heat, th.Constant(1e-3), times, heated=self.row["heated"], read=self.row["read"])
        return sorted(1e-3 / (2 * np.pi * np.array(surrogate.fit_foster(data, 2).model.tau)))

    def slow_corner(self) -> float:
        return self.corners[0]

    def fast_corner(self) -> float:
        return self.corners[1]

    @cached_property
    def whole(self) -> th.fem.HeatProblem:
        """The section without its voids."""
        parts = tuple(p for p in self.geometry.parts if p.material != "void")
        return th.assemble(replace(self.geometry, parts=parts), accuracy=5e-3)

    def undercut(self) -> float:
        return self.resistance / self.whole.thermal_resistance()

    def newton(self) -> float:
        return 1e9 * surrogate.fit_newton(self.trained(0.8e-6)).parameters["tau_th"]

    def slow(self) -> float:
        return 1e9 * surrogate.fit_second_order(self.trained(1e-6)).parameters["tau_s"]

    def fast(self) -> float:
        return 1e9 * surrogate.fit_second_order(self.trained(1e-6)).parameters["tau_f"]

    def figure(self, kind: str) -> float:
        """One figure in the unit of its row."""
        return 1e-3 * self.resistance if kind == "resistance" else float(getattr(self, kind)())


def light(row: dict[str, Any], figure: dict[str, Any]) -> tuple[float, float, float]:
    """A dynamic figure with its read-out: as named in the row, and the ends of what is plausible."""
    if figure["kind"] == "settling":
        device, pulse = Device(row), row["pulse"]
        values = [device.pulsed(factor) for factor in (pulse["factor"], *pulse["plausible"])]
    elif figure["kind"] == "bandwidth":
        named = Device(row, figure["light_at"]) if "light_at" in figure else Device(row)
        ends = Device(row), Device(row, row["vary"]["from"]), Device(row, row["vary"]["to"])
        values = [device.light_bandwidth() for device in (named, *ends)]
    else:
        edge = ("rise" if "ris" in figure["what"] else "fall") + ("_10_90" if figure["kind"] == "rise_time" else "")
        device, drive = Device(row), row["drive"]
        values = [1e6 * getattr(device.edges(h), edge) for h in (drive["half_period"], *drive["plausible"])]
    return values[0], min(values), max(values)


def computed(row: dict[str, Any]) -> dict[str, tuple[float, float, float]]:
    """Every figure of a device by its kind: as its file has it, and with the unknown at either end."""
    devices = [Device(row), Device(row, row["vary"]["from"]), Device(row, row["vary"]["to"])]
    kinds = dict.fromkeys(figure["kind"] for figure in row["figure"])
    found = {kind: [device.figure(kind) for device in devices] for kind in kinds}
    return {kind: (mine, min(values), max(values)) for kind, values in found.items() for mine in values[:1]}


def cloud(path: Path) -> None:
    """Draw pi power against time constant: shifters of the review, and ours by heat alone and as light reads it."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    published = np.array([[one["pi_power"], one["time"]] for one in SHIFTERS])
    x = np.array([0.3, 100])
    for product in (30, 100, 300, 1000):
        axes.plot(x, product / x, color="0.85", zorder=0)
        axes.annotate(f"{product} mW µs", (28, product / 28), color="0.45", fontsize=8, va="bottom")
    axes.plot(*published.T, "o", color="0.3", label="published")
    labels: tuple[str | None, str | None] = ("computed, heat alone", "computed, heat and read-out")
    for row in DEVICES:
        own = {figure["kind"]: figure for figure in reversed(row["figure"])}
        if "pi_power" in own and "time" in own:
            power, times = own["pi_power"]["ours"], [own["time"][key] for key in ("ours", "light")]
            axes.plot([power, power], times, color="C0", lw=0.8)
            for time, face, label in zip(times, ("white", "C0"), labels, strict=True):
                axes.plot(power, time, "s", color="C0", mfc=face, label=label)
            labels = (None, None)
    axes.set(xscale="log", yscale="log", xlim=x, ylim=(1, 300), xlabel="π power, mW", ylabel="time constant, µs")
    axes.legend(loc="lower left", frameon=False)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    if "figure" in sys.argv:
        cloud(ROOT / "docs" / "images" / "shifters.png")
        sys.exit()
    for row in DEVICES:
        print(row["name"])
        for kind, (ours, low, high) in computed(row).items():
            print(f"  {kind}: {ours:.4g}, {low:.4g} to {high:.4g}")
        for figure in row["figure"]:
            if "light" in figure:
                print(f"  {figure['what']} behind its read-out:", *(f"{value:.4g}" for value in light(row, figure)))
