"""A closed orbit as a Dataset, in SI."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem.data import dataset

from ..equilibria.observables import provenance
from .closing import Settled, nontrivial
from .measures import measure
from .orbit import CycleProblem, Orbit
from .scheme import scheme

if TYPE_CHECKING:
    import xarray as xr

UNSTABLE = 1 + 1e-9  # of a multiplier; they are exact to a few 1e-10


def dataset_of(p: CycleProblem, found: Settled) -> xr.Dataset:
    """Return what `limit_cycle` returns."""
    import xarray as xr

    from ..kernels import equations as eq
    from ..kernels import orbit_mesh

    orbit, ring = found.orbit, p.ring
    s = orbit.Y.shape[1]
    at = np.concatenate([[0.0], orbit_mesh.stages(orbit.tau, scheme().c)])
    states = np.concatenate([orbit.start[None], orbit.Y.reshape(-1, orbit.start.size)])
    seen = orbit_mesh.look(orbit.start, orbit.Y, orbit.tau, p.at, scheme(), at)
    U, N, field = seen[:, 0], states[:, 2], states[:, 0] + 1j * states[:, 1]
    weight = np.concatenate([[0.0], (np.diff(orbit.tau)[:, None] * scheme().A[-1]).ravel()]) * orbit.T * eq.NS
    into = np.sqrt(p.power / eq.UW)
    values = {
        "energy": U * eq.FJ,
        "carriers": N * eq.DENSITY,
        "delta_T": seen[:, 2] + p.rise,
        "drop": 2 * ring.drop_bus_rate * U * eq.FJ,
        "through": np.abs(into + 1j * np.sqrt(2 * ring.bus_rate * eq.NS) * field) ** 2 * eq.UW,
        "absorbed": eq.absorbed_power(U, N, p.at.rates) * eq.UW,
    }
    if ring.scattering_rate > 0:
        values["scattered"] = 2 * ring.scattering_rate * U * eq.FJ
    variables: dict[str, Any] = {name: ("time", v, dataset.describe(name)) for name, v in values.items()}
    variables["weight"] = ("time", weight, {"units": "s", "long_name": "weight of an integral over the period"})
    variables["states"] = (
        ("time", "state"), states * p.units, {"units": "mixed", "long_name": "Re a, Im a, N, states of heat"},
    )  # fmt: skip
    variables["multipliers"] = ("multiplier", orbit.multipliers, {"units": "1", "long_name": "Floquet multipliers"})
    attrs = provenance("limit cycle", ring, p.model) | {"input_power": p.power, "detuning": p.detuning}
    attrs |= _numbers(p, found) | {"mesh": orbit.tau, "stages": s}
    time = ("time", at * orbit.T * eq.NS, dataset.describe("time"))
    return xr.Dataset(variables, coords={"time": time}, attrs=attrs)


def _numbers(p: CycleProblem, found: Settled) -> dict[str, Any]:
    """Attributes of a cycle: period, measures, settling time, and stability in words."""
    orbit, measured = found.orbit, measure(p, found.orbit)
    period = orbit.T * 1e-9
    kind, worst = stability(orbit)
    size = abs(worst)
    settling = period / -np.log(size) if 0 < size < 1 else 0.0 if size == 0 else np.inf
    words = {
        "stable": f"a deviation shrinks to {size:.3g} of itself in a period",
        "doubled": f"the pulses alternate: a multiplier of {worst.real:.4g} lies below -1",
        "unstable": f"a deviation grows by {size:.4g} in a period",
    }[kind]
    if found.pulses > 1:
        words += f"; {found.pulses} pulses in a period"
    if found.rough:
        words += "; no mesh resolves its steepest pulse, so the period is known to 1e-5 only"
    return {
        "period": period, "duty": measured.duty, "swing": measured.swing, "extinction": measured.extinction,
        "settling_time": float(settling), "stability": kind, "pulses": found.pulses, "reason": words,
    }  # fmt: skip


def stability(orbit: Orbit) -> tuple[str, complex]:
    """The kind of a cycle, and the largest multiplier but the trivial one."""
    others = nontrivial(orbit)
    if others.size == 0:
        return "stable", 0j
    worst = complex(others[np.argmax(np.abs(others))])
    if abs(worst) < UNSTABLE:
        return "stable", worst
    return ("doubled" if worst.real < -1 and worst.imag == 0 else "unstable"), worst
