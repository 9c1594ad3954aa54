"""The thermal model of a circuit: one model for all rings, or one with an input and an output for each ring.

A mode of an N x N model that several rings heat becomes one state for each of them; as the model is linear their sum is
what the mode was. A model that `surrogate.reduce_array` made has no such modes and keeps its states.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermofem import OutputMap, Quadratic, StateSpace, checks
from thermofem.arrays import Array
from thermofem.models.contract import bare
from thermofem.models.state_space import eigenmodes

from ..heaters import power_of, rises, states_of
from ..inputs import Pieces, add
from ..thermal import check_resistance, compact

log = logging.getLogger("thermofem")

MOST = 20_000  # states: their matrices are dense
NOTHING = 1e-15  # of a ring's R_th, what a state adds to any ring


@dataclass(frozen=True, eq=False)
class RingHeat:
    """Heat of N rings in SI with K states each; a ring with fewer has the others at zero gain.

        dx_jk/dt = gain_jk P_j - rate_jk x_jk,    dT_i = sum_jk read_ijk x_jk

    gain, rate [shape (N, K); K/J and 1/s]
    read [shape (N, N, K)]
    curvature [1/K]: of the output map of a ring alone.
    crossed: whether heat goes from ring to ring.
    heaters [mapping of name to (rate, gain, read)]: poles of the heaters: arrays of shape (n,), (n,) and (N, n).
    """

    gain: Array
    rate: Array
    read: Array
    curvature: float
    crossed: bool
    heaters: Mapping[str, tuple[Array, Array, Array]]

    @property
    def thermal_resistance(self) -> Array:
        """R_th of each ring by its own heat, shape (N,), K/W."""
        own = np.einsum("iik->ik", self.read)
        return np.asarray((own * self.gain / self.rate).sum(axis=1))


def ring_heat(thermal: Any, names: Sequence[str]) -> RingHeat:
    """Heat of the rings of these names under a thermal model.

    thermal [Foster, StateSpace, OutputMap, or what holds one as ``.model``]: with one input and output, it serves every
        ring and no heat goes between them; a StateSpace with as many outputs as rings has the rings first among its
        inputs, then heaters. Rings that it names belong to those of the same names, and others in their order.
    Raises InputError: another number of rings, a model that is not symmetric, not passive, quadratic, or too large.
    """
    model, rings = bare(thermal), len(names)
    if isinstance(model, StateSpace) and (len(model.outputs) > 1 or len(model.inputs) > 1):
        return _of_array(model, names)
    small = compact(model)
    if isinstance(small, Quadratic):
        raise checks.InputError("thermal is quadratic; a circuit takes linear models, and an OutputMap over one")
    network = small.linear if isinstance(small, OutputMap) else small
    read = np.zeros((rings, rings, network.order))
    read[np.arange(rings), np.arange(rings)] = 1.0
    gain, rate = (np.tile(values, (rings, 1)) for values in (network.gain, 1 / np.asarray(network.tau)))
    return RingHeat(gain, rate, read, float(getattr(small, "coefficient", 0.0)), False, {})


def _by_name(model: StateSpace, names: Sequence[str]) -> StateSpace:
    """The model with its rings sorted as ``names`` where it has these names, otherwise unchanged."""
    own = [*model.inputs[: len(names)]]
    if own != [*model.outputs] or {*own} != {*names}:
        if own != [f"ring {k + 1}" for k in range(len(names))]:
            log.warning(
                "thermal is of %s: they stand for the rings %s, in this order", ", ".join(own), ", ".join(names)
            )
        return model
    order = [own.index(name) for name in names]
    inputs = [*order, *range(len(names), len(model.inputs))]
    B, C = np.asarray(model.B)[:, inputs], np.asarray(model.C)[order]
    return replace(model, B=B, C=C, inputs=tuple(model.inputs[k] for k in inputs), outputs=tuple(names))


def _of_array(model: StateSpace, names: Sequence[str]) -> RingHeat:
    rings = len(names)
    if len(model.outputs) != rings or len(model.inputs) < rings:
        raise checks.InputError(
            f"thermal has {len(model.inputs)} inputs and {len(model.outputs)} outputs, the circuit {rings} rings; one "
            "of each for every ring is needed (surrogate.reduce_array), or one model for all rings"
        )
    model = _by_name(model, names)
    rate, B, C = _modes(model)
    scale = np.abs(model.gain).max()
    parts = []
    for j in range(len(model.inputs)):
        each = np.abs(C * B[:, j] / rate)
        check_resistance(float(each.sum(axis=1).max()))
        residue = each.max(axis=0)
        used = residue > NOTHING * scale
        parts.append((rate[used], B[used, j], C[:, used]))
    most = max(len(part[0]) for part in parts[:rings])
    # from 8 states on a multiple of 4, the numbers that a processor adds at once
    most = most if most < 8 else -(-most // 4) * 4
    gain, rates, read = np.zeros((rings, most)), np.full((rings, most), rate.max()), np.zeros((rings, rings, most))
    for j, (own_rate, own_gain, own_read) in enumerate(parts[:rings]):
        k = len(own_rate)
        gain[j, :k], rates[j, :k], read[:, j, :k] = own_gain, own_rate, own_read
    heaters = dict(zip(model.inputs[rings:], parts[rings:], strict=True))
    heat = RingHeat(gain, rates, read, 0.0, rings > 1, heaters)
    checks.positive("thermal: R_th of every ring", heat.thermal_resistance.min(), unit="K/W")
    return heat


def _modes(model: StateSpace) -> tuple[Array, Array, Array]:
    """Rates, and B and C in the modes of a small symmetric system."""
    if model.order > MOST:
        raise checks.InputError(
            f"thermal is a system of {model.order} states; reduce it first (surrogate.reduce_array)"
        )
    E, A = (m.toarray() if hasattr(m, "toarray") else np.asarray(m, dtype=float) for m in (model.E, model.A))
    if np.array_equal(E, np.eye(len(E))) and np.array_equal(A, np.diag(np.diag(A))) and np.diag(A).max() < 0:
        return -np.diag(A), np.asarray(model.B, dtype=float), np.asarray(model.C, dtype=float)  # its own modes
    rate, modes = eigenmodes(model)
    return rate, modes.T @ np.asarray(model.B), np.asarray(model.C) @ modes


def heater_offsets(
    heat: RingHeat, heaters: Mapping[str, Any] | None, duration: float, rtol: float, before: Array | None = None
) -> tuple[dict[str, Pieces], list[Pieces], Array]:
    """Powers of the heaters in W, the rise of every ring by them in K, and their states at the end of the run.

    A number is a power that was on for ever, a waveform (or a list) one that is switched on at t = 0. After another
    run, whose states at its end are ``before``, both begin with its heat. Accuracy as of `heaters.rises`.

    before: states of all heaters in their order, with those that are not given now, which cool.
    """
    given = checks.mapping("heaters", heaters, hint="give powers by the inputs' names, {'heater 1': 1e-3}")
    for name in given:
        hint = "" if heat.heaters else "the thermal model has no heaters among its inputs"
        checks.choice("a name in heaters", name, heat.heaters, hint=hint)
    powers = {name: power_of(name, value, duration) for name, value in given.items()}
    sizes = [rate.size for rate, *_ in heat.heaters.values()]
    if before is not None and before.size != sum(sizes):
        raise checks.InputError(
            f"initial has {before.size} states of heaters and the thermal model {sum(sizes)}; go on with the same model"
        )
    started = np.split(np.zeros(sum(sizes)) if before is None else before, np.cumsum(sizes)[:-1])
    whole, dark = np.array([0.0, duration]), Pieces.constant(0.0, duration, 0.0)
    offsets, ends = [[dark] for _ in heat.gain], [np.empty(0)]
    for (name, (rate, gain, read)), begin in zip(heat.heaters.items(), started, strict=False):
        value, power = given.get(name, 0.0), powers.get(name, dark)
        settled = gain / rate * float(value) if hasattr(value, "__float__") else None
        if settled is not None and (before is None or np.array_equal(begin, settled)):
            parts = [Pieces.constant(0.0, duration, rise) for rise in read @ settled]
            ends.append(settled)
        else:
            parts = rises(rate, read * gain, power, rtol, begin / gain)
            ends.append(gain * states_of(rate, power, whole, begin / gain)[-1])
        for every, part in zip(offsets, parts, strict=True):
            every.append(part)
    return powers, [add(every) for every in offsets], np.concatenate(ends)
