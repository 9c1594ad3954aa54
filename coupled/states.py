"""The state of a ring at one time (field, carriers, heat), from which a run can continue."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, ArrayLike

if TYPE_CHECKING:
    import xarray as xr


SAME = 1e-6  # relative difference of time constants that were computed twice


@dataclass(frozen=True, eq=False)
class State:
    """Field, carriers and thermal states at one moment.

    Parameters
    ----------
    field : complex, sqrt(J)
        a, with |a|^2 the stored energy, in the phase of the light that comes in.
    carriers : float, 1/m^3
        N.
    thermal : array, shape (n,), K
        the states of the thermal model: of a Foster network the rise over each R_i, whose sum is the rise.
    """

    field: complex
    carriers: float
    thermal: ArrayLike

    def __post_init__(self) -> None:
        checks.plain(self)
        value = complex(self.field)
        size = math.hypot(value.real, value.imag)
        hint = "fields are in sqrt(J); 20 fJ is 1.4e-7"
        checks.between("field energy", size * size, 0, 1e-9, unit="J", hint=hint)
        checks.between("carriers", self.carriers, 0, 1e28, unit="1/m^3", hint="1e17 cm^-3 is 1e23")
        object.__setattr__(self, "field", value)
        checks.keep(self, thermal=checks.array("thermal", self.thermal))

    @classmethod
    def cold(cls, order: int) -> State:
        """No light, no carriers and no heat, for a thermal model of ``order`` states."""
        return cls(0.0, 0.0, np.zeros(order))

    @classmethod
    def end_of(cls, run: xr.Dataset) -> State:
        """Where a run of `simulate` ended."""
        return cls.from_array(final_state(run))

    @classmethod
    def from_array(cls, values: Array) -> State:
        """Inverse of `as_array`; a carrier density that round-off left below 0 becomes 0."""
        checks.enough("final_state", values.size, 4, "numbers")
        return cls(complex(values[0], values[1]), max(float(values[2]), 0.0), values[3:])

    @property
    def energy(self) -> float:
        """|a|^2 in J."""
        return abs(self.field) ** 2

    def as_array(self) -> Array:
        """[Re a, Im a, N, x_1 .. x_n] in SI."""
        return np.array([self.field.real, self.field.imag, self.carriers, *np.asarray(self.thermal)])


def starting_point(
    initial: State | xr.Dataset | None, order: int, tau: ArrayLike | None = None, coefficient: float = 0.0
) -> State:
    """The state a run begins with: cold, given, or where another run ended.

    tau [s], coefficient [1/K]: of the model and its output map, which must be those of the other run.
    """
    if initial is None:
        return State.cold(order)
    state = initial if isinstance(initial, State) else State.end_of(initial)
    if np.size(state.thermal) != order:
        raise checks.InputError(
            f"initial has {np.size(state.thermal)} thermal states and the model {order}; "
            "go on with the model that the run was made with"
        )
    if not isinstance(initial, State) and tau is not None:
        before = initial.attrs.get("model_tau")
        check_same_heat(before, tau)
        kept = checks.finite("initial.attrs['model_coefficient']", initial.attrs.get("model_coefficient", 0.0))
        if before is not None and abs(kept - coefficient) > SAME * abs(coefficient):
            raise checks.InputError(
                f"initial was made with an output map of {kept:.4g} 1/K, and the model has {coefficient:.4g} 1/K: its "
                "temperature would jump; go on with that model, or give a coupled.State"
            )
    return state


def final_state(run: xr.Dataset, tau: ArrayLike | None = None, size: int | None = None) -> Array:
    """The state at the end of a run in SI; InputError where it has none, or is not of this size and these poles."""
    if "final_state" not in getattr(run, "attrs", {}):
        raise checks.InputError("initial has no final_state; give a Dataset from coupled.simulate, or a State")
    values = checks.array("initial.attrs['final_state']", run.attrs["final_state"])
    if size not in (None, values.size):
        raise checks.InputError(f"initial has {values.size} states and not {size}; go on with the same rings and model")
    if tau is not None:
        check_same_heat(run.attrs.get("model_tau"), tau)
    return values


def check_same_heat(before: ArrayLike | None, tau: ArrayLike) -> None:
    """InputError where a run to go on from had other time constants [s]; one that states none is believed."""
    if before is None:
        return
    kept, own = checks.array("initial.attrs['model_tau']", np.ravel(before)), np.ravel(tau)
    if kept.shape != own.shape or not np.allclose(kept, own, rtol=SAME, atol=0):
        raise checks.InputError(
            f"initial was made with other time constants ({kept[0]:.4g} s, ..) than the model ({own[0]:.4g} s, ..): "
            "its thermal states do not belong to it; go on with that model, or give a coupled.State"
        )
