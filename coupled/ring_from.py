"""Parameters of a ring from its cross-section, by mode calculation, each with its origin.

    gamma_e = -(v_g/2L) ln(1 - kappa^2),     gamma_i = loss v_g/2,     v_g = c/n_g,     L = 2 pi R + 2 straight
    w0: frequency nearest to the given wavelength at which n_eff R w/c is an integer

Heat: (dn/dT) G = dn_eff/dT, so that w0 G/n_g (dn/dT) T is the shift by the temperature of the output "light".
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.constants import c

import thermofem as th
from thermofem import InputError, checks
from thermofem.data import quantity
from thermofem.geometry import Bus
from thermofem.geometry.resistor import fsr_power
from thermofem.geometry.section_parts import LIGHT
from thermofem.optics import mode_derivatives
from thermofem.optics.coupler import MOST_COUPLING, STEP, TRUSTED, of_buses
from thermofem.optics.mode_window import ROOM
from thermofem.ring_temperature import GuidedMode, detuning_output

from . import ring_toml
from .carriers import ConstantLifetime
from .parameters import borghi2021
from .resonator import PUBLISHED, RingResonator

if TYPE_CHECKING:
    import xarray as xr

    from thermofem.fem import HeatProblem
    from thermofem.geometry import CrossSection
    from thermofem.optics.coupler import Coupling
    from thermofem.optics.mode import Mode


INTEGRAL_ERROR = 1e-3  # relative, of integrals over the mode
NEAR_ROOM = 20.0  # K, within which the numbers of a base ring, measured at room temperature, are taken as they are

log = logging.getLogger("thermofem")


class Origin(NamedTuple):
    """Value of a ring parameter, its origin and its error.

    value: as in the ring.
    origin: "computed: ...", "given" or "base ...".
    error: estimated relative error; nan where none is known.
    """

    value: Any
    origin: str
    error: float = math.nan

    def __str__(self) -> str:
        return self.origin + (f", within {self.error * 100:.2g} %" if self.error > 0 else "")


@dataclass(frozen=True, eq=False)
class MadeRing:
    """A ring computed from a cross-section, with the origin of its parameters: result of `ring_from`.

    origins [dict from field to Origin]
    mode: the optical mode of the ring.
    """

    ring: RingResonator
    origins: dict[str, Origin]
    mode: Mode
    _loss: float = field(repr=False)
    _buses: tuple[_Bus, ...] = field(repr=False)
    _rules: dict[str, bool] = field(repr=False)

    def to_toml(self) -> str:
        """The text of a ring file, with the origin of each parameter as a comment."""
        return ring_toml.write_text(self.ring, {key: str(origin) for key, origin in self.origins.items()})

    def derivatives(self, parameters: Sequence[str | Sequence[str]]) -> xr.Dataset:
        """Derivatives of every computed parameter of the ring by ``parameters``, geometry paths as in a campaign.

        Paths: the lengths of the section (at constant gap), indices and thermo_optic of materials, "light.loss",
        "light.wavelength", and gap and straight of a [[bus]]. The order of the resonance and the radiation loss of
        the bend are constant. With derivatives of a cycle by these numbers (`cycle_derivatives`) and of the poles
        (`pole_derivatives`), `chain` gives d(period)/d(width) including optics and heat. Error against finite
        differences on the same deformed mesh: 1e-6 (measured).

        Returns
        -------
        xarray.Dataset
            over "parameter", per SI unit of it, one variable for each field; kappa^2 of each bus, value and unit of the
            parameter.

        Raises
        ------
        InputError
            as `thermofem.optics.Mode.derivatives`.
        """
        numbers = _numbers(self.mode, self._loss, self._buses, self._rules)
        order = _order(self.mode)
        varied = mode_derivatives.variations(self.mode.light, parameters)
        rows = []
        for variation in varied:
            slopes = mode_derivatives.slopes(self.mode, variation, **self._rules)
            slopes["loss"] = variation.change.of_optics("light", "loss")
            for k, bus in enumerate(self._buses):
                slopes[f"kappa {k}"] = bus.coupling.derivative(variation, bus.name) if bus.coupling else 0.0
            moved_numbers = {name: value + 1j * STEP * slopes[name] for name, value in numbers.items()}
            moved = fields_of(moved_numbers, order, self.mode.light.geometry.straight)
            kappas = {name.replace(" ", "_"): slope for name, slope in slopes.items() if name.startswith("kappa")}
            rows.append({name: float(value.imag) / STEP for name, value in moved.items()} | kappas)
        return mode_derivatives.over_parameters(
            varied, rows, {name: (ring_toml.UNITS.get(name) or "1", name) for name in rows[0]}
        )


class _Bus(NamedTuple):
    """A bus: name, kappa^2, origin and relative error of kappa^2, and the coupling if it was computed."""

    name: str
    power: float
    origin: str
    error: float
    coupling: Coupling | None


def ring_from(
    geometry: CrossSection | HeatProblem,
    *,
    wavelength: float | None = None,
    loss: float | str | None = None,
    gap: float | None = None,
    coupling: float | None = None,
    straight: float = 0.0,
    buses: int | None = None,
    base: RingResonator | None = None,
    mode: str | None = None,
    dispersion: bool = False,
    spread_carriers: bool = False,
) -> MadeRing:
    """Return the ring of a cross-section, with the origin of every number.

    Parameters
    ----------
    geometry : CrossSection or HeatProblem
        a ring; its perimeter is 2 pi R, of a racetrack ([plan] straight) 2 pi R + 2 straight. The straights have the
        mode of the bends, and radiate nothing; a bus runs along one of them.
    wavelength : float, m
        the resonance nearest to it is taken; default that of [light] in the geometry.
    loss : float, 1/m, or text such as "7 dB/cm"
        power loss of the waveguide, all of it absorbed; default that of [light]. Bend radiation and the leak into a
        substrate, as of a straight guide, are added as scattering_rate, leak v_g/2.
    gap, coupling : float, m and 1
        of each bus, one of the two: its gap, from which kappa^2 is computed (within 20 %), or kappa^2; default the
        [[bus]] tables of the geometry.
    straight : float, m
        of a circle's geometry that stands for a racetrack of the same perimeter: length of each of two straight
        sections beside the buses; the bends have R - straight/pi.
    buses : int
        1 or 2; default 2, or as many as [[bus]] tables.
    base : RingResonator
        parameters not computed: carriers, sigma_FCA, two-photon absorption. Default `borghi2021` for silicon; another
        core has no carriers, and the two-photon coefficient and n_2 of its material.
    mode : str
        such as "TM0"; default that of [light], or TE0.
    dispersion, spread_carriers : bool
        rules for the volumes, see `thermofem.optics.Mode.volume`; the defaults are those of the paper's Table 2.

    Raises
    ------
    InputError
        no guided mode; no wavelength, loss or bus; kappa^2 above 0.5; a base of silicon for another core.

    >>> import coupled, thermofem as th
    >>> made = coupled.ring_from(th.strip_ring(), wavelength=1.555e-6, loss=161.0, coupling=0.063)
    >>> round(made.ring.loaded_q, -3), made.origins["tpa_volume"].origin
    (6000.0, 'computed: mode TE0')
    """
    guided = th.light(geometry, wavelength=wavelength).mode(mode)
    section = guided.light.geometry
    if section.kind != "ring":
        raise InputError(f"{section.name!r} is a straight section; a ring is needed")
    stated = loss if loss is not None or section.light is None else section.light.loss
    if stated is None:
        raise InputError('loss is missing; give it, such as "2 dB/cm", or loss in [light] of the geometry')
    alpha = quantity.parse(stated, "1/m", name="loss") if isinstance(stated, str) else stated
    hint = '7 dB/cm are 161 1/m; text such as "7 dB/cm" is taken, too'
    alpha = checks.between("loss", alpha, 0, 1e6, unit="1/m", hint=hint)
    base = base_of(base, section.material_of(guided.core), guided.wavelength)
    rules = {"dispersion": dispersion, "spread_carriers": spread_carriers}
    with_power = _buses(guided, gap, coupling, straight, buses)
    numbers = _numbers(guided, alpha, with_power, rules)
    fields: dict[str, Any] = fields_of(numbers, _order(guided), section.straight)
    bent = 2 * math.pi * guided.radius / section.path_length(guided.radius)
    fields["scattering_rate"] = guided.radiation_rate * bent + guided.leak_rate
    fields["read"] = LIGHT
    fields["mode"] = GuidedMode(guided.name, guided.wavelength)
    _tell_ambient(guided, base)
    ring = replace(base, name=f"{section.name}, {guided.name}", rates=(), **fields)
    ring_toml.tell_base(_name(base), base, fields)
    origins = _origins(ring, base, guided, with_power)
    return MadeRing(ring, origins, guided, alpha, with_power, rules)


def _tell_ambient(mode: Mode, base: RingResonator) -> None:
    """Log what is not known away from room temperature: the slope of dn/dT, and the carriers of the base."""
    section = mode.light.geometry
    if abs(section.ambient - ROOM) > NEAR_ROOM:
        log.warning(
            "%s: at %g K the indices follow by dn/dT of room temperature; carriers, absorption and two-photon "
            "absorption are those of %s at room temperature",
            section.name, section.ambient, _name(base),
        )  # fmt: skip


def _numbers(mode: Mode, loss: float, buses: Sequence[_Bus], rules: dict[str, bool]) -> dict[str, float]:
    """Optical parameters of a mode (`mode_derivatives.numbers`), the loss (1/m), and kappa^2 of every bus, by name."""
    kappas = {f"kappa {k}": bus.power for k, bus in enumerate(buses)}
    return mode_derivatives.numbers(mode, **rules) | {"loss": loss} | kappas


def _order(mode: Mode) -> int:
    """Number of wavelengths around the ring, n_eff L/lambda, rounded."""
    return round(mode.n_eff * mode.light.geometry.path_length(mode.radius) / mode.wavelength)


def fields_of(n: Mapping[str, Any], order: int, straight: float = 0.0) -> dict[str, Any]:
    """Fields of a ring by name, at resonance order ``order``, from mode, loss and buses; real or complex (derivatives).

    n: as `thermofem.optics.mode_derivatives.numbers`, and loss [1/m], "kappa 0" and "kappa 1" (kappa^2).
    straight [m]: length of each of the two straights of a racetrack.
    """
    length = 2 * math.pi * n["radius"] + 2 * straight
    speed = c / n["n_g"]
    rates = [-speed / (2 * length) * np.log1p(-n[name]) for name in n if name.startswith("kappa")]
    return {
        "frequency": c / n["wavelength"] + order * speed / length - n["n_eff"] * speed / n["wavelength"],
        "bus_rate": rates[0],
        "drop_rate": rates[1] if len(rates) > 1 else 0.0,
        "loss_rate": n["loss"] * speed / 2,
        "refractive_index": n["index"],
        "group_index": n["n_g"],
        "index_confinement": n["index_confinement"],
        "thermo_optic": n["thermo_optic"] * n["n_g"] / n["index_confinement"],
        "tpa_confinement": n["core_fraction_2"],
        "tpa_volume": n["volume_2"],
        "fca_confinement": n["core_fraction_3"],
        "fca_volume": n["volume_3"],
    }


def _origins(ring: RingResonator, base: RingResonator, mode: Mode, buses: Sequence[_Bus]) -> dict[str, Origin]:
    """Origin and relative error of every field of the ring, by name."""
    error = mode.error / mode.n_eff
    computed = f"computed: mode {mode.name}"
    leak = f", and leak of {mode.substrate_loss:.3g} dB/cm" if mode.leak_rate else ""
    away = (ring.frequency - c / mode.wavelength) / 1e9
    origins: dict[str, Origin] = {}

    def say(name: str, origin: str, error: float = math.nan) -> None:
        origins[name] = Origin(getattr(ring, name), origin, error)

    say("frequency", f"{computed}, order {_order(mode)}, {away:.3g} GHz away", error)
    say("bus_rate", buses[0].origin, buses[0].error)
    say("drop_rate", "given", 0.0)
    if len(buses) > 1:
        say("drop_rate", buses[1].origin, buses[1].error)
    say("loss_rate", "given: loss times v_g/2", error)
    say("scattering_rate", f"{computed}, radiation{leak}", 0.02 if ring.scattering_rate else 0.0)
    say("refractive_index", f"computed: index law of {mode.core_material}")
    say("group_index", computed, error)
    say("index_confinement", f"{computed}, dn_eff/dn of {mode.core_material}", INTEGRAL_ERROR)
    say("thermo_optic", *_shift(computed, mode))
    say("read", f"the temperature that goes with thermo_optic, weighted by mode {mode.name}")
    say("mode", "name and wavelength (m) of that mode")
    for name in ("tpa_confinement", "tpa_volume", "fca_confinement", "fca_volume"):
        say(name, computed, INTEGRAL_ERROR)
    of_base = f"base {_name(base)}"
    for name in ("fcd", "fca_cross_section", "tpa_coefficient", "kerr_coefficient", "carriers", "lumped_fcd"):
        say(name, of_base)
    ambient = mode.light.geometry.ambient
    if abs(ambient - ROOM) > NEAR_ROOM:
        say("carriers", f"{of_base}, of room temperature; the chip has {ambient:g} K")
    return origins


def _shift(computed: str, mode: Mode) -> tuple[str, float]:
    """Origin of thermo_optic, and its relative error; nan where dn/dT of a cladding is missing."""
    if mode.lacking:
        return f"{computed}, without {' and '.join(mode.lacking)}, whose dn/dT is missing", math.nan
    return f"{computed}, with the cladding's share", INTEGRAL_ERROR


def _name(base: RingResonator) -> str:
    """Name of a base ring; for a published ring the one used in ring files."""
    return next((name for name, one in PUBLISHED.items() if one() == base), base.name)


def base_of(base: RingResonator | None, material: Any, wavelength: float) -> RingResonator:
    """The ring whose parameters are used for all that does not follow from the geometry: ``base`` or the default."""
    low, high = ring_toml.SILICON
    silicon = low < material.index.index(wavelength) < high
    if base is not None:
        checks.instance("base", base, RingResonator, hint="coupled.borghi2021() is one")
        if not silicon and low < base.refractive_index < high:
            raise InputError(
                f"base {base.name!r} is a ring of silicon, and the core is {material.name}",
                "leave base out, or give a ring with the two-photon coefficient and the carriers of this material",
            )
        return base
    if silicon:
        return borghi2021()
    return replace(
        borghi2021(),
        name=f"of the material {material.name}",
        fcd=((0.0, 1.0),),
        fca_cross_section=0.0,
        tpa_coefficient=material.two_photon,
        kerr_coefficient=material.kerr,
        carriers=ConstantLifetime(1e-9),  # of none
        lumped_fcd=None,
    )


def _buses(
    mode: Mode, gap: float | None, coupling: float | None, straight: float, count: int | None
) -> tuple[_Bus, ...]:
    """The buses with kappa^2, given as ``coupling``, computed from ``gap``, or from the [[bus]] tables."""
    section = mode.light.geometry
    neither = gap is None and coupling is None
    both = gap is not None and coupling is not None
    if both or (neither and not section.buses):
        rule = "gap and coupling are missing" if neither else "gap and coupling are both given"
        raise InputError(rule, "give the gap in m or kappa^2, one of them, or [[bus]] with its gap in the geometry")
    usual = len(section.buses) if neither else 2
    number = checks.integer("buses", count or usual, 1, 2)
    if coupling is not None:
        hint = "it is the power that a bus takes in one pass; the rate model fails above 0.5"
        power = checks.between("coupling", coupling, 1e-9, MOST_COUPLING, hint=hint)
        return (_Bus("", power, "given: kappa^2", 0.0, None),) * number
    guides = section.buses
    if gap is not None:
        guides = (Bus("gap", checks.positive("gap", gap, unit="m"), straight),)
    buses = []
    for bus, coupler in zip(guides, of_buses(mode, guides), strict=True):
        origin = (
            f"computed: kappa^2 = {coupler.power:.4f} of the supermodes, {coupler.by_gap * 1e-7:+.1f} % per nm of gap, "
            f"{coupler.by_width * 1e-7:+.1f} % per nm of width"
        )
        buses.append(_Bus(bus.name, coupler.power, origin, TRUSTED, coupler))
    return tuple((buses * number)[:number])


def chain(of_cycle: xr.Dataset, slopes: Mapping[str, float]) -> dict[str, float]:
    """Chain rule for the derivatives of period (s), duty, swing (K) and extinction (dB) by one geometry parameter p.

        d(period)/d(p) = sum over numbers x of d(period)/dx dx/dp

    Parameters
    ----------
    of_cycle : Dataset
        of `cycles.derivatives.cycle_derivatives`.
    slopes : dict from number to float
        dx/dp of the ring (`MadeRing.derivatives`) and the poles "R1", "tau1", ... (`pole_derivatives` of surrogate).
    """
    names = [name for name in map(str, of_cycle.parameter.values) if name in slopes]
    weights = [slopes[name] for name in names]
    kept = of_cycle.sel(parameter=names)
    return {key: float(kept[key].values @ weights) for key in ("period", "duty", "swing", "extinction")}


def tuning(ring: RingResonator, model: Any, heated: str | None = None, read: str | None = None) -> dict[str, float]:
    """Thermal tuning of a ring by one channel of a thermal model: a dict of floats.

        shift_per_kelvin (m/K),   shift_per_watt = shift_per_kelvin R_th (m/W)
        pi_power = lambda^2/(2 n_g L shift_per_watt) (W), where the model's file records the geometry

    pi_power shifts the resonance by half a free spectral range c/(n_g L), with the round trip L of the heated part.
    """
    part = heated or model.inputs[0]
    several = len(model.inputs) > 1 or len(model.outputs) > 1
    output = read or detuning_output(ring.read, part, tuple(model.outputs))
    R = float((model.channel(part, output) if several else model).thermal_resistance)
    numbers = {"shift_per_kelvin": ring.shift_per_kelvin, "shift_per_watt": ring.shift_per_kelvin * R}
    text = (getattr(model, "origin", None) or {}).get("geometry")
    section = th.CrossSection.from_toml_text(text) if text else None
    if section is None or section.kind != "ring":
        return numbers
    cores = [one for one in section.parts if one.name == part]
    if cores and R > 0:
        length = section.path_length(cores[-1].centre)
        numbers["pi_power"] = fsr_power(c / ring.frequency, ring.group_index, length, numbers["shift_per_watt"]) / 2
    return numbers
