"""A ring from its cross-section: the optics computed, each number with its origin.

    gamma_e = -(v_g/2L) ln(1 - kappa^2),     gamma_i = loss v_g/2,     v_g = c/n_g,     L = 2 pi R
    w0: where nu = n_eff R w/c is whole, next to the given wavelength

Heat: (dn/dT) G = dn_eff/dT, so that w0 G/n_g (dn/dT) T is the shift by the temperature read as "light".
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from scipy.constants import c

import thermofem as th
from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import quantity

from . import ring_toml
from .carriers import ConstantLifetime
from .parameters.borghi2021 import borghi2021
from .resonator import PUBLISHED, RingResonator

if TYPE_CHECKING:
    from thermofem.fem import HeatProblem
    from thermofem.geometry import CrossSection
    from thermofem.optics.modes import Mode

TIGHT = 20.0  # exponent of a bend's tunnelling; beyond it Q_rad is above 1e9 and not computed


class Origin(NamedTuple):
    """Where a number of a ring comes from.

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
    """A ring and the origin of its numbers, as `ring_from` returns them.

    origins [dict from field to Origin]
    mode: the mode that it is made from.
    """

    ring: RingResonator
    origins: dict[str, Origin]
    mode: Mode

    def to_toml(self) -> str:
        """The text of a ring file, with the origin beside each number."""
        return ring_toml.write_text(self.ring, {key: str(origin) for key, origin in self.origins.items()})


def ring_from(
    geometry: CrossSection | HeatProblem,
    *,
    wavelength: float,
    loss: float | str,
    gap: float | None = None,
    coupling: float | None = None,
    straight: float = 0.0,
    buses: int = 2,
    base: RingResonator | None = None,
    mode: str = "TE0",
    dispersion: bool = False,
    spread_carriers: bool = False,
) -> MadeRing:
    """Return the ring of a cross-section, with the origin of every number.

    Parameters
    ----------
    geometry : CrossSection or HeatProblem
        a ring; its perimeter is 2 pi R.
    wavelength : float, m
        the resonance next to it is taken.
    loss : float, 1/m, or text such as "7 dB/cm"
        power loss of the guide, all of it absorbed. What a tight bend radiates is added as scattering.
    gap, coupling : float, m and 1
        of each bus, one of the two: its gap, from which kappa^2 is computed (within 20 %), or kappa^2.
    straight : float, m
        length of each of two straight sections of a racetrack with that perimeter; its bends have R - straight/pi.
    buses : int
        1 or 2.
    base : RingResonator
        what is no geometry: carriers, sigmas, two-photon coefficient. Default `borghi2021` for a core of silicon;
        another core has no carriers, and the two-photon coefficient and n_2 of its material.
    mode : str
        such as "TM0".
    dispersion, spread_carriers : bool
        rules for the volumes, see `thermofem.optics.Mode.volume`; the defaults are those of the paper's Table 2.

    Raises
    ------
    InputError
        no guided mode; neither or both of gap and coupling; kappa^2 above 0.5; a base of silicon for another core.

    >>> import coupled, thermofem as th
    >>> made = coupled.ring_from(th.strip_ring(), wavelength=1.555e-6, loss=161.0, coupling=0.063)
    >>> round(made.ring.loaded_q, -3), made.origins["tpa_volume"].origin
    (6000.0, 'computed: mode TE0')
    """
    found = th.light(geometry, wavelength=wavelength).mode(mode)
    section = found.light.geometry  # type: ignore[union-attr]
    if section.kind != "ring":
        raise InputError(f"{section.name!r} is a straight section; a ring is needed")
    alpha = quantity.parse(loss, "1/m", name="loss") if isinstance(loss, str) else loss
    hint = '7 dB/cm are 161 1/m; text such as "7 dB/cm" is taken, too'
    alpha = checks.between("loss", alpha, 0, 1e6, unit="1/m", hint=hint)
    buses = checks.integer("buses", buses, 1, 2)
    if (gap is None) == (coupling is None):
        raise InputError("gap and coupling: give one of them, the gap in m or kappa^2")
    material = section.material_of(found.core)
    base = _base(base, material, wavelength)
    length, speed = 2 * math.pi * found.radius, c / found.n_g
    error = found.error / found.n_eff
    computed = f"computed: mode {found.name}"
    whole = round(found.order)
    moved = (whole - found.order) * c / (found.n_g * found.radius) / (2 * math.pi)
    power, how = _coupling(found, gap, coupling, straight)
    bus = -speed / (2 * length) * math.log1p(-power)
    radiated = _radiated(found)
    G = found.confinement[found.core_material]
    values = {
        "frequency": Origin(c / wavelength + moved, f"{computed}, order {whole}, {moved / 1e9:.3g} GHz away", error),
        "bus_rate": Origin(bus, how[0], how[1]),
        "drop_rate": Origin(bus if buses == 2 else 0.0, how[0] if buses == 2 else "given", how[1] * (buses == 2)),
        "loss_rate": Origin(alpha * speed / 2, "given: loss times v_g/2", error),
        "scattering_rate": Origin(radiated, f"{computed}, radiation", 0.02 if radiated else 0.0),
        "refractive_index": Origin(found.light.core_index, f"computed: index law of {material.name}"),  # type: ignore[union-attr]
        "group_index": Origin(found.n_g, computed, error),
        "index_confinement": Origin(G, f"{computed}, dn_eff/dn of {material.name}", 1e-3),
        "thermo_optic": Origin(found.index_slope / G, f"{computed}, with the cladding's share", 1e-3),
        "tpa_confinement": Origin(found.core_fraction(2), computed, 1e-3),
        "tpa_volume": Origin(found.volume(2, dispersion=dispersion), computed, 1e-3),
        "fca_confinement": Origin(found.core_fraction(3, spread_carriers=spread_carriers), computed, 1e-3),
        "fca_volume": Origin(found.volume(3, dispersion=dispersion, spread_carriers=spread_carriers), computed, 1e-3),
    }
    fields: dict[str, Any] = {name: one.value for name, one in values.items()}
    ring = replace(base, name=f"{section.name}, {found.name}", rates=(), **fields)
    others = ("fcd", "fca_cross_section", "tpa_coefficient", "kerr_coefficient", "carriers", "lumped_fcd")
    of = next((name for name, one in PUBLISHED.items() if one() == base), base.name)
    ring_toml.tell_base(of, base, fields)
    rest = {name: Origin(getattr(ring, name), f"base {of}") for name in others}
    return MadeRing(ring, values | rest, found)


