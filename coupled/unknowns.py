"""Free parameters of fits: numbers of the ring, its carriers and its thermal model, as logarithms."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from math import isclose
from typing import Any, Protocol, runtime_checkable

import numpy as np

from thermofem import InputError, checks
from thermofem.arrays import Array
from thermofem.models import Foster, ThermalModel, bare
from thermofem.models.foster import second_order_parameters, second_order_poles

from . import parameters
from .carriers import UNITS
from .heaters import channels
from .resonator import RingResonator
from .thermal import Compact, compact, linear

SECOND_ORDER = ("kappa", "tau_f", "tau_s", "eta")
POLES = ("R", "tau")
HEAT_CAPACITY = "heat_capacity"
LAWS = {*SECOND_ORDER, *POLES, "tau_th", HEAT_CAPACITY}
LIFETIME, LOADED, INTRINSIC = "lifetime", "loaded_q", "intrinsic_q"
# free numbers that are computed from fields, and the fields that they set
COMPUTED = {
    LIFETIME: ("tau0", "tau"),
    LOADED: ("bus_rate", "drop_rate"),
    INTRINSIC: ("loss_rate", "scattering_rate"),
}
FROM_ZERO = {"scattering_rate": 1e6, "kerr_coefficient": 1e-20}  # steps of numbers that may be 0
ROUND_OFF = 1e-9  # relative difference of the rates of two buses that are equal
SPAN = 4.0  # how far a value may go from its start, as a factor, where no bounds are given


@runtime_checkable
class ThermalFamily(Protocol):
    """A family of thermal models with parameters in given ranges, such as `surrogate.family.Family`."""

    @property
    def ranges(self) -> Mapping[str, tuple[float, float]]:
        """Lower and upper end of each parameter by name, in SI."""
        ...

    def at(self, values: Mapping[str, float]) -> Any:
        """The thermal model at the given parameter values (SI, by name)."""
        ...


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The free parameters of a ring with its thermal model, their starts and bounds.

    ring: source of the parameters that are not free.
    thermal: values of a thermal law's parameters, free or not; empty if ``model`` is given instead.
    model: a fixed thermal model, or the Foster network whose poles are free; None for a thermal law.
    names: one for each unknown: "R" and "tau" of n poles become "R1" .. "Rn" and "tau1" .. "taun".
    start, low, high [shape (unknowns,)]: logarithms of start and bounds in SI.
    family: the family of thermal models whose parameters are among the names.
    """

    ring: RingResonator
    thermal: Mapping[str, float]
    model: Foster | Compact | None
    names: tuple[str, ...]
    start: Array
    low: Array
    high: Array
    family: ThermalFamily | None = None

    def build(self, x: Array) -> tuple[RingResonator, Compact]:
        """Ring and thermal model at the logarithms ``x`` of the parameters; InputError if they are not physical."""
        values = dict(zip(self.names, np.exp(x).tolist(), strict=True))
        if self.family is not None:
            inside = {n: min(max(values.pop(n), low), high) for n, (low, high) in self.family.ranges.items()}
            return varied(self.ring, values), channels(self.family.at(inside), self.ring.read).model
        law = {name: values.pop(name, value) for name, value in self.thermal.items()}
        return varied(self.ring, values), compact(_model(law, self.model, values))


