"""Published parameter sets, a function each, every number with its unit and source.

Borghi: M. Borghi, D. Bazzanella, M. Mancinelli and L. Pavesi, "On the modeling of thermal and free carrier
nonlinearities in silicon-on-insulator microring resonators", Opt. Express 29, 4363 (2021). "Table 1" and "Table 2" are
those of its Appendices A and B; "Exp.", "Fit" and "FEM" are the origins that the tables give.

Van Vaerenbergh: T. Van Vaerenbergh et al., "Cascadable excitability in microrings", Opt. Express 20, 20292 (2012).
The paper itself was not available: every number is from a script that reproduces it, by J. Lamo
(github.com/JohannesLamo/Master_thesis_MRR_simulation_final, check_simulation_against_Thomas_paper.m), which marks them
"same as in paper". With them the ring pulses as in the paper's Fig. 3, whose points the script contains, to 1 % in
period, temperature and carriers. The script counts a thousandth of the light lost by two-photon absorption, but all of
its heat: an error of 2 to 3 % in the figure that is corrected here.
"""

from dataclasses import dataclass

from scipy.constants import c

from .carriers import ConstantLifetime, ShockleyReadHall
from .resonator import PUBLISHED, RingResonator, published


@dataclass(frozen=True)
class NewtonParameters:
    """Parameters of Newton's law, dT/dt = -dT/tau_th + P_abs/(m c_p) (Borghi, Eq. 2.3)."""

    tau_th: float
    """s"""
    heat_capacity: float
    """m c_p in J/K"""


@dataclass(frozen=True)
class SecondOrderParameters:
    """Parameters of the second-order thermal equation (Borghi, Eq. 3).

        dT'' + (1/tau_f + 1/tau_s) dT' + dT/(tau_f tau_s) = (kappa P_abs + eta P_abs')/(m c_p)

    The printed equation omits m c_p in the last term; with it eta is the dimensionless number that the text quotes.
    """

    kappa: float
    """1/s"""
    tau_f: float
    """s"""
    tau_s: float
    """s"""
    eta: float
    """dimensionless"""
    heat_capacity: float
    """m c_p in J/K"""


HEAT_CAPACITY = 1.09e-14 * 700.0
"""J/K: the mass of the core (kg; Table 1, Exp.) times its c_p (Table 1, from Johnson et al., Opt. Express 14, 817)."""
NEWTON_MAPS = NewtonParameters(tau_th=275e-9, heat_capacity=HEAT_CAPACITY)
"""Of the maps of Fig. 4(a, b) and of Model 1 in Fig. 4(c); goes with the lumped dispersion."""
NEWTON_FIT = NewtonParameters(tau_th=417e-9, heat_capacity=6.9 * HEAT_CAPACITY)
"""Model 2 at (8 dBm, 0 GHz), caption of Fig. 5: tau_th and c_p fitted to one measured trace."""
SECOND_ORDER_FEM = SecondOrderParameters(8.87e5, 55.8e-9, 1200e-9, 0.31, HEAT_CAPACITY)
"""Trained on finite elements, caption of Fig. 5."""
SECOND_ORDER_EXPERIMENT = SecondOrderParameters(7.45e5, 71e-9, 1030e-9, 0.29, HEAT_CAPACITY)
"""Trained on three measured traces, Section 5; standard deviations 0.05e5 1/s, 2 ns, 20 ns and 0.03."""
VAN_VAERENBERGH = NewtonParameters(tau_th=65e-9, heat_capacity=2330 * 3.19e-18 * 700.0 / 0.9355)
"""rho V_th (kg/m^3, m^3) times c_p (J/(kg K)), over the share of the absorbed power that heats that mass."""


