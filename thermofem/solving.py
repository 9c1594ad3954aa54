"""Training data from a heat problem and a waveform of the heating power."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from . import checks
from .data import dataset
from .fem.heat_problem import HeatProblem
from .models import StateSpace
from .transient.integration import Trajectory, check_run, integrate, integrate_periodic
from .waveforms import Waveform, check_heating, check_wave, period_times

if TYPE_CHECKING:
    from .mesh import Mesh


log = logging.getLogger("thermofem")

# of a run, in the attributes of its data
NUMBERS = ("method", "steps", "factorizations", "solves", "heat_in", "heat_stored", "heat_out")


def solve(
    heat: HeatProblem,
    wave: Waveform,
    times: ArrayLike,
    *,
    heated: str | None = None,
    read: str | Sequence[str] | None = None,
    rtol: float = 1e-4,
    field_times: ArrayLike = (),
    method: str = "auto",
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Full-order transient from rest.

    Powers that are straight lines between their breakpoints are solved in closed form on a few fields of the mesh,
    whose number grows until the solution converges (`transient.modal`); others, and conductivities or heat capacities
    that depend on temperature, are stepped with error control (`transient.integration`).

    Parameters
    ----------
    heat : HeatProblem
    wave : Waveform
        absorbed power in W, switched on at t = 0.
    times : array, s
        increasing, not negative; the run lands on every edge of the waveform whether or not it is listed.
    heated : str
        the part that carries the power; default the first heated one.
    read : str or sequence of str
        what is read; default the heated part. A sequence gives ``delta_T`` a dimension ``probe``.
    rtol : float
        error in time relative to the largest rise so far, see `transient.integrate`; the mesh adds its own
        ``heat.accuracy``. Of a probe that the heat has hardly reached it is relative to a tenth of what the field so
        far would mean there in the steady state; relative to its own value the error of such a probe is not bounded.
    field_times : array, s
        times at which the whole field is kept.
    method : "auto" or "stepping"
        "stepping" takes the integrator where the closed form would do: slower, and an independent check.
    progress : callable, optional
        called with the time in s that has been reached, after each step of the integrator; in closed form, at the end.

    Returns
    -------
    Dataset
        schema of `thermofem.dataset`: delta_T (K), power (W) over time (s); with ``field_times`` also field (K).

    Raises
    ------
    InputError
        unknown names, times that do not increase, rtol out of range.

    >>> data = solve(assemble(strip_ring()), Pulse(power=2e-3, width=20e-6), times=[1e-6, 20e-6, 21e-6])
    >>> data.delta_T.round(1).values
    array([ 9.2, 15.4,  6.2])
    """
    return _solved(heat, wave, times, heated, read, rtol, method, progress, field_times)


