"""A thermal model is data: absorbed power in (W), mode-averaged temperature rise out (K).

Contract of a `ThermalModel`. Every function that takes a model takes any object that satisfies it:

1. ``model.inputs`` and ``model.outputs`` name the heated parts and the read ones.
2. ``model.thermal_resistance`` is the static gain R_th in K/W (at small power, where the model is not linear).
3. ``model.step_response(times)`` is the rise per watt after a step at t = 0, in K/W, shape of ``times``, which stand in
   any order; 0 before t = 0.
4. ``model.impedance(frequency)`` is the complex thermal impedance Z(f) in K/W, shape of ``frequency`` in Hz.
5. ``model.response(wave, times)`` is the rise in K under ``wave`` switched on at t = 0 from rest, shape of ``times``,
   which stand in any order from t = 0 on.
6. ``model.periodic_response(wave, samples)`` is one period of the periodic state in K, at
   `waveforms.period_times(wave, samples)`.
7. ``model.dynamics`` is the same model in the form that is integrated with the optics: a `Foster` network, an
   `OutputMap` over a Foster network, or a `Quadratic` system. A model without such a form, such as the FEM itself,
   raises InputError there and says what to use instead.

Adding a model: write a function that returns one of these kinds, and add it to the list in tests/support/models.py. A
new kind is a class that satisfies the contract, one file in this folder with one line of `thermofem.models.KINDS`.
"""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import wraps
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from .. import checks, waveforms
from ..arrays import Array, ArrayLike, Complex


def at_times(run: Callable[[Array], Array], times: ArrayLike) -> Array:
    """Call ``run`` with sorted times and return its values in the order and shape of ``times``."""
    t = checks.numbers("times", times)
    if t.ndim == 1 and not (np.diff(t) < 0).any():
        return run(t)
    order = np.argsort(t, axis=None, kind="stable")
    found = np.empty(t.size)
    found[order] = run(checks.array("times", t.ravel()[order]))
    return found.reshape(t.shape)


class ThermalModel(Protocol):
    """Power in, temperature rise out; help(thermofem.models.contract) lists what holds for every model."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the heated parts."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the read parts."""

    @property
    def thermal_resistance(self) -> float:
        """Static gain R_th in K/W."""

    def step_response(self, times: ArrayLike) -> Array:
        """Rise in K/W after a unit step."""

    def impedance(self, frequency: ArrayLike) -> Complex:
        """Z(f) in K/W."""

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest."""

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K."""

    @property
    def dynamics(self) -> Any:
        """The model as a Foster network, an OutputMap or a Quadratic system."""


class Delegates(ABC):
    """A thermal model whose properties and responses are those of another model, ``_other``."""

    @property
    @abstractmethod
    def _other(self) -> Any:
        """The other model."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the heated parts."""
        return self._other.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the read parts."""
        return self._other.outputs

    @property
    def order(self) -> int:
        """Number of states."""
        return self._other.order

    @property
    def thermal_resistance(self) -> float:
        """Static gain R_th in K/W (at small power)."""
        return self._other.thermal_resistance

    def step_response(self, times: ArrayLike) -> Array:
        """Rise in K/W after a step (of small power)."""
        return self._other.step_response(times)

    def impedance(self, frequency: ArrayLike) -> Complex:
        """Z(f) in K/W (at small power)."""
        return self._other.impedance(frequency)

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest."""
        return self._other.response(wave, times)

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K."""
        return self._other.periodic_response(wave, samples)


class AtSmallPower(Delegates):
    """Base class of nonlinear models; static gain, step response and impedance are those of ``linear``."""

    linear: Any

    @property
    def _other(self) -> Any:
        return self.linear


class HasModel(Delegates):
    """Base class of results that hold a thermal model, such as a fit or a reduction, and can be used as that model.

    Every method of the contract is passed on to ``self.model``.
    """

    model: Any

    @property
    def _other(self) -> Any:
        return self.model

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Origin of the model; a model file keeps it."""
        return getattr(self, "origin", None) or {}

    def recorded(self) -> Self:
        """The same result, whose model has the provenance as its origin."""
        return replace(self, model=replace(self.model, origin=self.provenance))  # type: ignore[type-var]

    @property
    def dynamics(self) -> Any:
        """The model in the form that is integrated with the optics."""
        return self.model.dynamics


