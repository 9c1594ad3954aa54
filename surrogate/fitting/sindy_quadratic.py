"""Sparse identification of a quadratic thermal network: core and shells whose conductance depends on temperature.

    dT_i/dt = sum_|j-i|<=2 A_ij T_j + sum_|j-i|<=1 Q_ij T_j^2 + b_i P + g_i T_i P,      b_i = g_i = 0 outside the core

Heat flows between neighbours as the difference of their Kirchhoff variables, T + beta T^2, so squares of neighbours
stand for k(T) and the core's power times temperature for c_p(T); products of all temperatures fit no better and run
away (measured). Integral form and constraints as in `surrogate.fitting.sindy`, with two exact rows for each equation,

    A T_0 + b = 0  (static gains at small power),      A T_1 + Q T_1^2 + b P_1 + g T_1 P_1 = 0  (one steady state).

A quadratic network says nothing about rises beyond its training, where it may run away: it warns there.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from thermofem import Quadratic, checks
from thermofem.arrays import Array, NDArray
from thermofem.data.dataset import check_together
from thermofem.models.network import STATIC, gate

from .sindy import UNIT, SindyFit, fitted, half_width, read_probes, regress

if TYPE_CHECKING:
    import xarray as xr


def fit_sindy_quadratic(
    data: xr.Dataset | Sequence[xr.Dataset],
    static: Sequence[float],
    *,
    power: float,
    steady: Sequence[float],
    window: float | None = None,
) -> SindyFit[Quadratic]:
    """Identify a quadratic thermal network from rises of the core and of shells around it, with k(T) and c_p(T).

    Parameters
    ----------
    data : Dataset or list of them
        as of `fit_sindy`, all at the same times; two amplitudes tell linear from quadratic.
    static : sequence of float, K/W
        steady rise of each probe per watt, at small power.
    power : float, W
    steady : sequence of float, K
        steady rise of each probe at that power.
    window : float, s
        half width of the test functions; default 15 samples.

    Returns
    -------
    SindyFit
        ``model`` is a `thermofem.Quadratic`. Measured with Si(T) and SiO2(T) on the reference strip, five states,
        trained on telegraphs of 10 and 20 mW, judged on the full-order FEM at 20 mW and 147 K: rms 1.1 % of the swing
        on a step, a 20 us pulse and another telegraph, 1.6 to 2.6 % on square waves of .1, 1 and 10 us. The linear
        `fit_sindy` of the same data is refused.

    Raises
    ------
    InputError
        data that are not evenly sampled or lack probes, or have other probes or times each; a network that does not
        pass the gate at small power, misses the steady state, or runs away on its own training.
    """
    datasets = data if isinstance(data, Sequence) else [data]
    read = [read_probes(d) for d in datasets]
    check_together(datasets)
    times, names = read[0][0], read[0][3]
    if any(r[3] != names or r[0].shape != times.shape or not np.allclose(r[0], times) for r in read):
        raise checks.InputError("every Dataset needs the same probes and times")
    gains, settled = checks.array("static", static), checks.array("steady", steady)
    power = checks.power("power", power)
    n = len(names)
    if {gains.size, settled.size} != {n} or min(gains.min(), settled.min()) <= 0:
        raise checks.InputError(
            f"static has {gains.size} and steady {settled.size} values for {n} probes; all positive"
        )
    step = float(times[1] - times[0])
    half = half_width(window, times)
    largest = max(float(r[1][:, 0].max()) for r in read)
    unit, power_unit = UNIT * step, largest / gains[0]
    scale = gains * power_unit
    found = regress(
        [r[1] / scale for r in read],
        [r[2](times) / power_unit for r in read],
        times / unit,
        half / unit,
        _rows(n, settled / scale, power / power_unit),
        degree=2,
    )
    model = _model(np.where(_present(n), found, 0.0), scale, power_unit, unit, names[0], largest)
    _gate(model, float(gains[0]), power, float(settled[0]))
    misfit = np.concatenate([model.response(r[2], times) - r[1][:, 0] for r in read])
    geometries = {d.attrs.get("geometry") for d in datasets}
    geometry = geometries.pop() if len(geometries) == 1 else None
    rises = np.concatenate([r[1][:, 0] for r in read])
    return fitted(model, _equations(model, names), _parameters(model), misfit, rises, [r[2] for r in read], geometry)


def _products(n: int) -> list[tuple[int, int]]:
    """Terms of second order in pysindy's order; index n is the control."""
    return list(combinations_with_replacement(range(n + 1), 2))


