"""Where a co-simulation begins: cold, where another one ended, or on the settled cycle of a compact model.

A cycle is lifted to the mesh: the field is periodic under the power that the cycle absorbs. In the fields V of the
FEM's own reduction the periodic state is closed form; the full-order FEM advances all of it for a period, and

    x(0) <- x(T) + V diag(m/(1 - m)) V^T E [x(T) - x(0)],     m = exp(-rate T)

takes the slow fields to where all later periods would. One period does for constant conductivities; with k(T) and
c_p(T) the periods go on until the temperature repeats.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import Quadratic, checks
from thermofem.algebra.pole_responses import cubic_pole_responses
from thermofem.arrays import Array
from thermofem.data.variables import contents, in_si
from thermofem.solving import mesh_hash
from thermofem.waveforms import Cubic

from ..states import State
from ..thermal import Compact
from .corrector import FEM

if TYPE_CHECKING:
    import xarray as xr


PERIODS = 6  # of the FEM alone, at most
ENOUGH = 0.3  # of the largest discrepancy, that the temperature may still change in a period
KINDS = "a run of coupled.cosimulate with the same heat, or a cycle of coupled.limit_cycle"


class Beginning(NamedTuple):
    """State of light, carriers and predictor, and the temperature of the corrector in K."""

    state: State
    rise: float


def beginning(initial: xr.Dataset | None, corrector: Any, model: Compact) -> Beginning:
    """Put the corrector where the run begins.

    Raises
    ------
    InputError
        neither a run nor a cycle, one of another mesh, or a corrector that is not the FEM.
    """
    if initial is None:
        if isinstance(corrector, FEM) and corrector.state.time > 0:
            raise checks.InputError(
                "heat is a coupled.FEM that made a run before and is still hot; give initial= that run, or a new one"
            )
        return Beginning(State.cold(model.order), 0.0)
    attrs, variables = getattr(initial, "attrs", {}), getattr(initial, "variables", {})
    if not isinstance(corrector, FEM):
        raise checks.InputError("initial goes with a HeatProblem or matrices; a corrector of your own keeps its state")
    if "final_light" in attrs and "final_rise" in variables:
        light = checks.array("initial.attrs['final_light']", attrs["final_light"])
        if light.size != 3:
            raise checks.InputError(f"initial.attrs['final_light'] has {light.size} numbers; 3 are needed")
        field = checks.array("initial['final_rise']", in_si("initial", initial)["final_rise"].values)
        n = corrector.linear.order
        if field.shape != (n,):
            raise checks.InputError(f"initial has {field.size} temperatures and heat {n}; go on with the same mesh")
        own = mesh_hash(corrector.problem.mesh) if corrector.problem is not None else ""
        if own and str(attrs.get("mesh_hash", own)) != own:
            raise checks.InputError("initial was made on another mesh, of as many temperatures; go on with the same")
        corrector.begin(field)
        states = None
    elif "pulses" in attrs and "final_state" in attrs:
        initial = contents("initial", initial, ("absorbed", "time"), what=KINDS)
        first = State.end_of(initial).as_array()
        light, states = first[:3], first[3:]
        corrector.begin(_lifted(initial, corrector))
    else:
        raise checks.InputError(f"initial is a {type(initial).__name__} that is neither of these: {KINDS}")
    at = State(complex(light[0], light[1]), max(float(light[2]), 0.0), _predicted(corrector, model, states))
    return Beginning(at, corrector.rise)


def _predicted(corrector: FEM, model: Compact, states: Array | None) -> Array:
    """States of the predictor: the FEM's own reduction holds its fields, a model of the cycle's order the cycle's."""
    if model is corrector.predictor:
        if isinstance(model, Quadratic):
            return np.asarray(corrector.state.z)
        fields = (corrector.linear.C[0] @ corrector.basis.vectors) * corrector.state.z
        return np.asarray(fields[np.argsort(1 / corrector.basis.rate)])
    if states is not None and states.size == model.order:
        return states
    return np.zeros(model.order)


def _lifted(cycle: xr.Dataset, fem: FEM) -> Array:
    """The field at the start of a cycle, K."""
    from scipy.interpolate import CubicSpline

    time = checks.array("initial['time']", cycle["time"].values, increasing=True)
    power = np.array(checks.array("initial['absorbed']", cycle["absorbed"].values))
    power[-1] = power[0]
    wave = Cubic(time, power, CubicSpline(time, power, bc_type="periodic")(time, 1))
    period, basis, C = float(time[-1]), fem.basis, fem.linear.C
    if not np.isclose(period, float(cycle.attrs["period"]), rtol=1e-6, atol=0):
        raise checks.InputError(f"initial['time'] ends at {period:g} s; a whole cycle has {cycle.attrs['period']:g} s")
    E = fem.linear.E
    z = cubic_pole_responses(basis.rate, *wave.pieces(0.0, period), np.zeros(1), periodic=True)[0] * basis.heating[:, 0]
    field = basis.vectors @ z
    shrink = np.exp(-basis.rate * period)
    for _ in range(PERIODS):
        fem.begin(field)
        fem.advance(time.copy(), wave)
        end = fem.tried
        change = end - field
        field = end + basis.vectors @ (shrink / (1 - shrink) * (basis.vectors.T @ (E @ change)))
        if np.abs(C @ change).max() <= ENOUGH * fem.max_discrepancy:
            break
    return np.asarray(field)