def solve_periodic(
    heat: HeatProblem,
    wave: Waveform,
    samples: int = 301,
    *,
    heated: str | None = None,
    read: str | Sequence[str] | None = None,
    rtol: float = 1e-4,
    method: str = "auto",
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """One period of the full-order periodic state, both ends and every edge of the waveform among the samples.

    Parameters
    ----------
    heat : HeatProblem
    wave : Waveform
        with a period, as `SquareWave`.
    samples : int
    heated, read, rtol, method
        as in `solve`.
    progress : callable, optional
        as in `solve`, with the time that all passes over the period together have covered; the integrator takes six to
        eight as a rule, the closed form one.

    Returns
    -------
    Dataset
        as of `solve`, with ``kind = "periodic"`` and time from 0 to the period.

    Raises
    ------
    InputError
        a waveform without a period, too few samples for its edges.
    """
    times = period_times(wave, samples)
    return _solved(heat, wave, times, heated, read, rtol, method, progress, (), periodic=True)


def _solved(
    heat: HeatProblem,
    wave: Waveform,
    times: ArrayLike,
    heated: str | None,
    read: str | Sequence[str] | None,
    rtol: float,
    method: str,
    progress: Callable[[float], None] | None,
    field_times: ArrayLike,
    *,
    periodic: bool = False,
) -> xr.Dataset:
    """Solve a transient, in closed form if possible, and return it with its provenance as a Dataset."""
    check_wave("wave", wave)
    checks.choice("method", method, ("auto", "stepping"))
    heated = checks.choice("heated", heated, heat.heated, default=heat.heated[0])
    read = heated if read is None else read
    system = heat.model(heated, read)
    ledger = heat.audit(heated)
    run = None
    if method == "auto" and isinstance(system, StateSpace):
        run = heat.modal(heated).run(
            system.C, wave, times, rtol=rtol, ledger=ledger, snapshots=field_times, periodic=periodic
        )
    if run is None:
        t, kept = check_run(times, field_times, rtol)
        check_heating(wave, max([t[-1], *kept]))
        options: dict[str, Any] = {"rtol": rtol, "ledger": ledger, "progress": progress}
        options["factors"] = heat.discretization.factors
        if periodic:
            run = integrate_periodic(system, wave, t.size, **options)
        else:
            run = integrate(system, wave, t, snapshots=kept, **options)
    elif progress:
        progress(float(run.times[-1]))
    single = isinstance(read, str)
    names = (read,) if isinstance(read, str) else tuple(read)
    attributes = _provenance(heat, run, heated, names[0] if single else heated, rtol) | heat.stated_mode(names)
    if beyond := heat.geometry.beyond_laws(float(run.outputs.max())):
        log.warning(beyond)
        attributes["warning"] = beyond
    if not single:
        attributes["thermal_resistances"] = [heat.thermal_resistance(heated, name) for name in names]
    rises = run.outputs[:, 0] if single else run.outputs
    data = dataset.build(run.times, rises, wave, periodic=periodic, read=names, attributes=attributes)
    return data.merge(fields(heat, run.snapshots, field_times)) if np.size(field_times) else data


def described(heat: HeatProblem, heated: str, read: str) -> dict[str, Any]:
    """Attributes of a Dataset: R_th of a channel in K/W, geometry, mesh and materials of a heat problem."""
    materials = [heat.geometry.material_of(name) for name in heat.regions]
    sources = {material.name: material.source for material in materials}
    return {
        "heated": heated,
        "thermal_resistance": heat.thermal_resistance(heated, read),
        "geometry": heat.geometry.to_toml(),
        "mesh_hash": mesh_hash(heat.mesh),
        "accuracy": heat.accuracy,
        "materials": json.dumps(sources),
    }


def _provenance(heat: HeatProblem, run: Trajectory, heated: str, read: str, rtol: float) -> dict[str, Any]:
    """Provenance of the data: that of the heat problem, solver, energy balance."""
    mesh_error, domain_error = heat.errors(heated, read)
    numbers = {name: getattr(run, name) for name in NUMBERS}
    return {
        **described(heat, heated, read),
        "discretization_error": mesh_error,
        "domain_error": domain_error,
        "temperature_dependent": int(heat.nonlinear),
        "unknowns": heat.unknowns,
        "rtol": rtol,
        **numbers,
        "heat_imbalance": run.imbalance,
    }


def mesh_hash(mesh: Mesh) -> str:
    """Twelve hexadecimal digits of the mesh's points, triangles and regions."""
    content = hashlib.sha256()
    for array in (mesh.points, mesh.triangles, mesh.region):
        content.update(np.ascontiguousarray(array).tobytes())
    return content.hexdigest()[:12]


def fields(heat: HeatProblem, states: ArrayLike, field_times: ArrayLike) -> xr.Dataset:
    """Dataset of temperature fields on the mesh's vertices, from states of shape (times, unknowns)."""
    r, z = heat.mesh.points.T
    times = np.atleast_1d(np.asarray(field_times, dtype=float))
    variables = {
        "field": (("field_time", "vertex"), heat.field(states), dataset.describe("delta_T")),
        "triangles": (("triangle", "corner"), heat.mesh.triangles),
    }
    coordinates = {
        "field_time": ("field_time", times, dataset.describe("time")),
        "r": ("vertex", r, dataset.describe("r")),
        "z": ("vertex", z, dataset.describe("z")),
    }
    return xr.Dataset(variables, coordinates)
