"""A family: one reduced basis for all rings in a box of parameters."""

from __future__ import annotations

import itertools
import logging
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg import eigh

from thermofem import Foster, OutputMap, StateSpace, checks
from thermofem.arrays import Array, ArrayLike
from thermofem.fem.heat_derivatives import ModalDerivative, dataset_of, step_times
from thermofem.geometry.section_parts import LIGHT, MODE, WAVELENGTH
from thermofem.models.contract import OutsideTrainingWarning

from ..reduction.reduce import reduce
from . import family_files
from .interpolation import OutputMaps
from .members import Certified, HeldOut, MemberModes, certified, coarse_difference
from .optical_numbers import LitMember, Members, OpticalNumbers, two_outputs
from .parameter_box import Box

log = logging.getLogger("thermofem")

Channel = Foster | OutputMap

DIFFERENCE_STEP = 1e-5  # of the range of a parameter: half the width of the differences of its matrices, exact to 1e-10
FAR_CONTACT = 1e-8  # m^2 K/W; below it derivatives read at another part are wrong up to 7 times (measured)


@dataclass(frozen=True)
class ChannelNames:
    """The part of a family that is heated, and what is read."""

    heated: str
    read: str

    def __str__(self) -> str:
        return f"{self.heated} to {self.read}"


@dataclass(frozen=True, eq=False)
class Family:
    """Thermal models of all rings in a box of parameters, by projection on one basis.

        K(p) = V^T K_mesh(p) V,   M(p) = V^T M_mesh(p) V,   b(p) = V^T c_mesh(p)

    Galerkin on a symmetric pair: every member is passive, R_i >= 0 where a part reads its own heat, and its R_th is a
    lower bound. `train_family` makes one.

    Attributes
    ----------
    inputs, outputs : tuple of str
        heated parts and what is read; "light", the temperature that rings of these geometries read, is the last output
        where the geometry has [light].
    tolerance : float
        that was asked for.
    members : Members
        makes the small matrices of a member.
    error : HeldOut
    floor, factor : float
        of `predicted_error`.
    output_maps : OutputMaps, optional
        k(T) and c_p(T) up to a power: the output map of every member, by interpolation, and its own error. All errors
        beside it, derivatives and certificates are those at small power.
    optics : OpticalNumbers, optional
        where the geometry has [light]: what `ring_at` of coupled.ring_family makes a member's ring from, and its
        errors.
    provenance : dict
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    tolerance: float
    members: Members
    error: HeldOut
    floor: float
    factor: float
    output_maps: OutputMaps | None = None
    optics: OpticalNumbers | None = None
    provenance: dict[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        checks.check_names("inputs", self.inputs)
        checks.check_names("outputs", self.outputs)
        checks.positive("tolerance", self.tolerance, at_most=1)
        for name in ("floor", "factor"):
            checks.between(name, getattr(self, name), 0, checks.LARGEST_NUMBER)

    def __repr__(self) -> str:
        ranges = [f"{name} {words}" for name, words in self.box.range_words.items()]
        functions = f"{self.size} functions, engine {self.engine!r}"
        return f"Family({', '.join(ranges)}; {functions}, {self.error!r})"

    @property
    def box(self) -> Box:
        """The box of parameters."""
        return self.members.projection.box

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.box.names

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Ends (low, high) of the range of each parameter, SI."""
        ends = np.column_stack([self.box.low, self.box.high])
        return {name: (low, high) for name, (low, high) in zip(self.names, ends.tolist(), strict=True)}

    @property
    def engine(self) -> str:
        """How members are made: "affine" (sums of fixed matrices) or "moved mesh" (reassembled).

        With k(T) " and interpolation" (of the output map) is added.
        """
        name = self.members.projection.engine
        return name if self.output_maps is None else f"{name} and interpolation"

    @property
    def size(self) -> int:
        """Number of basis functions."""
        return self.members.projection.size

    @property
    def ports(self) -> tuple[str, ...]:
        """Names of the ports: heated parts first, then further parts that are read."""
        return tuple(dict.fromkeys((*self.inputs, *self.outputs)))

    def channel(self, heated: str | None = None, read: str | None = None) -> ChannelNames:
        """Names of a heated and a read part; default the first heated one, and itself or what the family reads first.

        Raises InputError: a part that is not heated, or not read.
        """
        a = checks.choice("heated", heated, self.inputs, default=self.inputs[0])
        default = a if a in self.outputs else self.outputs[0]
        return ChannelNames(a, checks.choice("read", read, self.outputs, default=default))

    def indices(self, channel: ChannelNames) -> tuple[int, int]:
        """Indices in `ports` of the heated and of the read part."""
        return self.ports.index(channel.heated), self.ports.index(channel.read)

    def model(self, *, heated: str | None = None, read: str | None = None, **values: float) -> Channel | LitMember:
        """Return the Foster network of one member; with k(T) an OutputMap over it, of the first channel.

        With "light" among the outputs, and no channel named, it also holds this output, so that a ring finds the
        temperature that it reads (`LitMember`).

        Parameters
        ----------
        heated, read : str
            the channel; default the first heated part, and itself or what the family reads first.
        **values : float
            one number for each parameter, SI.

        Raises
        ------
        InputError
            a parameter missing or unknown, or a value outside the box.
        """
        channel = self.channel(heated, read)
        if heated is None and read is None and self.has_light_beside:
            modes = self.members.member(self.box.row(values)).modes()
            ports = (*self.indices(channel), self.ports.index(LIGHT))
            system = two_outputs(modes, (channel.heated, channel.read), ports, self._origin(LIGHT))
            return LitMember(system, self._foster(modes, channel))
        return self.of_channel(channel, values)

    @property
    def has_light_beside(self) -> bool:
        """Whether `model` has "light" beside the first output: where the family reads both, and is linear."""
        return LIGHT in self.outputs and len(self.outputs) > 1 and self.output_maps is None

    def at(self, values: Mapping[str, Any]) -> Channel | LitMember:
        """`model` without a named channel; ``values`` maps the name of each parameter to its value in SI."""
        return self.model(**values)

    def of_channel(self, channel: ChannelNames, values: Mapping[str, Any]) -> Channel:
        """`model` of a channel; ``values`` maps the name of each parameter to its value in SI."""
        row = self.box.row(values)
        modes = self.members.member(row).modes()
        return self._with_output_map(self._foster(modes, channel), row, channel)

    def of_member(self, row: Array) -> Channel:
        """`model` of the first channel, for the parameters ``row`` in SI, shape (p,)."""
        return self.of_channel(self.channel(), self.box.named(row))

    def _with_output_map(self, linear: Foster, row: Array, channel: ChannelNames) -> Channel:
        if self.output_maps is None:
            return linear
        if channel != self.channel():
            text = f"heat in {channel.heated!r} read in {channel.read!r} is linear, right at small power"
            warnings.warn(f"{text}; k(T) is followed in the first channel alone", OutsideTrainingWarning, stacklevel=3)
            return linear
        return self.output_maps.on(linear, self.box.share(row))

    def held(self, **values: float) -> Held:
        """Fix some parameters; the result has the remaining ones, as `coupled.identify` takes it."""
        for name, value in values.items():
            low, high = self.ranges[checks.choice("parameter", name, self.names)]
            checks.between(name, value, low, high)
        return Held(self, dict(values))

    def system(self, **values: float) -> StateSpace:
        """Return the small StateSpace of one member with all inputs and outputs."""
        small = self.members.member(self.box.row(values))
        means = dict(zip(self.ports, small.ports, strict=True))
        heated = np.array([means[name] for name in self.inputs])
        read = np.array([means[name] for name in self.outputs])
        return StateSpace(small.M, -small.K, heated.T, read, inputs=self.inputs, outputs=self.outputs)

    def reduced(
        self, tolerance: float = 1e-3, *, heated: str | None = None, read: str | None = None, **values: float
    ) -> Channel:
        """Return a member with few poles; its impedance differs from that of `model` by at most ``tolerance`` R_th."""
        channel = self.channel(heated, read)
        system = self.system(**values).channel(channel.heated, channel.read)
        model: Any = reduce(replace(system, origin=self._origin(channel.read)), tolerance).model  # a Foster network
        return self._with_output_map(model, self.box.row(values), channel)

    def thermal_resistance(self, *, heated: str | None = None, read: str | None = None, **values: ArrayLike) -> Array:
        """Return R_th in K/W of many members; the values broadcast against each other."""
        rows = self.box.rows(values)
        *shape, size = rows.shape
        channel = self.indices(self.channel(heated, read))
        R_th = self.members.resistances(rows.reshape(-1, size), *channel)
        return R_th.reshape(shape)

    def step_response(
        self, times: ArrayLike, *, heated: str | None = None, read: str | None = None, **values: ArrayLike
    ) -> Array:
        """Rise in K/W of many members after a unit step; shape of the broadcast values, then that of ``times``."""
        t = checks.numbers("times", times)
        rows = self.box.rows(values)
        *shape, size = rows.shape
        channel = self.indices(self.channel(heated, read))
        after = np.maximum(t.ravel(), 0.0)
        rises = []
        for row in rows.reshape(-1, size):
            modes = self.members.member(row).modes()
            rises.append(modes.step_response(after, *channel))
        return np.asarray(rises).reshape((*shape, *t.shape))

    def predicted_error(self, **values: float) -> float:
        """Relative error expected of one member, in R_th and in the step response from 1 ns on.

            floor + factor * (difference between all functions and the first 70 % of them)

        The floor is the error of the mesh and the factor the largest ratio over the held-out members, both
        increased by half. It is an estimate from those few members and no bound; `certify` measures one member. It
        holds at small power: with k(T) the error of the output map, ``output_maps.error``, comes on top.
        """
        small = self.members.member(self.box.row(values))
        return self.floor + self.factor * coarse_difference(small, len(self.inputs))

    def derivatives(
        self,
        times: ArrayLike | None = None,
        frequencies: ArrayLike | None = None,
        *,
        heated: str | None = None,
        read: str | None = None,
        **values: float,
    ) -> xr.Dataset:
        """Derivatives of one member with respect to all parameters, as of `thermofem.derivatives`.

        They are derivatives of the family itself: its basis stays fixed, its projected matrices are differentiated.
        """
        channel = self.channel(heated, read)
        row = self.box.row(values)
        for doubt in self.doubts(row, channel):
            log.warning("%s", doubt)
        modal = self.modal_derivative(row, channel)
        t = None if times is None else step_times(times)
        f = None if frequencies is None else checks.array("frequencies", frequencies)
        step = None if t is None else modal.step_response(t)
        impedance = None if f is None else modal.impedance(f)
        parameters = list(zip(self.names, row.tolist(), self.box.units, strict=True))
        data = dataset_of(parameters, (modal.resistance(), step, impedance), t, f)
        return data.assign_attrs(vars(channel))

    def doubts(self, row: Array, channel: ChannelNames) -> tuple[str, ...]:
        """Warnings about derivatives of one member, at parameters of shape (p,), that the basis may represent badly.

        The basis is trained on temperatures. These hardly depend on a nearly perfect contact, least of all where
        another part is read than heated.
        """
        small = self.box.contact & (row < FAR_CONTACT)
        if channel.heated == channel.read or not small.any():
            return ()
        names = ", ".join(itertools.compress(self.names, small))
        text = f"derivatives by {names} below {FAR_CONTACT:g} m^2*K/W, and standard errors from them, may be wrong"
        return (f"{text} by a large factor where {channel.read!r} is read: take thermofem.derivatives of a mesh",)

    def modal_derivative(self, row: Array, channel: ChannelNames | None = None) -> ModalDerivative:
        """One member in M-orthonormal modes, and derivatives of its matrices by central differences.

        The step is in proportion to a contact resistance, as it enters as 1/R, and to the range of any other parameter.
        """
        contact = self.box.contact
        a, b = self.indices(channel or self.channel())
        # 1e-11 m^2 K/W; a smaller resistance has its derivatives: 1/R^2 magnifies what the functions leave of a jump
        row = np.where(contact, np.maximum(row, 1e-11), row)
        small = self.members.member(row)
        rate, v = eigh(small.K, small.M, check_finite=False)
        step = DIFFERENCE_STEP * np.where(contact, row, self.box.high - self.box.low)
        up = self.members.matrices(row + np.diag(step))
        down = self.members.matrices(row - np.diag(step))
        width = 2 * step[:, None, None]
        dK = v.T @ ((up.K - down.K) / width) @ v
        dM = v.T @ ((up.M - down.M) / width) @ v
        dports = (up.ports - down.ports) / width @ v
        port = small.ports @ v
        return ModalDerivative(rate, port[a], port[b], dK, dM, dports[:, a], dports[:, b])

    def certify(self, **values: float) -> Certified:
        """Compare one member with the certified reduction on its own mesh."""
        row = self.box.row(values)
        modes = self.members.member(row).modes()
        geometry = self.box.geometry(row)
        return certified(geometry, modes, self.ports, self.tolerance, len(self.inputs))

    def save(self, path: str | Path) -> Path:
        """Write the family as one file, whole or not at all; `surrogate.load_family` reads it without a mesher."""
        return family_files.save(self, path)

    def _foster(self, modes: MemberModes, channel: ChannelNames) -> Foster:
        R = modes.R(*self.indices(channel))
        size = np.abs(R)
        # 1e-12: of R_th: poles with less are left out
        strong = size > 1e-12 * size.sum()
        used = strong & (modes.tau > 0)
        origin = self._origin(channel.read)
        return Foster(R[used], modes.tau[used], inputs=(channel.heated,), outputs=(channel.read,), origin=origin)

    def _origin(self, read: str) -> dict[str, Any] | None:
        """Origin of a model read in ``read``: that of the family, and the mode whose temperature "light" is."""
        origin = dict(self.provenance)
        light = self.box.base.light
        if read == LIGHT and light is not None:
            origin |= {MODE: light.mode, WAVELENGTH: light.wavelength}
        return origin or None


