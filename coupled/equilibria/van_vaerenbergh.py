"""Weight of free carriers against heat: the q of Van Vaerenbergh, which locates the self-pulsing region."""

from __future__ import annotations

import math

from thermofem import checks
from thermofem.models import ThermalModel

from ..arguments import check_ring
from ..resonator import RingResonator
from ..thermal import compact


def van_vaerenbergh_q(ring: RingResonator, model: ThermalModel, *, carriers: float = 1e23) -> float:
    """Return q, up to a factor of quality factors, absorbed share and mode volume: compare rings that share those.

        q = sqrt(sigma_FCD tau_fc)/(R_th dn/dT),      R_th = tau_th/(m c_p) for Newton's law

    With a larger q the self-pulsing region lies at more positive detunings. sigma_FCD = |index change|/N and tau_fc are
    taken at the given density where they depend on it.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        only its small-signal thermal resistance matters.
    carriers : float, 1/m^3
        N.

    Raises
    ------
    InputError
        a density out of range, or a ring without dn/dT.

    Source: Van Vaerenbergh et al., Phys. Rev. A 86, 063808 (2012), as quoted in Borghi et al., Opt. Express 29, 4363
    (2021), Section 4, where raising tau_th from 275 to 450 ns and c_p 8 times gives q = 5 q_0.

    >>> import coupled, thermofem as th
    >>> ring = coupled.borghi2021().with_lumped_fcd()
    >>> first, second = th.Foster(R=[275e-9 / 7.63e-12], tau=[275e-9]), th.Foster(R=[450e-9 / 61e-12], tau=[450e-9])
    >>> print(f"{van_vaerenbergh_q(ring, second) / van_vaerenbergh_q(ring, first):.1f}")
    4.9
    """
    check_ring(ring)
    N = checks.positive("carriers", carriers, unit="1/m^3", at_most=1e28, hint="1e17 cm^-3 is 1e23")
    turned = abs(ring.thermal_shift / ring.index_rate)  # dn/dT, also where the shift was set by with_rates
    if turned == 0:
        raise checks.InputError("heat does not shift the ring (thermo_optic = 0): it has no weight, and q is infinite")
    dispersion = abs(sum(coefficient * N ** (exponent - 1) for coefficient, exponent in ring.fcd))
    R = float(compact(model).thermal_resistance)
    return math.sqrt(dispersion * float(ring.carriers.lifetime(N))) / (R * turned)
