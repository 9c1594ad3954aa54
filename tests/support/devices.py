"""Figures of published devices, computed from the geometry files of docs/measured.

python tests/devices.py        prints the figures of every device of docs/measured.toml
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from paths import ROOT

import surrogate
import thermofem as th
import thermofem.readout
from thermofem.data import quantity

MEASURED = ROOT / "docs" / "measured.toml"
DEVICES: list[dict[str, Any]] = tomllib.loads(MEASURED.read_text(encoding="utf-8"))["device"]
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

    def undercut(self) -> float:
        whole = replace(self.geometry, parts=tuple(p for p in self.geometry.parts if p.material != "void"))
        return self.resistance / th.assemble(whole, accuracy=5e-3).thermal_resistance()

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
    if figure["kind"] == "bandwidth":
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


if __name__ == "__main__":
    for row in DEVICES:
        print(row["name"])
        for kind, (ours, low, high) in computed(row).items():
            print(f"  {kind}: {ours:.4g}, {low:.4g} to {high:.4g}")
        for figure in row["figure"]:
            if "light" in figure:
                print(f"  {figure['what']} behind its read-out:", *(f"{value:.4g}" for value in light(row, figure)))
