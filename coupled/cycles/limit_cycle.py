"""The settled cycle of a self-pulsing ring, solved for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from thermofem.models import ThermalModel

from ..arguments import check_detuning, check_power, check_ring, one_laser
from ..heaters import constant
from ..resonator import RingResonator
from ..states import State
from ..thermal import trusted
from .guess import from_guess
from .orbit import problem
from .result import dataset_of
from .start import settled

if TYPE_CHECKING:
    import xarray as xr


@one_laser
def limit_cycle(
    ring: RingResonator,
    model: ThermalModel,
    *,
    power: float,
    detuning: float = 0.0,
    guess: xr.Dataset | State | None = None,
    heaters: Mapping[str, float] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Return the periodic orbit that a ring settles on under a constant laser.

        y(T) = y(0),     dy/dt = f(y) as in `simulate`,     f(y_0) . dy_0 = 0 fixes the phase

    by Newton's method on the return map y(0) -> y(T). Its derivative M comes from the same equations; the eigenvalues
    of M are the Floquet multipliers: by what a small deviation from the cycle has grown or shrunk a period later.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `simulate`.
    power : float, W
        in the bus waveguide, larger than 0.
    detuning : float, Hz
        laser minus cold resonance.
    guess : Dataset or State, optional
        where to start: another cycle of this function, near which any cycle is returned, stable or not; a run of
        `simulate` or a State, from which the ring settles; a point of `hopf_curves` (``curve.isel(point=k)``), from
        which a branch of cycles leads to this power and detuning. By default a cold ring.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    xarray.Dataset
        over time (s), one period with both ends: energy (J), carriers (1/m^3), delta_T (K), drop, through and absorbed
        (W), weight (s, of a sum that is the integral over the period), states over (time, state); over multiplier:
        multipliers (complex, by modulus; the one next to 1 belongs to the phase). Attributes: period (s), duty, swing
        (K), extinction (dB), settling_time (s, in which a deviation falls to 1/e; inf for an unstable cycle), stability
        ("stable", "doubled" with a multiplier below -1, or "unstable"), pulses (in a period), reason (in words; also
        where no mesh resolves a very steep pulse, so that the period is known to 1e-5 only).

    Raises
    ------
    InputError
        power or detuning out of range, a model that is not small, a ring without two-photon absorption, whose carriers
        are followed, or no cycle: the ring comes to rest, its pulses never repeat, or Newton's method finds none near
        the guess. The message says which.

    Measured: periods to 1e-10 on the reference ring (two, five and fourteen poles) against runs of 400 us at
    rtol = 1e-9. On 1304 random rings (two published ones with other losses, one to three poles of 30 ns to 30 us)
    against finer meshes of traces at rtol = 1e-8: 98 % within 1e-9, the worst 4e-8 off.

    Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sections 1.5 and 10.1.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
    >>> cycle = coupled.limit_cycle(coupled.borghi2021(), model, power=6.31e-3)
    >>> print(f"{cycle.attrs['period'] * 1e9:.4f} ns, {cycle.attrs['stability']}")
    654.4713 ns, stable
    """
    check_ring(ring)
    power = check_power(power)
    detuning = check_detuning(detuning)
    warm = constant(model, heaters, heated, read)
    p = problem(ring, warm.model, float(power), float(detuning), warm.rise)
    found = settled(p, np.zeros(p.units.size)) if guess is None else from_guess(p, guess)
    cycle = dataset_of(p, found)
    trusted(model, cycle["delta_T"].values - warm.rise)
    cycle.attrs |= warm.attributes
    return cycle