def bare(model: Any) -> Any:
    """The model inside a fit or a reduction; any other model unchanged."""
    return bare(model.model) if isinstance(model, HasModel) else model


def check_single(system: Any) -> None:
    """Raise InputError unless the system has one input and one output."""
    if (len(system.inputs), len(system.outputs)) != (1, 1):
        raise checks.InputError(
            f"inputs {system.inputs} and outputs {system.outputs}: pick one of each with .channel(heated, read)"
        )


class OutsideTrainingWarning(UserWarning):
    """A response exceeds the largest temperature rise of the model's training."""


def warn_beyond(rise: Array, trained: float | None) -> Array:
    """``rise``, unchanged; OutsideTrainingWarning where it far exceeds that of the training (None: not known)."""
    # 1.2: a rise this far above the training's largest draws a warning
    if trained is not None and np.max(rise, initial=0.0) > 1.2 * trained:
        text = f"the model is asked for a rise of {rise.max():.3g} K; its training reached {trained:.3g} K"
        warnings.warn(text, OutsideTrainingWarning, stacklevel=3)
    return rise


def check_rise(value: float | None) -> None:
    """Raise InputError unless ``value`` is a positive rise in K, or None."""
    if value is not None:
        checks.positive("largest_rise", value, unit="K")


Kind = TypeVar("Kind")


def reader(read: Callable[[type[Kind], Mapping[str, Any]], Kind]) -> Callable[[type[Kind], Mapping[str, Any]], Kind]:
    """Decorator of a method ``from_json``: content of another layout raises InputError."""

    @wraps(read)
    def checked(cls: type[Kind], content: Mapping[str, Any]) -> Kind:
        try:
            return read(cls, content)
        except (KeyError, TypeError, AttributeError, IndexError) as error:
            what = f"there is no {error}" if isinstance(error, KeyError) else error
            raise checks.InputError(f"it is not laid out as docs/models.md says: {what}") from None

    return checked


def keep_names(model: Any, *, single: bool = True) -> None:
    """Set ``inputs`` and ``outputs`` of a frozen model as tuples of checked names; ``single``: exactly one each."""
    for which in ("inputs", "outputs"):
        object.__setattr__(model, which, checks.check_names(which, getattr(model, which), single=single))


def names(model: Any) -> dict[str, list[str]]:
    """The fields ``inputs`` and ``outputs`` of a model file."""
    return {"inputs": list(model.inputs), "outputs": list(model.outputs)}


def parts(content: Mapping[str, Any]) -> dict[str, Any]:
    """Keyword arguments ``inputs`` and ``outputs`` of a model, from the content of its file."""
    return {which: content[which] for which in ("inputs", "outputs")}


def rows(first: tuple[str, Array], second: tuple[str, Array]) -> list[dict[str, float]]:
    """List of JSON objects, one for each index of two named arrays; the inverse of `columns`."""
    name, numbers = first
    other, others = second
    return [{name: x, other: y} for x, y in zip(numbers.tolist(), others.tolist(), strict=True)]


def columns(content: Mapping[str, Any], which: str, **units: str) -> dict[str, Any]:
    """Lists of numbers by key, one for each key of ``units``, from the list of JSON objects content[which]."""
    lists: dict[str, Any] = {name: [] for name in units}
    for name, unit in units.items():
        for i, item in enumerate(content[which]):
            number = checks.finite(f"{which}[{i}].{name}", item[name], unit=unit)
            lists[name].append(number)
    return lists
