"""The all-pass ring of Van Vaerenbergh et al., Opt. Express 20, 20292 (2012).

T. Van Vaerenbergh et al., "Cascadable excitability in microrings". Every number stands in the check of that paper by
J. Lamo (github.com/JohannesLamo/Master_thesis_MRR_simulation_final, check_simulation_against_Thomas_paper.m), whose
"same as in paper" is taken at its word: the print itself was not at hand. With them the ring pulses as in the paper's
Fig. 3, whose points that check holds too, to 1 % in period, temperature and carriers. The check counts a thousandth of
the light that two-photon absorption takes, but all of its heat; that is a slip (2 to 3 % off the figure) and not here.
"""

from scipy.constants import c

from ..carriers import ConstantLifetime
from ..resonator import RingResonator, published
from .borghi2021 import NewtonParameters

NEWTON = NewtonParameters(tau_th=65e-9, heat_capacity=2330 * 3.19e-18 * 700.0 / 0.9355)
"""rho V_th (kg/m^3, m^3) times c_p (J/(kg K)), over the share of the absorbed power that heats that mass."""


@published
def vanvaerenbergh2012() -> RingResonator:
    """Return the critically coupled ring of Van Vaerenbergh et al., to be used with Newton's law.

    The paper states all losses as energy rates and uses the refractive index as the group index. Its cross-section of
    free-carrier absorption is for power, and a confinement factor multiplies it; ``fca_cross_section``, for the
    amplitude, is half of that product. Its heat is ``surrogate.newton(tau_th=NEWTON.tau_th,
    heat_capacity=NEWTON.heat_capacity)``, with the numbers `NEWTON` of this module.

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