@published
def borghi2021() -> RingResonator:
    """Return the silicon racetrack of Borghi et al., with the printed tables and the two-term free-carrier dispersion.

    Two variants exist as methods. ``.with_lumped_fcd()`` goes with Newton's law, as the paper does it.
    ``.with_swapped_srh()`` exchanges tau_n and tau_p: as printed they give lifetimes of 35.6 to 57.5 ns, exchanged
    23.4 to 57.5 ns, and the text (Section 3) says 25 to 60 ns.

    >>> round(borghi2021().loaded_q)
    6622
    """
    return RingResonator(
        name="Borghi 2021",
        frequency=192.88e12,  # Hz, Table 1, Exp.
        bus_rate=43e9,  # 1/s, gamma_e, Table 1, Exp.
        loss_rate=5.5e9,  # 1/s, gamma_i, Table 1, Exp.
        refractive_index=3.485,  # Table 1, from Johnson et al. 2006
        group_index=4.4,  # Table 1, Exp.
        thermo_optic=1.86e-4,  # 1/K, Table 1, from Johnson et al. 2006
        # sigma_FCD,1 in m^3 and sigma_FCD,2 in m^2.4, for the second-order law, Table 1, Fit; the exponent .8 from Lin,
        # Painter and Agrawal, Opt. Express 15, 16604 (2007)
        fcd=((-1.07e-27, 1.0), (-1.63e-22, 0.8)),
        fca_cross_section=1.5e-21,  # m^2, Table 1, Fit
        tpa_coefficient=8.1e-12,  # m/W, Table 1, Fit
        tpa_confinement=0.992,  # Table 1, FEM
        tpa_volume=5.35e-18,  # m^3, Table 1, FEM
        fca_confinement=0.999,  # Table 1, FEM
        fca_volume=4.87e-18,  # m^3, Table 1, FEM
        carriers=ShockleyReadHall(
            tau_n=35e-9,  # s, Table 2, Fit
            tau_p=22.5e-9,  # s, Table 2, Fit
            intrinsic_density=5e17,  # 1/m^3, Table 2, from Sze and Ng, Physics of Semiconductor Devices (2006)
            hole_density=1e21,  # 1/m^3, Table 2, Exp.
            trap_energy=0.66 - 0.56,  # eV, E_t - E_i, Table 2, Fit; E_i from Aldaya et al., Optica 4, 1219 (2017)
            thermal_energy=8.61e-5 * 293.15,  # eV; k_B rounded as in Table 2, so that the lifetimes follow the print
        ),
        lumped_fcd=-9.5e-27,  # m^3, sigma_FCD, for Newton's law, Table 1, Fit
    )


@published
def vanvaerenbergh2012() -> RingResonator:
    """Return the critically coupled ring of Van Vaerenbergh et al., to be used with Newton's law.

    The paper states all losses as energy rates and uses the refractive index as the group index. Its cross-section of
    free-carrier absorption is for power, and a confinement factor multiplies it; ``fca_cross_section``, for the
    amplitude, is half of that product. Its heat is ``surrogate.newton(**asdict(VAN_VAERENBERGH))`` of this module.

    >>> round(vanvaerenbergh2012().loaded_q)
    62171
    """
    tau_c = 205e-12  # s; 1/tau_c is the amplitude decay rate into the bus, and that of the ring's own loss
    absorbed = 0.4  # of the ring's own linear loss, eta_lin
    confinement = 0.9996  # of free carriers
    return RingResonator(
        name="Van Vaerenbergh 2012",
        frequency=c / 1552.770e-9,  # Hz
        bus_rate=1 / tau_c,
        drop_rate=0.0,
        loss_rate=absorbed / tau_c,
        scattering_rate=(1 - absorbed) / tau_c,
        refractive_index=3.476,
        group_index=3.476,
        thermo_optic=1.86e-4,  # 1/K
        fcd=((-1.73e-27, 1.0),),  # m^3
        fca_cross_section=1e-21 * confinement / 2,  # m^2
        tpa_coefficient=8.4e-12,  # m/W
        tpa_confinement=0.9964,
        tpa_volume=2.59e-18,  # m^3
        fca_confinement=confinement,
        fca_volume=2.36e-18,  # m^3
        carriers=ConstantLifetime(5.3e-9),  # s
    )


def published_rings() -> dict[str, RingResonator]:
    """All published rings by name; a ring with a variant for Newton's law also as "NAME-lumped"."""
    found = {}
    for name, one in PUBLISHED.items():
        found[name] = ring = one()
        if ring.lumped_fcd is not None:
            found[f"{name}-lumped"] = ring.with_lumped_fcd()
    return found
