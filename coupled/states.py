"""State of a ring (field, carriers, heat) from which a run can continue."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, ArrayLike

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class State:
    """State of a ring at one time: field, carriers and thermal states.

    Parameters
    ----------
    field : complex, sqrt(J)
        a, with |a|^2 the stored energy; its phase is relative to that of the incoming light.
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
        """The state without light, carriers and heat, for a thermal model of ``order`` states."""
        return cls(0.0, 0.0, np.zeros(order))

    @classmethod
    def end_of(cls, run: xr.Dataset) -> State:
        """The final state of a run of `simulate`."""
        return cls.from_array(final_state(run))

    @classmethod
    def from_array(cls, values: Array) -> State:
        """Construct a State from the array of `as_array`; negative carrier densities (round-off) become 0."""
        return cls(complex(values[0], values[1]), max(float(values[2]), 0.0), values[3:])

    @property
    def energy(self) -> float:
        """Stored energy |a|^2 in J."""
        return abs(self.field) ** 2

    def as_array(self) -> Array:
        """The state as an array [Re a, Im a, N, x_1 .. x_n], shape (3 + n,), in SI."""
        return np.array([self.field.real, self.field.imag, self.carriers, *np.asarray(self.thermal)])


def starting_point(initial: State | xr.Dataset | None, order: int, known: Mapping[str, Any] | None = None) -> State:
    """Initial state of a run: zero by default, a given State, or the final state of a Dataset.

    known: as of `final_state`.
    """
    if initial is None:
        return State.cold(order)
    if not isinstance(initial, State):
        return State.from_array(final_state(initial, 3 + order, known))
    checks.shape("initial.thermal", np.asarray(initial.thermal), (order,))
    return initial


def final_state(run: xr.Dataset, size: int | None = None, known: Mapping[str, Any] | None = None) -> Array:
    """State at the end of a run, [Re a, Im a, N, x_1 .. x_n] in SI, shape (3 + n,).

    size, known: number of states and `thermal.attributes` of the model that continues the run; None for any.
    Raises InputError: no state, or another number of them; other time constants or another output map than those of
        the model, whose temperature would be discontinuous.
    """
    attrs, hint = getattr(run, "attrs", {}), "give a Dataset from coupled.simulate, or a coupled.State"
    values = checks.array("initial.attrs['final_state']", attrs.get("final_state", ()), hint=hint)
    checks.shape("initial.attrs['final_state']", values, (size or values.size,))
    if known and "model_tau" in known and "model_tau" in attrs:
        kept = np.append(attrs["model_tau"], attrs.get("model_coefficient", 0.0))
        own = np.append(known["model_tau"], known.get("model_coefficient", 0.0))
        # time constants that were computed twice may differ by 1e-6
        if kept.shape != own.shape or not np.allclose(kept, own, rtol=1e-6, atol=0):
            raise checks.InputError(
                f"initial was made with other time constants ({kept[0]:.4g} s, ..) or another output map "
                f"than the model ({own[0]:.4g} s, ..): its thermal states do not belong to it; go on with that model, "
                "or give a coupled.State"
            )
    return values
