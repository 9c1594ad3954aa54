"""The ring as light and carriers see it: every number a caller may vary, and the rates that follow from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from thermofem import checks

from .carriers import ShockleyReadHall

_RATE_HINT = "amplitude rates are in 1/s (did you mean 43e9?)"
_VOLUME_HINT = "volumes are in m^3 (1 um^3 is 1e-18)"


@dataclass(frozen=True)
class RingResonator:
    """Silicon add-drop ring: resonance, losses, and the three ways in which its own light detunes and damps it.

        da/dt = [i D - gamma] a + i sqrt(2 gamma_e P),            |a|^2 = U in J
        D     = -(w0/n0) [(dn/dT) dT + S(N)] - 2 pi detuning,     S(N) = sum_k c_k N^p_k
        gamma = 2 gamma_e + gamma_i + eta_FCA N + eta_TPA U
        dN/dt = -N/tau(N) + g_TPA U^2

    ``dataclasses.replace`` varies a field; the derived rates follow.

    Parameters
    ----------
    name : str
        what the results are labelled with.
    frequency : float, Hz
        cold resonance w0 / 2 pi.
    bus_rate : float, 1/s
        gamma_e, amplitude decay rate into each of the two bus waveguides.
    loss_rate : float, 1/s
        gamma_i, amplitude decay rate by absorption at low power; all of it heats the core.
    refractive_index, group_index : float
        n0 of the material, in the resonance shift and two-photon rates; n_g of the mode, in free-carrier absorption.
    thermo_optic : float, 1/K
        dn/dT.
    fcd : tuple of (coefficient, exponent); m^(3 exponent), 1
        free-carrier dispersion, the index change sum_k c_k N^p_k with N in 1/m^3; carriers lower it, so c_k <= 0.
    fca_cross_section : float, m^2
        sigma_FCA of free-carrier absorption.
    tpa_coefficient : float, m/W
        beta of two-photon absorption.
    tpa_confinement, tpa_volume : float; 1, m^3
        Gamma_TPA and V_TPA, for the loss by two-photon absorption.
    fca_confinement, fca_volume : float; 1, m^3
        Gamma_FC and V_FCA, for the carriers made by it.
    carriers : ShockleyReadHall
        recombination, tau(N).
    lumped_fcd : float, m^3, optional
        the one coefficient that stands for both carrier kinds where heat follows Newton's law (`with_lumped_fcd`).

    Raises
    ------
    InputError
        a number that is not finite or out of the range of its unit.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 2.1-2.5 and Table 1; drive and drop with 2 gamma_e, which
    conserves energy where the printed gamma_e does not.
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
    carriers: ShockleyReadHall
    lumped_fcd: float | None = None

    def __post_init__(self) -> None:
        checks.between("frequency", self.frequency, 1e13, 1e16, unit="Hz", hint="did you mean 192.88e12?")
        checks.between("bus_rate", self.bus_rate, 1e6, 1e13, unit="1/s", hint=_RATE_HINT)
        checks.between("loss_rate", self.loss_rate, 1e5, 1e13, unit="1/s", hint=_RATE_HINT)
        checks.between("refractive_index", self.refractive_index, 1, 10)
        checks.between("group_index", self.group_index, 1, 10)
        checks.between("thermo_optic", self.thermo_optic, -1e-2, 1e-2, unit="1/K", hint="silicon has 1.86e-4")
        hint = "cross-sections are in m^2 (1.5e-17 cm^2 is 1.5e-21)"
        checks.between("fca_cross_section", self.fca_cross_section, 0, 1e-18, unit="m^2", hint=hint)
        hint = "0.81 cm/GW is 8.1e-12 m/W"
        checks.between("tpa_coefficient", self.tpa_coefficient, 0, 1e-9, unit="m/W", hint=hint)
        for kind in ("tpa", "fca"):
            checks.between(f"{kind}_confinement", getattr(self, f"{kind}_confinement"), 0, 2)
            volume = getattr(self, f"{kind}_volume")
            checks.between(f"{kind}_volume", volume, 1e-22, 1e-12, unit="m^3", hint=_VOLUME_HINT)
        _check_dispersion(self.fcd)
        if self.lumped_fcd is not None:
            _check_dispersion(((self.lumped_fcd, 1.0),))

    @property
    def omega(self) -> float:
        """w0 = 2 pi frequency in rad/s."""
        return 2 * math.pi * self.frequency

    @property
    def linear_rate(self) -> float:
        """2 gamma_e + gamma_i in 1/s: the amplitude decay rate of the cold ring."""
        return 2 * self.bus_rate + self.loss_rate

    @property
    def loaded_q(self) -> float:
        """w0 / (2 (2 gamma_e + gamma_i))."""
        return self.omega / (2 * self.linear_rate)

    @property
    def intrinsic_q(self) -> float:
        """w0 / (2 gamma_i)."""
        return self.omega / (2 * self.loss_rate)

    @property
    def index_rate(self) -> float:
        """w0 / n0 in rad/s: the resonance shift for a unit change of index, with the sign turned."""
        return self.omega / self.refractive_index

    @property
    def thermal_shift(self) -> float:
        """(w0/n0) dn/dT in rad/s/K: how far the resonance moves down for one kelvin."""
        return self.index_rate * self.thermo_optic

    @property
    def eta_fca(self) -> float:
        """c sigma_FCA / n_g in m^3/s: amplitude loss rate for a unit carrier density."""
        from scipy.constants import c

        return c * self.fca_cross_section / self.group_index

    @property
    def eta_tpa(self) -> float:
        """Gamma_TPA c^2 beta / (2 n0^2 V_TPA) in 1/(s J): amplitude loss rate for a unit energy."""
        return self.tpa_confinement * self._two_photon / self.tpa_volume

    @property
    def g_tpa(self) -> float:
        """Gamma_FC c^2 beta / (2 n0^2 hbar w0 V_FCA^2) in 1/(m^3 s J^2): carriers made by a unit energy squared."""
        from scipy.constants import hbar

        return self.fca_confinement * self._two_photon / (hbar * self.omega * self.fca_volume**2)

    @property
    def _two_photon(self) -> float:
        """c^2 beta / (2 n0^2) in m^3/(s J)."""
        from scipy.constants import c

        return c**2 * self.tpa_coefficient / (2 * self.refractive_index**2)

    def with_lumped_fcd(self) -> RingResonator:
        """Return the ring with free-carrier dispersion lumped into one linear term, as it belongs to Newton's law."""
        if self.lumped_fcd is None:
            raise checks.InputError(f"ring {self.name!r} has no lumped_fcd; give one, or set fcd itself with replace")
        return replace(self, name=f"{self.name}, lumped FCD", fcd=((self.lumped_fcd, 1.0),))

    def with_swapped_srh(self) -> RingResonator:
        """Return the ring with the electron and the hole lifetime exchanged."""
        swapped = replace(self.carriers, tau_n=self.carriers.tau_p, tau_p=self.carriers.tau_n)
        return replace(self, name=f"{self.name}, swapped SRH", carriers=swapped)


def _check_dispersion(terms: tuple[tuple[float, float], ...]) -> None:
    """Raise InputError unless every term is (coefficient <= 0, exponent) and small at 1e23 carriers per m^3."""
    if not terms:
        raise checks.InputError("fcd is empty; for no free-carrier dispersion give ((0.0, 1.0),)")
    for term in terms:
        if len(term) != 2:
            raise checks.InputError(f"fcd holds {term!r}; every term is (coefficient, exponent)")
        coefficient = checks.finite("fcd coefficient", term[0])
        exponent = checks.between("fcd exponent", term[1], 0.3, 3)
        if coefficient > 0:
            raise checks.InputError(
                f"fcd coefficient = {coefficient:g} must be negative; free carriers lower the index"
            )
        hint = "N counts per m^3; multiply a coefficient for cm^-3 by 1e-6 to the power of its exponent"
        checks.between("fcd index change at 1e23 per m^3", coefficient * 1e23**exponent, -0.05, 0, hint=hint)