def _present(n: int) -> NDArray[np.bool_]:
    """Which terms each equation of a network of neighbours has, shape (n, terms)."""
    pairs = _products(n)
    return np.array(
        [
            # 2: linear couplings reach the next but one shell: one leaves 5 % of the swing, all of them are not passive
            [abs(i - j) <= 2 for j in range(n)]
            + [i == 0]
            + [(j == k < n and abs(i - j) <= 1) or (i == j == 0 and k == n) for j, k in pairs]
            for i in range(n)
        ]
    )


def _rows(n: int, settled: Array, power: float) -> list[Array]:
    """Equality constraints: terms that are excluded are zero, and two steady states are exact."""
    pairs = _products(n)
    point = np.append(settled, power)
    value = np.concatenate([point, [point[j] * point[k] for j, k in pairs]])
    small = np.concatenate([np.ones(n + 1), np.zeros(len(pairs))])
    rows = []
    for equation, present in zip(np.eye(n), _present(n), strict=True):
        rows += [np.outer(equation, term).ravel() for term in np.eye(value.size)[~present]]
        rows += [np.outer(equation, row).ravel() for row in (small, value)]
    return rows


def _model(found: Array, scale: Array, power_unit: float, unit: float, name: str, largest: float) -> Quadratic:
    """The network in K, W and seconds from coefficients of order one."""
    n = scale.size
    rows = found * scale[:, None] / unit
    H, G = np.zeros((n, n, n)), np.zeros((n, n))
    for column, (j, k) in zip(rows[:, n + 1 :].T, _products(n), strict=True):
        if j == k < n:
            H[:, j, j] = column / scale[j] ** 2
        elif j < k == n:
            G[:, j] = column / (scale[j] * power_unit)
    try:
        return Quadratic(
            A=rows[:, :n] / scale,
            H=H,
            G=G,
            B=rows[:, n] / power_unit,
            C=np.eye(n)[0],
            inputs=(name,),
            outputs=(name,),
            largest_rise=largest,
        )
    except checks.InputError as error:
        raise checks.InputError(f"the identified network is refused: {error}") from None


def _gate(model: Quadratic, static: float, power: float, settled: float) -> None:
    gate(model.A, model.B, static)
    rise = float(model.steady_rise(power))
    if abs(rise - settled) > STATIC * settled:
        raise checks.InputError(
            f"the identified network is refused: it settles at {rise:.5g} K under {power:g} W, not {settled:.5g}"
        )


def _parameters(model: Quadratic) -> dict[str, float]:
    """Every coefficient of the library that is not zero, counted from 1."""
    named = {"A": model.A, "b": model.B, "H": model.H, "G": model.G}
    return {
        "_".join([name, *(str(i + 1) for i in at)]): float(value)
        for name, array in named.items()
        for at, value in np.ndenumerate(array)
        if value != 0
    }


def _equations(model: Quadratic, names: tuple[str, ...]) -> tuple[str, ...]:
    """The equations of the network as text."""
    n = len(names)
    terms = [f"T[{name}]" for name in names] + [f"T[{name}]^2" for name in names] + ["P", f"T[{names[0]}] P"]
    table = np.column_stack([model.A, np.stack([model.H[:, j, j] for j in range(n)], axis=1), model.B, model.G[:, 0]])
    return tuple(
        f"dT[{name}]/dt = " + " ".join(f"{c:+.4g} {term}" for c, term in zip(row, terms, strict=True) if c)
        for name, row in zip(names, table, strict=True)
    )