def _base(base: RingResonator | None, material: Any, wavelength: float) -> RingResonator:
    """The ring that gives what no geometry gives."""
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


def _coupling(mode: Mode, gap: float | None, given: float | None, straight: float) -> tuple[float, tuple[str, float]]:
    """kappa^2 of a bus, and its origin with the error."""
    from thermofem.optics.coupler import MOST, TRUSTED, coupling

    if given is not None:
        hint = "it is the power that a bus takes in one pass; the rate model fails above 0.5"
        return checks.between("coupling", given, 1e-9, MOST, hint=hint), ("given: kappa^2", 0.0)
    found = coupling(mode, gap, straight, radius=mode.radius - straight / math.pi)  # type: ignore[arg-type]
    how = (
        f"computed: kappa^2 = {found.power:.4f} of the supermodes, {found.by_gap * 1e-7:+.1f} % per nm of gap, "
        f"{found.by_width * 1e-7:+.1f} % per nm of width"
    )
    return found.power, (how, TRUSTED)


def _radiated(mode: Mode) -> float:
    """Amplitude rate w/(2 Q_rad) in 1/s; 0 where a bend is so wide that Q_rad is above 1e9."""
    clad = mode.light.cladding_index  # type: ignore[union-attr]
    decay = mode.k0 * math.sqrt(mode.n_eff**2 - clad**2)
    if 2 / 3 * mode.radius * 1e6 * decay**3 / mode.square > TIGHT:
        return 0.0
    quality = mode.q_radiation
    if quality < 1e3:
        raise InputError(
            f"the bend of {mode.radius * 1e6:g} um radiates: Q = {quality:.3g}", "take a larger radius or a wider core"
        )
    rate = math.pi * c / mode.wavelength / quality
    return rate if rate > 1e5 else 0.0


def tuning(ring: RingResonator, model: Any, heated: str | None = None, read: str | None = None) -> dict[str, float]:
    """Thermal tuning of a ring by one channel of a thermal model.

        shift_per_kelvin (m/K),   shift_per_watt = shift_per_kelvin R_th (m/W)
        pi_power = pi c/(n_g L thermal_shift R_th) (W), where the model's file records the geometry

    pi_power moves the resonance by half a free spectral range c/(n_g L), with the round trip L of the heated part.
    """
    part = heated or model.inputs[0]
    several = len(model.inputs) > 1 or len(model.outputs) > 1
    R = float((model.channel(part, read or part) if several else model).thermal_resistance)
    numbers = {"shift_per_kelvin": ring.shift_per_kelvin, "shift_per_watt": ring.shift_per_kelvin * R}
    text = (getattr(model, "origin", None) or {}).get("geometry")
    section = th.CrossSection.from_toml_text(text) if text else None
    cores = [one for one in section.parts if one.name == part] if section and section.kind == "ring" else []
    if cores and R > 0:
        length = math.pi * (cores[-1].inner_radius + cores[-1].outer_radius)
        numbers["pi_power"] = math.pi * c / (ring.group_index * length * ring.thermal_shift * R)
    return numbers
