"""Fit of Newton's law of cooling to each drop trace separately: its heat capacity and lifetime against the period."""

import logging
from collections.abc import Sequence

import numpy as np
import xarray as xr

from ..inputs import bar, check_ring
from ..resonator import RingResonator
from ..unknowns import unknowns
from .box_search import at_bound, cost, least_squares
from .cycle_residuals import Stage, free_run, over_traces, residuals
from .cycles import targets_of

log = logging.getLogger("thermofem")

# 1 % of the period and 3 % of the swing, root mean square over the cycle, count alike. One pole cannot follow the steep
# parts of a cycle, and to ask it for more than two harmonics splits the best pairs into two families
TWO = Stage(2, 0.01, np.sqrt(2) * 0.03, 8)


def fit_newton_per_trace(
    ring: RingResonator,
    traces: Sequence[xr.Dataset],
    *,
    bounds: dict[str, tuple[float, float]] | None = None,
    show_bar: bool = False,
) -> xr.Dataset:
    """Fit (tau_th, m c_p) of Newton's law to every drop trace separately.

        dT/dt = -dT/tau_th + P_abs/(m c_p),      minimise what `identify` does, for one trace

    Where one pole cannot be right, no pair fits all traces: a slower pulse needs a longer lifetime and, to keep the
    mean temperature, a larger heat capacity, so that the pairs lie on a line.

    Parameters
    ----------
    ring : RingResonator
        the fixed parameters, free-carrier dispersion included (the paper's Fig. 4(d): two terms).
    traces : sequence of xarray.Dataset
        as for `identify`.
    bounds : mapping, optional
        of "tau_th" (s) and "heat_capacity" (J/K); by default within a factor of 4 of the paper's 417 ns, 6.9 c_p.
    show_bar : bool

    Returns
    -------
    xarray.Dataset
        over trace: power (W), detuning (Hz), tau_th (s), heat_capacity (J/K), period and period_model (s), and misfit,
        the root of the sum of squares: below about 1 the model is within 1 % in period and 3 % of the swing in shape.
        A trace that does not pulse determines the ratio of tau_th and heat_capacity alone, R_th: both are nan.
        In attrs correlation, Pearson's, of tau_th with heat_capacity over the traces that pulse, and slope (J/(K s))
        and intercept (J/K) of the straight line through them; nan for fewer than three.

    Raises
    ------
    InputError
        as `identify`.

    Measured on 12 traces of the finite-element model of the reference ring: tau_th 315 to 540 ns, m c_p 4.8 to 7.3
    times that of the core, tau_th longer for longer periods. The paper's traces give 350 to 650 ns and 7 to 10 times.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 4 and Fig. 4(d).
    """
    check_ring(ring)
    what = unknowns(ring, ["tau_th", "heat_capacity"], bounds=bounds)
    targets = targets_of(traces)
    axes = [np.linspace(a, b, 8)[1:-1] for a, b in zip(what.low, what.high, strict=True)]
    grid = np.array(np.meshgrid(*axes)).reshape(2, -1).T
    rows: list[list[float]] = []
    with bar("Newton's law", len(targets), show_bar) as advance:
        for k, target in enumerate(targets):
            f = residuals(what, [target], TWO)
            costs = [cost(f, x) for x in grid]
            # four are followed: the best one alone may lie in the basin of a ring that pulses twice as fast
            starts = [grid[i] for i in np.argsort(costs)[:4] if np.isfinite(costs[i])]
            ends = [least_squares(f, x, what.low, what.high, steps=TWO.steps) for x in starts]
            end = min(ends, key=lambda end: end.cost)
            pair = np.exp(end.x)
            if np.isnan(target.period):
                log.warning("a trace at rest shows tau_th/(m c_p) = R_th alone; both are nan for trace %d", k)
                pair = np.full(2, np.nan)
            elif at_bound(end.x, what.low, what.high).any():
                log.warning("tau_th or heat_capacity ended on the bound of its search for trace %d; widen bounds", k)
            _, cycle = free_run(*what.build(end.x), target)
            drive = [target.power, target.detuning]
            rows.append([*drive, *pair, target.period, cycle.period, np.sqrt(end.cost)])
            advance()
    names = ("power", "detuning", "tau_th", "heat_capacity", "period", "period_model", "misfit")
    fits = over_traces(dict(zip(names, np.transpose(rows), strict=True)))
    pulses = np.isfinite((fits["tau_th"] * fits["period_model"]).values)
    x = fits["tau_th"].values[pulses]
    y = fits["heat_capacity"].values[pulses]
    slope, intercept = np.polyfit(x / 1e-9, y, 1) if x.size >= 3 else (np.nan, np.nan)
    correlation = float(np.corrcoef(x, y)[0, 1]) if x.size >= 3 else np.nan
    return fits.assign_attrs(correlation=correlation, slope=float(slope / 1e-9), intercept=float(intercept))