def unknowns(
    ring: RingResonator,
    free: Sequence[str],
    model: ThermalModel | ThermalFamily | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Unknowns:
    """Set up the free parameters of a fit from their names, with starts and bounds.

    Raises InputError: a parameter of a family that is not free; an unknown, repeated or fixed name, or one of another
        thermal law than the others; a start that is not positive; bounds that are not positive and in order.
    """
    checks.check_names("free", free)
    family = model if isinstance(model, ThermalFamily) else None
    ranges = family.ranges if family else {}
    for name in ranges.keys() - {*free}:
        raise InputError(f"{name} of the family must be free or held: family.held({name}=...) as the model")
    optical = fitted_names(ring)
    for name in free:
        checks.choice("a name in free", name, optical | (ranges.keys() if family else LAWS))
    check_apart(free)
    thermal, poles = ({}, None) if isinstance(model, ThermalFamily) else _law(free, read_by(ring, model))
    start: dict[str, float] = {}
    for name in free:
        if name in ranges:
            start[name] = float(np.sqrt(ranges[name][0] * ranges[name][1]))
        elif name in POLES and poles is not None:
            start |= {f"{name}{k + 1}": float(v) for k, v in enumerate(getattr(poles, name))}
        elif name in thermal:
            start[name] = thermal[name]
        elif name in optical:
            start[name] = number_of(ring, name)
        else:
            raise InputError(f"free holds {name!r}, which is of another thermal law than the model or the others")
    hint = "a free parameter must start above 0"
    values = np.array([checks.positive(name, value, hint=hint) for name, value in start.items()])
    given = checks.mapping("bounds", bounds, hint='such as {"kappa": (1e5, 1e7)}')
    for name in given:
        checks.choice("a name in bounds", name, start)
    ends = [span_of(n, given, ranges.get(n, (v / SPAN, v * SPAN)), ranges.get(n)) for n, v in start.items()]
    low, high = np.array(ends).T
    values = np.clip(values, low, high)
    return Unknowns(ring, thermal, poles, tuple(start), np.log(values), np.log(low), np.log(high), family)


def read_by(ring: RingResonator, model: ThermalModel | None) -> ThermalModel | None:
    """The channel of a model with several outputs that the ring reads; any other model unchanged."""
    several = model is not None and len(bare(model).outputs) > 1
    return channels(model, ring.read).model if model is not None and several else model


def span_of(
    name: str, bounds: Mapping[str, Any], default: tuple[float, float], within: tuple[float, float] | None = None
) -> tuple[float, float]:
    """Bounds (low, high) of a parameter: given or default; InputError unless 0 < low < high, inside ``within``."""
    low, high = checks.array(f"bounds[{name!r}]", bounds.get(name, default))
    least, most = within or (0.0, np.inf)
    if not (0 < low < high and least <= low and high <= most):
        rule = f" inside the family's {least:g} to {most:g}" if within else ""
        pair = checks.shown(bounds.get(name, default))
        raise InputError(f"bounds[{name!r}] = {pair} must be (low, high) with 0 < low < high{rule}")
    return float(low), float(high)


def _law(free: Sequence[str], model: ThermalModel | None) -> tuple[dict[str, float], Foster | Compact | None]:
    """Start values of the thermal law to which the free names belong, and None; else {} and the thermal model."""
    if {*free} & {*SECOND_ORDER}:
        law = asdict(parameters.SECOND_ORDER_FEM)
        if model is not None:
            law |= second_order_parameters(linear(model, f"free {list(free)}"), law[HEAT_CAPACITY])
        return law, None
    newton = "tau_th" in free or HEAT_CAPACITY in free
    if newton and model is None:
        return asdict(parameters.NEWTON_FIT), None
    if model is None:
        hint = checks.Hint("give the thermal model as model=", text="give the thermal model with --model")
        raise InputError(f"free = {list(free)} has no thermal parameter", hint)
    if not newton and not {*free} & {*POLES}:
        return {}, compact(model)
    poles = linear(model, f"free {list(free)}")
    if newton and poles.order == 1:
        tau = float(np.ravel(poles.tau)[0])
        R = float(np.ravel(poles.R)[0])
        return {"tau_th": tau, HEAT_CAPACITY: tau / R}, None
    return {}, poles


def number_of(ring: RingResonator, name: str) -> float:
    """Value of a number of the ring or of its carriers by name; AttributeError if neither has it."""
    if name == LIFETIME:
        return float(ring.carriers.tau0)
    return float(getattr(ring if hasattr(ring, name) else ring.carriers, name))


def optical_names(ring: RingResonator) -> set[str]:
    """Names of all numeric fields of the ring and its carriers, and "tau0"."""
    own = {f.name for f in fields(ring) if isinstance(getattr(ring, f.name), float)}
    return own | {f.name for f in fields(ring.carriers)} | {"tau0"}


def fitted_names(ring: RingResonator) -> set[str]:
    """Names of all numbers of the ring that a fit may free: `optical_names`, "lifetime", "loaded_q", "intrinsic_q"."""
    return optical_names(ring) | {*COMPUTED}


def check_apart(free: Sequence[str]) -> None:
    """Raise InputError where a free number is computed from another one, such as "loaded_q" from "bus_rate"."""
    for name, sources in COMPUTED.items():
        shared = [source for source in sources if source in free]
        if name in free and shared:
            raise InputError(
                f"free holds {name!r} and {shared[0]!r}, and the one sets the other", "free one of the two"
            )


def with_equal_buses(ring: RingResonator, free: Sequence[str]) -> RingResonator:
    """The ring, whose two buses stay equal where they are and "drop_rate" is not free: one unknown sets both.

    A file with a loaded Q and two buses states both rates; the drop bus would be held at its start.
    """
    equal = ring.drop_rate is not None and isclose(ring.drop_rate, ring.bus_rate, rel_tol=ROUND_OFF)
    return replace(ring, drop_rate=None) if equal and "drop_rate" not in free else ring


def varied(ring: RingResonator, values: Mapping[str, float]) -> RingResonator:
    """Return a copy of the ring with the numbers in ``values`` (SI, by name) replaced, carriers' fields included.

    "tau0" and "lifetime", its other name, scale all lifetimes by one factor; "lumped_fcd" also sets ``fcd`` if that is
    the lumped term. "intrinsic_q" scales absorption and scattering, "loaded_q" then the rates into the buses:

        gamma_i + gamma_s = w0/(2 Q_i),     gamma_e + gamma_d = w0/(2 Q_l) - (gamma_i + gamma_s)

    Raises InputError: a loaded Q that is not below the intrinsic one; an intrinsic Q of a ring without loss.
    """
    values = dict(values)
    if LIFETIME in values:
        values["tau0"] = values.pop(LIFETIME)
    qualities = {name: values.pop(name) for name in (INTRINSIC, LOADED) if name in values}
    changed = _with_fields(ring, values)
    if INTRINSIC in qualities:
        changed = _with_intrinsic_q(changed, qualities[INTRINSIC])
    if LOADED in qualities:
        changed = _with_loaded_q(changed, qualities[LOADED])
    return changed


def _with_intrinsic_q(ring: RingResonator, quality: float) -> RingResonator:
    """The ring whose absorption and scattering are scaled to an intrinsic Q."""
    if not np.isfinite(ring.intrinsic_q):
        raise InputError("intrinsic_q of a ring without loss cannot be set: its loss_rate is 0")
    factor = ring.intrinsic_q / quality
    return replace(ring, loss_rate=factor * ring.loss_rate, scattering_rate=factor * ring.scattering_rate)


def _with_loaded_q(ring: RingResonator, quality: float) -> RingResonator:
    """The ring whose rates into the buses are scaled to a loaded Q."""
    own = ring.loss_rate + ring.scattering_rate
    buses = ring.omega / (2 * quality) - own
    hint = f"it must be below the intrinsic Q, {ring.intrinsic_q:.4g}"
    checks.positive(f"the rate into the buses at loaded_q = {quality:.4g}", buses, unit="1/s", hint=hint)
    factor = buses / (ring.bus_rate + ring.drop_bus_rate)
    drop = None if ring.drop_rate is None else factor * ring.drop_rate
    return replace(ring, bus_rate=factor * ring.bus_rate, drop_rate=drop)


def _with_fields(ring: RingResonator, values: Mapping[str, float]) -> RingResonator:
    """The ring with fields of itself and of its carriers, and "tau0", replaced."""
    names = {f.name for f in fields(ring)}
    own: dict[str, Any] = {name: v for name, v in values.items() if name in names}
    if "lumped_fcd" in own and ring.fcd == ((ring.lumped_fcd, 1.0),):
        own["fcd"] = ((own["lumped_fcd"], 1.0),)
    carriers: Any = ring.carriers
    known = {f.name for f in fields(carriers)} - names
    inner: dict[str, Any] = {name: v for name, v in values.items() if name in known}
    if inner:
        carriers = replace(carriers, **inner)
    if "tau0" in values and "tau0" not in inner:
        factor = values["tau0"] / carriers.tau0
        lifetimes = [each.name for each in fields(carriers) if UNITS[each.name] == "s"]
        scaled: dict[str, Any] = {name: factor * getattr(carriers, name) for name in lifetimes}
        carriers = replace(carriers, **scaled)
    return replace(ring, **own, carriers=carriers)


def _model(law: Mapping[str, float], poles: Foster | Compact | None, values: Mapping[str, float]) -> Foster | Compact:
    """The thermal model of the parameters ``law``, or else ``poles`` with the R and tau that ``values`` contains."""
    if poles is None:
        if "kappa" in law:
            return second_order_poles(**law)
        return Foster(R=[law["tau_th"] / law[HEAT_CAPACITY]], tau=[law["tau_th"]])
    if not isinstance(poles, Foster):  # none of its numbers is free
        return poles
    R = [values.get(f"R{k}", float(resistance)) for k, resistance in enumerate(np.asarray(poles.R), 1)]
    tau = [values.get(f"tau{k}", float(time)) for k, time in enumerate(np.asarray(poles.tau), 1)]
    return Foster(R=R, tau=tau, inputs=poles.inputs, outputs=poles.outputs)
