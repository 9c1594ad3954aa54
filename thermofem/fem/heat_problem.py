"""The axisymmetric heat equation on a meshed cross-section, as matrices.

    rho c_p dT/dt = div(k grad T) + q,    q = P / V_part in a heated part,    dT = mean of T - T0 over a part

With the weight 2 pi r everywhere and P2 triangles this is  M dx/dt = -K x + c P,  dT = c^T x: the same functional c
(volume mean over the part) heats and reads, so the system is symmetric and passive. Where k or c_p depend on T, these
are the matrices at the ambient temperature T0, and `HeatProblem.model` is the nonlinear system around them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array, ArrayLike, Mask
from ..geometry.resistor import heater_sheet
from ..geometry.section_parts import AMBIENT, LIGHT, MODE, WAVELENGTH
from ..materials.material_laws import Law, is_constant
from ..models import NonlinearSystem, StateSpace
from ..optics.modes import Light
from ..transient.modal import Modal
from ..transient.nonlinear import Ledger, NodalOperator, ledger_of, nodal_operator
from .domain_truncation import Wider, domain_error, warn_of_domain, wider
from .error_estimate import Estimate, MeshError
from .probe_means import probe_integral
from .weak_forms import Discretization, capacity, conduction, properties, volume

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..mesh import Mesh
    from ..optics import Mode

TOGETHER = " + "  # between the names of parts that share a power


@dataclass(frozen=True, eq=False)
class HeatProblem:
    """The heat problem of one cross-section, as returned by `assemble`.

    Attributes
    ----------
    geometry : CrossSection
    mesh : Mesh
    discretization : Discretization
    accuracy : float
        that was asked for.
    light : Mode, optional
        the mode whose temperature is read as "light" (`with_light`).
    together : tuple of str
        further inputs, each several parts that share a power (`heated_together`).
    """

    geometry: CrossSection
    mesh: Mesh
    discretization: Discretization
    accuracy: float
    light: Mode | None = None
    together: tuple[str, ...] = ()

    def __repr__(self) -> str:
        size = f"{self.unknowns} unknowns, accuracy {self.accuracy:g}"
        return f"HeatProblem({self.geometry.name!r}, {size}, heated {', '.join(self.heated)})"

    def _repr_html_(self) -> str:
        """HTML for notebooks."""
        from ..data.display import card, section_card

        rows = [
            ("unknowns", f"{self.unknowns}"),
            ("accuracy", f"{self.accuracy:g}"),
            ("heated", ", ".join(self.heated)),
            ("can be read", ", ".join(self.readable)),
        ]
        return card("Heat problem", rows, section_card(self.geometry))

    @property
    def heated(self) -> tuple[str, ...]:
        """Names of the parts that may carry absorbed power, and of those that share it."""
        return (*self.geometry.heated, *self.together)

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of every layer and part; each can be read."""
        return self.mesh.region_names

    @property
    def probes(self) -> tuple[str, ...]:
        """Names of the probes of the geometry."""
        return tuple(probe.name for probe in self.geometry.probes)

    @property
    def readable(self) -> tuple[str, ...]:
        """Names of everything that can be read: regions, probes, shared inputs, and "light" after `with_light`."""
        light = () if self.light is None else (LIGHT,)
        return (*self.regions, *self.probes, *self.together, *light)

    def with_light(self, mode: Mode) -> HeatProblem:
        """The same problem with one more output, "light": the temperature as a mode sees it, `Mode.light_integral`.

        A resonance moves by dw/w = -mode.thermo_optic times it. The mean over the core is within 0.3 % of it for a
        silicon strip; 10 ns after a step it errs by -4 % for a rib, +5 % for a disc, -9 % for a nitride strip.

        Raises InputError: a region of the geometry is called "light".

        >>> import thermofem as th
        >>> heat = th.assemble(th.strip_ring())
        >>> mode = th.light(heat, wavelength=1.555e-6).mode("TE0")
        >>> round(heat.with_light(mode).thermal_resistance("core", "light") / heat.thermal_resistance("core"), 2)
        1.0
        """
        names = (*self.regions, *self.probes, LIGHT)
        checks.unique("what can be read", names, hint="rename the region or probe")
        return replace(self, light=mode).reading(LIGHT)

    def heated_together(self, parts: Sequence[str]) -> HeatProblem:
        """The same problem with one more input, ``" + ".join(parts)``: each part takes an equal share of its power.

        Its load is the mean of the loads of the parts, c = (c_1 + ... + c_n)/n.

        Raises InputError: a name that is no heated part.
        """
        names = _names("heated", parts, self.heated, self.heated)
        name = TOGETHER.join(names)
        loads = [self.discretization.means[part] for part in names]
        means = {**self.discretization.means, name: np.mean(loads, axis=0)}
        discretization = replace(self.discretization, means=means)
        return replace(self, discretization=discretization, together=(*self.together, name))

    def reading(self, *names: str) -> HeatProblem:
        """Copy in which probes or the light, given by ``names``, are among the means of the `Discretization`."""
        means = dict(self.discretization.means)
        for name in names:
            integral = self.integral(name, self.discretization.basis)
            means[name] = integral / integral.sum()
        return replace(self, discretization=replace(self.discretization, means=means))

    def integral(self, name: str, basis: Any) -> Array:
        """Integral of 2 pi r times each function of a basis over a region or probe, or weighted with the light."""
        if name == LIGHT and self.light is not None:
            return self.light.light_integral(basis)
        if name in self.together:
            integrals = [self.integral(part, basis) for part in name.split(TOGETHER)]
            return sum(integral / integral.sum() for integral in integrals)
        if name in self.regions:
            return volume(basis, self.mesh.region == self.regions.index(name))
        return probe_integral(self.geometry, self.mesh, basis, self.geometry.probe(name))

    @cached_property
    def lit(self) -> HeatProblem:
        """The problem with the mode of [light] as an output (`with_light`); unchanged without [light]."""
        if self.geometry.light is None or self.light:
            return self
        return self.with_light(Light.of(self).mode())

    @property
    def judged(self) -> tuple[tuple[str, str], ...]:
        """The channels (heated, read) whose mesh error decides about the mesh.

        Every heated part with itself, with the other heated parts and with every probe.
        """
        outputs = (*self.heated, *self.probes)
        return tuple((part, read) for part in self.heated for read in outputs)

    @property
    def unknowns(self) -> int:
        """Number of temperatures solved for."""
        return int(self.discretization.free.size)

    @cached_property
    def system(self) -> StateSpace:
        """The FEM itself as a thermal model: every heated part is an input and an output, the light is an output."""
        light = () if self.light is None else (LIGHT,)
        return self.channels(self.heated, (*self.heated, *light))

    def channels(
        self, heated: str | Sequence[str] | None = None, read: str | Sequence[str] | None = None
    ) -> StateSpace:
        """The FEM with chosen inputs and outputs.

        Parameters
        ----------
        heated : str or sequence of str
            heated parts; default all of them. "ambient" is the temperature around the domain in kelvin above that of
            the geometry: of held, convective and open sides.
        read : str or sequence of str
            layers, parts or probes whose mean is read; default the heated ones.

        Raises
        ------
        InputError
            a name that is no heated part, nothing that can be read, or with "ambient" what a held side is part of.

        >>> import thermofem as th
        >>> moved = th.assemble(th.strip_ring()).channels("ambient", "core")
        >>> round(moved.thermal_resistance, 9)  # K/K
        1.0
        """
        inputs = _names("heated", heated, (*self.heated, AMBIENT), self.heated)
        parts = tuple(name for name in inputs if name != AMBIENT)
        outputs = _names("read", read, self.readable, parts or self.heated)
        if AMBIENT in inputs:
            self._check_moving(outputs)
        if (inputs, outputs) not in self._kept:
            about: dict[str, Any] = {"geometry": self.geometry.to_toml(), "mesh_accuracy": self.accuracy}
            beyond = self.geometry.beyond_laws()
            about |= {"warning": beyond} if beyond else {}
            origin = about | self.stated_mode(outputs)
            system = replace(self.discretization.state_space(inputs, outputs), origin=origin)
            self._kept[inputs, outputs] = system
        return self._kept[inputs, outputs]

    def stated_mode(self, outputs: Sequence[str]) -> dict[str, Any]:
        """Name and wavelength (m) of the mode, for the origin of a model, where "light" is among its outputs."""
        if self.light is None or LIGHT not in outputs:
            return {}
        return {MODE: self.light.name, WAVELENGTH: self.light.wavelength}

    def _check_moving(self, outputs: tuple[str, ...]) -> None:
        """Raise InputError where the ambient is the name of a region, or where a mean has a share of held unknowns."""
        checks.unique("inputs", (*self.regions, AMBIENT), hint="rename the region")
        d = self.discretization
        for name in outputs:
            share = float(np.abs(d.means[name][d.held]).sum())
            hint = f"{name!r} reaches a side at the ambient temperature and follows it at once; read a part inside"
            # 1e-9: by this share the gain of the ambient is below 1
            checks.between(f"share of {name!r} that is held", share, 0, 1e-9, hint=hint)

    @cached_property
    def _kept(self) -> dict[Any, Any]:
        """Cache of systems, transients and errors."""
        return {}

    @cached_property
    def nonlinear(self) -> bool:
        """Whether k or c_p of any material in the geometry depends on temperature."""
        return any(self.geometry.material_of(name).varies for name in self.regions)

    def model(
        self, heated: str | Sequence[str] | None = None, read: str | Sequence[str] | None = None
    ) -> StateSpace | NonlinearSystem:
        """As `channels`, with k(T) and c_p(T) where materials have them; "ambient" goes with constant ones only."""
        linear = self.channels(heated, read)
        if not self.nonlinear:
            return linear
        if AMBIENT in linear.inputs:
            raise checks.InputError("heated = 'ambient' needs a linear model: heat.channels, or constant k and c_p")
        free = self.discretization.free
        operators = [replace(operator, matrix=operator.matrix[free]) for operator in self._everywhere]
        return NonlinearSystem(linear, *operators)

    def modal(self, heated: str) -> Modal:
        """Closed-form solver of transients with ``heated`` carrying the power, at small power; kept for further runs.

        Raises
        ------
        InputError
            a name that is no heated part.
        """
        if checks.choice("heated", heated, self.heated) not in self._kept:
            self._kept[heated] = Modal(self.channels(heated), self.discretization.factors)
        return self._kept[heated]

    @cached_property
    def wider(self) -> Wider | None:
        """The same heat problem on a stack that goes on beyond its bottom and outer side, see `domain_truncation`."""
        return wider(self)

    @cached_property
    def ledger(self) -> Ledger:
        """Terms of the energy balance of a transient of `model`."""
        return ledger_of(*self._everywhere, self.discretization.held)

    def audit(self, heated: str) -> Ledger:
        """Ledger for power in ``heated``, including the share of it that enters at held unknowns and leaves at once."""
        checks.choice("heated", heated, self.heated)
        load = self.discretization.means[heated]
        direct = load[self.discretization.held].sum()
        return replace(self.ledger, direct=float(direct))

    @cached_property
    def _everywhere(self) -> tuple[NodalOperator, NodalOperator]:
        """Operators F and H of `transient.nonlinear` with the rows of all unknowns, held ones included."""
        d = self.discretization
        k, c = properties(self.geometry, self.mesh)

        def operator(kind: str, form: Callable[..., Any], values: Array, whole: Any) -> NodalOperator:
            terms = [(form(d.basis, values * cells), law) for law, cells in self._cells(kind).items()]
            constant = whole - sum(matrix for matrix, _ in terms)
            return nodal_operator(terms, constant, d.free, self.geometry.ambient)

        flow = operator("conductivity_law", conduction, k, d.stiffness)
        content = operator("specific_heat_law", capacity, c, d.mass)
        return flow, content

    def _cells(self, kind: str) -> dict[Law, Mask]:
        """Triangles (as a mask) that follow each temperature law that is not constant."""
        laws = [getattr(self.geometry.material_of(name), kind) for name in self.regions]
        cells = {}
        for law in laws:
            if not is_constant(law):
                same = np.array([other == law for other in laws])
                cells[law] = same[self.mesh.region]
        return cells

    def thermal_resistance(self, heated: str | None = None, read: str | None = None) -> float:
        """Steady mean rise of ``read`` per watt in ``heated``, in K/W; defaults: the first heated part, and itself.

        At small power, where conductivities depend on temperature; `steady_rise` takes any power.

        >>> import thermofem as th
        >>> round(th.assemble(th.strip_ring()).thermal_resistance("core") / 1e3, 2)  # K/mW
        7.86
        """
        heated, read = self._channel(heated, read)
        d = self.discretization
        reading = d.means[read][d.free]
        return float(reading @ self._mesh_error.static(heated))

    def steady_rise(self, power: float, heated: str | None = None, read: str | None = None) -> float:
        """Steady mean rise of ``read`` in K at a power in W in ``heated``; k(T) is taken into account.

        Raises
        ------
        InputError
            a power out of range; no steady state is found, see `NonlinearSystem.steady_state`.
        """
        heated, read = self._channel(heated, read)
        power = checks.between("power", power, -checks.MOST_POWER, checks.MOST_POWER, unit="W", hint=checks.POWER_HINT)
        model = self.model(heated, read)
        if isinstance(model, NonlinearSystem):
            return float(model.steady_rise(power)[0])
        return power * self.thermal_resistance(heated, read)

    def heater_sheet(self, heater: str | None = None) -> dict[str, float]:
        """What the data sheet of a thermal phase shifter says, from its cross-section.

            shift_per_watt = lambda alpha R(heater -> light),     FSR = c/(n_g L)
            P(2 pi) = FSR/(f alpha R(heater -> light)),           P(pi) = P(2 pi)/2
            V = sqrt(P R_e),  I = sqrt(P/R_e),                    R_e = R_0 (1 + tcr R(heater -> heater) P)

        alpha = -d ln(omega)/dT is the mode's `thermo_optic`. L is the round trip of a ring or the length of a straight
        guide: a shift by one free spectral range, or a phase of 2 pi at constant frequency, which takes the same power.

        Parameters
        ----------
        heater : str
            default the first heated part that does not guide.

        Returns
        -------
        dict
            thermal_resistance (K/W, of the light by the heater), shift_per_kelvin (m/K), shift_per_watt (m/W),
            free_spectral_range (Hz), pi_power and fsr_power (W); with a resistance of the heater also resistance (ohm),
            pi_voltage, fsr_voltage (V), pi_current and fsr_current (A).

        Raises
        ------
        InputError
            no light in the geometry, or no such heater.

        >>> import thermofem as th
        >>> section = th.heated_ring().with_({"light.wavelength": "1.55 um", "part.heater.resistance": "120 ohm"})
        >>> sheet = th.assemble(section).heater_sheet()
        >>> print(f"{sheet['pi_power'] * 1e3:.1f} mW, {sheet['pi_voltage']:.2f} V for pi")
        18.9 mW, 1.51 V for pi
        """
        mode = self.lit.light
        if mode is None:
            hint = "give the geometry a [light] table with its wavelength, or take heat.with_light(mode)"
            raise checks.InputError(f"{self.geometry.name!r} has no light, whose phase a heater moves", hint)
        heaters = [name for name in self.heated if name != mode.core]
        heater = checks.choice("heater", heater, heaters, default=next(iter(heaters), None))
        to_light = self.lit.thermal_resistance(heater, "light")
        return heater_sheet(self.geometry, mode, heater, to_light, self.thermal_resistance(heater))

    @cached_property
    def _mesh_error(self) -> MeshError:
        return MeshError(self)

    def estimate(self, *channels: tuple[str, str]) -> Estimate:
        """Estimated mesh errors of channels (heated, read) at every shift and in every triangle; default `judged`.

        InputError: a channel of a part that is not heated, or of what cannot be read.
        """
        for heated, read in channels:
            self._channel(heated, read)
        estimate = self._mesh_error.estimate(channels or self.judged)
        for channel, errors in estimate.errors.items():
            key = "mesh", *channel
            self._kept[key] = float(errors.max())
        return estimate

    def mesh_error(self, heated: str | None = None, read: str | None = None) -> float:
        """Relative mesh error of R_th and of the step response from 1 ns on, see `thermofem.fem.error_estimate`."""
        key = "mesh", *self._channel(heated, read)
        if key not in self._kept:
            self.estimate(key[1:])
        return float(self._kept[key])

    def errors(self, heated: str | None = None, read: str | None = None) -> tuple[float, float]:
        """`mesh_error`, and the relative error of R_th by the finite domain, see `thermofem.fem.domain_truncation`.

        Where the end of the domain changes R_th by more than ``accuracy`` the log says so, once for geometries of one
        name and size.
        """
        return self.mesh_error(heated, read), self.domain_error(heated, read)

    def domain_error(self, heated: str | None = None, read: str | None = None, *, what: str = "R_th") -> float:
        """Relative error of R_th by the finite domain, see `errors`; the log calls it ``what``."""
        key = "domain", *self._channel(heated, read)
        if key not in self._kept:
            self._kept[key] = domain_error(self, *key[1:])
        if self._kept[key] > self.accuracy:
            warn_of_domain(self.geometry, self._kept[key], self.accuracy, what)
        return float(self._kept[key])

    def _channel(self, heated: str | None, read: str | None) -> tuple[str, str]:
        heated = checks.choice("heated", heated, self.heated, default=self.heated[0])
        return heated, checks.choice("read", read, self.readable, default=heated)

    def field(self, state: ArrayLike) -> Array:
        """Temperature rise in K at every vertex of the mesh, from states of shape (..., unknowns) of the system."""
        state = checks.numbers("state", state)
        checks.shape("state", state, (*state.shape[:-1], self.unknowns))
        d = self.discretization
        everywhere = np.zeros((*state.shape[:-1], d.mass.shape[0]))
        everywhere[..., d.free] = state
        return everywhere[..., d.basis.nodal_dofs[0]]


def _names(
    argument: str, given: str | Sequence[str] | None, known: Sequence[str], default: Sequence[str]
) -> tuple[str, ...]:
    """One or several names, each checked against the known ones."""
    if given is None:
        given = default
    elif isinstance(given, str):
        given = (given,)
    names = checks.check_names(argument, tuple(given))
    return tuple(checks.choice(argument, name, known) for name in names)
