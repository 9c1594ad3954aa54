"""Optical and carrier parameters of a ring, and the rates that follow from them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.constants import c, hbar

from thermofem import InputError, checks
from thermofem.data import dataset, files
from thermofem.ring_temperature import CORE, READS, GuidedMode

from . import ring_toml
from .carriers import LAWS, CarrierLaw


@dataclass(frozen=True)
class RingResonator:
    """Silicon ring on one or two buses: resonance, losses, and nonlinear detuning and damping.

        da/dt = [i D - gamma] a + i sqrt(2 gamma_e P),                       |a|^2 = U in J
        D     = -(w0 g) [(dn/dT) dT + S(N)] - kerr U - 2 pi detuning,        S(N) = sum_k c_k N^p_k
        gamma = gamma_e + gamma_d + gamma_i + gamma_s + eta_FCA N + eta_TPA U
        dN/dt = -N/tau(N) + g_TPA U^2
        P_abs = 2 (gamma_i + eta_FCA N + eta_TPA U) U

    with g = 1/n0, the printed rule, or G/n_g of the mode where ``index_confinement`` G is given.
    ``dataclasses.replace`` changes a field, and the derived rates with it; `with_rates` sets a derived rate itself;
    `from_quality_factors` and `from_toml` construct a ring from measured quantities.

    Parameters
    ----------
    name : str
        label of the ring in results.
    frequency : float, Hz
        cold resonance w0 / 2 pi.
    bus_rate : float, 1/s
        gamma_e, amplitude decay rate into the bus that the light comes from.
    loss_rate : float, 1/s
        gamma_i, amplitude decay rate by absorption at low power; all of it heats the core.
    refractive_index, group_index : float
        n0 of the material, in the resonance shift and two-photon rates; n_g of the mode, in free-carrier absorption.
    thermo_optic : float, 1/K
        dn/dT.
    fcd : tuple of (coefficient, exponent); m^(3 exponent), 1
        free-carrier dispersion, the index change sum_k c_k N^p_k with N in 1/m^3; carriers lower it, so c_k <= 0.
    fca_cross_section : float, m^2
        sigma_FCA of free-carrier absorption, as the paper counts it: c sigma_FCA N/n_g is the rate of the amplitude. Of
        a cross-section for power (alpha = sigma N, silicon's 1.45e-21 m^2) give half.
    tpa_coefficient : float, m/W
        beta of two-photon absorption.
    tpa_confinement, tpa_volume : float; 1, m^3
        Gamma_TPA and V_TPA, for the loss by two-photon absorption.
    fca_confinement, fca_volume : float; 1, m^3
        Gamma_FC and V_FCA, for the carriers made by it.
    carriers : ShockleyReadHall, ConstantLifetime or another of `coupled.carriers.LAWS`
        recombination, tau(N).
    lumped_fcd : float, m^3, optional
        coefficient of a single linear dispersion term for both carrier types, for Newton's law (`with_lumped_fcd`).
    drop_rate : float, 1/s, optional
        gamma_d, amplitude decay rate into the other bus; by default that of the first one, and 0 for a ring on one bus.
    scattering_rate : float, 1/s
        gamma_s, amplitude decay rate by scattering and radiation, without heating.
    kerr_coefficient : float, m^2/W
        n_2 of the Kerr effect, with the confinement and volume of two-photon absorption; silicon has 4.5e-18.
    index_confinement : float, optional
        G = dn_eff/dn of the mode (`thermofem.light`). The relative shift per index change is then G/n_g and eta_FCA is
        G c sigma_FCA/n_g; None for the printed rules 1/n0 and c sigma_FCA/n_g, with which Borghi et al. fitted their
        printed sigma_FCA.
    rates : tuple of (name, value)
        derived rates that are given instead of computed (`with_rates`).
    read : str
        the temperature that goes with ``thermo_optic``: "core", the mean over the heated part, for dn/dT of a material;
        "light", the output of that name, for dn_eff/dT of a whole section (`coupled.ring_from`).
    mode : GuidedMode, optional
        name and wavelength (m) of the mode whose temperature is "light"; a model with that of another one is refused.

    Raises
    ------
    InputError
        a number that is not finite or out of the range of its unit.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 2.1-2.5 and Table 1; with 2 gamma_e in the pump and at
    the drop port, which conserves energy where the printed gamma_e does not.
    """

    name: str
    frequency: float
    bus_rate: float
    loss_rate: float
    refractive_index: float
    group_index: float
    thermo_optic: float
    fcd: tuple[tuple[float, float], ...]
    fca_cross_section: float
    tpa_coefficient: float
    tpa_confinement: float
    tpa_volume: float
    fca_confinement: float
    fca_volume: float
    carriers: CarrierLaw
    lumped_fcd: float | None = None
    drop_rate: float | None = None
    scattering_rate: float = 0.0
    kerr_coefficient: float = 0.0
    index_confinement: float | None = None
    rates: tuple[tuple[str, float], ...] = ()
    read: str = CORE
    mode: GuidedMode | None = None

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.text("name", self.name)
        for name in ring_toml.FIELDS:
            if getattr(self, name) is not None:
                ring_toml.checked(name, getattr(self, name))
        hint = "ShockleyReadHall(...) or ConstantLifetime(30e-9) is needed"
        checks.instance("carriers", self.carriers, *LAWS, hint=hint)
        for name, value in self.rates:
            checks.choice("rates", name, ring_toml.RATES)
            checks.between(f"rates {name}", value, -math.inf if name == "thermal_shift" else 0, math.inf)
        checks.choice("read", self.read, READS)
        if self.mode is not None:
            checks.instance("mode", self.mode, GuidedMode, hint='GuidedMode("TE0", 1.55e-6) is one')
        _check_dispersion(self.fcd)

    @property
    def omega(self) -> float:
        """Angular frequency w0 = 2 pi frequency of the cold resonance, rad/s."""
        return 2 * math.pi * self.frequency

    @property
    def linear_rate(self) -> float:
        """Total linear amplitude decay rate gamma_e + gamma_d + gamma_i + gamma_s, 1/s."""
        return self.bus_rate + self.drop_bus_rate + self.loss_rate + self.scattering_rate

    @property
    def drop_bus_rate(self) -> float:
        """Amplitude decay rate gamma_d into the drop bus, 1/s; 0 for a ring on one bus."""
        return self.bus_rate if self.drop_rate is None else self.drop_rate

    @property
    def loaded_q(self) -> float:
        """Loaded Q of the cold ring, w0 / (2 (gamma_e + gamma_d + gamma_i + gamma_s))."""
        return self.omega / (2 * self.linear_rate)

    @property
    def intrinsic_q(self) -> float:
        """Intrinsic Q of the cold ring, w0 / (2 (gamma_i + gamma_s)); infinite without loss."""
        own = self.loss_rate + self.scattering_rate
        return self.omega / (2 * own) if own else math.inf

    @property
    def index_rate(self) -> float:
        """Decrease of the resonance frequency per unit increase of refractive index: w0/n0 or w0 G/n_g, rad/s."""
        if self.index_confinement is None:
            return self.omega / self.refractive_index
        return self.omega * self.index_confinement / self.group_index

    @property
    def thermal_shift(self) -> float:
        """Decrease of the resonance frequency per kelvin, `index_rate` dn/dT, rad/s/K."""
        return self._given("thermal_shift", self.index_rate * self.thermo_optic)

    @property
    def shift_per_kelvin(self) -> float:
        """Increase of the resonance wavelength per kelvin, lambda thermal_shift / omega, m/K."""
        return c / self.frequency * self.thermal_shift / self.omega

    @property
    def eta_fca(self) -> float:
        """Free-carrier amplitude loss rate per carrier density, c sigma_FCA/n_g, times G if given; m^3/s."""
        share = 1.0 if self.index_confinement is None else self.index_confinement
        return self._given("eta_fca", share * c * self.fca_cross_section / self.group_index)

    @property
    def eta_tpa(self) -> float:
        """Two-photon amplitude loss rate per energy, Gamma_TPA c^2 beta / (2 n0^2 V_TPA), 1/(s J)."""
        return self._given("eta_tpa", self.tpa_confinement * self._two_photon / self.tpa_volume)

    @property
    def g_tpa(self) -> float:
        """Carrier generation rate per squared energy, Gamma_FC c^2 beta / (2 n0^2 hbar w0 V_FCA^2), 1/(m^3 s J^2)."""
        made = self.fca_confinement * self._two_photon / (hbar * self.omega * self.fca_volume**2)
        return self._given("g_tpa", made)

    @property
    def kerr_shift(self) -> float:
        """Decrease of the resonance frequency per energy, Gamma_TPA w0 c n_2 / (n0^2 V_TPA), rad/(s J)."""
        each = c * self.kerr_coefficient / (self.refractive_index**2 * self.tpa_volume)
        return self._given("kerr_shift", self.tpa_confinement * self.omega * each)

    @property
    def _two_photon(self) -> float:
        """Common factor of the two-photon rates, c^2 beta / (2 n0^2), m^3/(s J)."""
        return c**2 * self.tpa_coefficient / (2 * self.refractive_index**2)

    def _given(self, name: str, computed: float) -> float:
        """Value of a derived rate: as set by `with_rates`, else ``computed``."""
        return dict(self.rates).get(name, computed)

    def with_rates(self, **values: float) -> RingResonator:
        """Return the ring with derived rates set: eta_fca, eta_tpa, g_tpa, thermal_shift, kerr_shift, in their units.

        A rate that is set does not change with the fields; ``dataclasses.replace(ring, rates=())`` makes all rates
        depend on the fields again.

        >>> from coupled import borghi2021
        >>> borghi2021().with_rates(eta_fca=2e-13).eta_fca
        2e-13
        """
        return replace(self, rates=tuple(sorted((dict(self.rates) | values).items())))

    @classmethod
    def from_quality_factors(
        cls,
        base: RingResonator,
        *,
        name: str,
        frequency: float,
        loaded_q: float,
        intrinsic_q: float,
        buses: int = 2,
        absorbed_fraction: float = 1.0,
        perimeter: float | None = None,
        mode_area: float | None = None,
    ) -> RingResonator:
        """Return a ring from measured quality factors and layout dimensions.

            gamma = w0/(2 Q_L),   gamma_i + gamma_s = w0/(2 Q_i),   V = perimeter x mode_area

        Parameters
        ----------
        base : RingResonator
            ring whose material and other numbers are taken, such as `borghi2021`.
        name, frequency : str, Hz
        loaded_q, intrinsic_q : float
            Q_L below Q_i.
        buses : int
            1 or 2; the coupling loss gamma - gamma_i - gamma_s is divided equally among them.
        absorbed_fraction : float
            fraction of the intrinsic loss that is absorbed and heats; the rest is scattered.
        perimeter, mode_area : float, m and m^2, optional
            both or none: the volume of two-photon absorption and of the carriers.

        Raises
        ------
        InputError
            Q_L not below Q_i, a number of buses other than 1 and 2, one of perimeter and mode_area alone, or both for a
            base whose rates are set and would not follow the new volume.
        """
        checks.instance("base", base, RingResonator, hint="coupled.borghi2021() is one")
        numbers: dict[str, Any] = ring_toml.rates_of(frequency, loaded_q, intrinsic_q, buses, absorbed_fraction)
        volume = {"perimeter": perimeter, "mode_area": mode_area}
        ring_toml.check_determined({k for k, v in volume.items() if v is not None}, tuple(volume), ())
        if perimeter is not None and mode_area is not None:
            fixed = sorted(dict(base.rates).keys() & {"eta_tpa", "g_tpa", "kerr_shift"})
            if fixed:
                raise InputError(
                    f"base has {' and '.join(fixed)} set by with_rates, which would not follow perimeter x mode_area; "
                    "start from replace(base, rates=()) and set them anew"
                )
            perimeter = checks.between("perimeter", perimeter, 1e-7, 1, unit="m", hint="did you mean 50e-6?")
            mode_area = checks.between("mode_area", mode_area, 1e-15, 1e-10, unit="m^2", hint="0.1 um^2 is 1e-13 m^2")
            numbers |= {"tpa_volume": perimeter * mode_area, "fca_volume": perimeter * mode_area}
        ring_toml.tell_base(base.name, base, numbers)
        return replace(base, name=name, **numbers)

    @classmethod
    def from_toml(cls, path: str | Path) -> RingResonator:
        """Read a ring from a TOML file with units in its text; `ring_toml` lists the keys.

        Raises
        ------
        InputError
            a file that cannot be read, an unknown or missing key, a wrong unit, or a number out of range.
        """
        return files.read_toml(path, "ring", cls.from_text)

    @classmethod
    def from_text(cls, text: str) -> RingResonator:
        """Read a ring from the text of a ring file, as `from_toml`."""
        return ring_toml.read_text(text, cls, PUBLISHED)

    def with_lumped_fcd(self) -> RingResonator:
        """Return the ring with a single linear dispersion term, ``lumped_fcd``, as fitted with Newton's law."""
        coefficient = checks.finite("lumped_fcd", self.lumped_fcd, unit="m^3", hint="or set fcd itself with replace")
        return replace(self, name=f"{self.name}, lumped FCD", fcd=((coefficient, 1.0),))

    def with_swapped_srh(self) -> RingResonator:
        """Return the ring with the lifetimes tau_n of electrons and tau_p of holes exchanged."""
        own: Any = self.carriers  # a ShockleyReadHall: one constant lifetime has nothing to exchange
        swapped = replace(own, tau_n=own.tau_p, tau_p=own.tau_n)
        return replace(self, name=f"{self.name}, swapped SRH", carriers=swapped)


def _check_dispersion(terms: Any) -> None:
    """Raise InputError unless every free-carrier term (c_k, p_k) has c_k <= 0 and is small at 1e23 carriers per m^3."""
    if not isinstance(terms, tuple | list) or not terms or any(np.shape(term) != (2,) for term in terms):
        said = f"fcd = {checks.shown(terms)} is empty, or no sequence of (coefficient, exponent)"
        raise InputError(said, "for no free-carrier dispersion give ((0.0, 1.0),)")
    for coefficient, exponent in terms:
        checks.between("fcd exponent", exponent, 0.3, 3)
        moved = checks.finite("fcd coefficient", coefficient) * 1e23**exponent
        hint = "it is negative, and N counts per m^3: multiply one for cm^-3 by 1e-6 to the power of its exponent"
        checks.between("fcd index change at 1e23 per m^3", moved, -0.05, 0, hint=hint)


PUBLISHED: dict[str, Callable[[], RingResonator]] = {}
"""Published rings by the name of their function; `coupled.parameters` adds them with `published`."""


def published(ring: Callable[[], RingResonator]) -> Callable[[], RingResonator]:
    """Decorator that registers a function returning a published ring, so that ring files can name it as "base"."""
    PUBLISHED[ring.__name__] = ring
    return ring


def origin(kind: str, ring: RingResonator) -> dict[str, Any]:
    """Attributes common to all Datasets of the package: kind of the Dataset, name and parameters of the ring."""
    return dataset.stamp(kind) | {"ring": ring.name, "ring_parameters": _text_of(ring)}


@lru_cache(maxsize=1000)
def _text_of(ring: RingResonator) -> str:
    return parameters(ring)


def parameters(made: Any) -> str:
    """The fields of a ring or circuit, and of the dataclasses in it, as JSON text."""
    return json.dumps(made, default=lambda one: {field.name: getattr(one, field.name) for field in fields(one)})