@dataclass(frozen=True, eq=False)
class Held:
    """A family with some parameters fixed at ``values``."""

    family: Family
    values: dict[str, float]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that are not fixed."""
        return tuple(name for name in self.family.names if name not in self.values)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Ends (low, high) of the range of each parameter that is not fixed, SI."""
        return {name: ends for name, ends in self.family.ranges.items() if name not in self.values}

    def at(self, values: Mapping[str, float]) -> Channel | LitMember:
        """Model of the member whose remaining parameters have the given ``values`` in SI."""
        return self.family.at({**self.values, **values})


def load_family(path: str | Path) -> Family:
    """Read a family that `Family.save` wrote.

    Raises
    ------
    InputError
        no such file, not a family, one of another version, changed since it was written, or one without members.
    """
    family: Family = family_files.read(path, Family, _check)
    return family


def _check(family: Family) -> None:
    """Raise an exception where the parts of a family do not fit to each other."""
    box = family.box
    for ends in (box.low, box.high):
        checks.shape("range", ends, (box.size,))
    if not np.all(box.low < box.high):
        raise ValueError("ranges and parameters do not fit")
    ports = family.members.member(box.middle).ports
    checks.shape("ports", ports, (len(family.ports), family.size))
    if family.optics is not None:
        checks.check_names("optics", family.optics.names)
        family.optics.at(box.share(box.middle))
    with np.errstate(all="ignore"):
        middle = family.of_member(box.middle)
    checks.positive("its R_th in the middle", middle.thermal_resistance, unit="K/W")
