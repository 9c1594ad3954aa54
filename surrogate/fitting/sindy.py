"""Sparse identification (SINDy) of a thermal network from temperatures in and around the core, with an acceptance test.

States are the mean rises of the core and of oxide shells around it, the control is the absorbed power:

    dT_i/dt = sum_j A_ij T_j + b_i P,    A T_static + b = 0  (exact static gains imposed),    b_i = 0 outside the core

identified by pysindy in integral (weak) form, so that nothing is differentiated, and in time units of the order of the
sampling, so that the coefficients are of order one. Every identified network passes a gate or is refused: stable, real
poles, positive residues, static gain. pysindy's own simulation is not used; the poles answer in closed form.

With k(T) and c_p(T) the network is quadratic,

    dT_i/dt = sum_|j-i|<=2 A_ij T_j + sum_|j-i|<=1 Q_ij T_j^2 + b_i P + g_i T_i P,      b_i = g_i = 0 outside the core

Heat flows between neighbours as the difference of their Kirchhoff variables, T + beta T^2, so squares of neighbours
stand for k(T) and the core's power times temperature for c_p(T); products of all temperatures fit no better and run
away (measured). Two rows are exact for each equation,

    A T_0 + b = 0  (static gains at small power),      A T_1 + Q T_1^2 + b P_1 + g T_1 P_1 = 0  (one steady state).

A quadratic network says nothing about rises beyond its training, where it may run away: it warns there.

What does not work, and is refused by the gate: states [dT, d(dT)/dt], no static-gain rows, noisy derivatives.

Sources: S. L. Brunton, J. L. Proctor, J. N. Kutz, PNAS 113, 3932 (2016); D. A. Messenger, D. M. Bortz, J. Comput. Phys.
443, 110525 (2021) (weak form); K. Champion et al., IEEE Access 8, 169259 (2020) (constraints).
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
import xarray as xr

from thermofem import Quadratic, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.data.dataset import check_together, response_of, warn_of
from thermofem.models import HasModel, Network, gate
from thermofem.models.identified_network import STATIC
from thermofem.waveforms import Waveform

from .fit_result import common

log = logging.getLogger("thermofem")

OTHER = 0.05  # relative difference of static gains that is told
WINDOW = 15.0  # half width of the test functions in samples: 30 ns at 2 ns keeps the poles of 2 ns and more (measured)
SEED = 0
UNIT = 50.0  # time unit in samples: 100 ns at 2 ns


@dataclass(frozen=True, eq=False)
class SindyFit(HasModel):
    """An identified network and how well it fits.

    Attributes
    ----------
    model : Network, or Quadratic from `fit_sindy_quadratic`
    equations : tuple of str
        in K, W and seconds.
    parameters : dict of float
        A (1/s) as ``A_row_column`` and b (K/J) as ``b_row``, counted from 1; of a Quadratic also H and G.
    standard_errors : dict of float
        nan: the weak form's residuals are correlated, their scatter says nothing.
    residual : float, K
        rms of the core's rise, network against data.
    relative_residual : float
        the same over the swing.
    training : tuple of str
    geometry : str or None
        as TOML, of the data.
    """

    model: Any
    equations: tuple[str, ...]
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float]
    residual: float
    relative_residual: float
    training: tuple[str, ...]
    geometry: str | None = field(default=None, repr=False)

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model."""
        method = "SINDy, weak form, static gains imposed"
        reach, error = self.model.largest_rise, self.residual
        made = {"method": method, "equations": list(self.equations), "largest_rise_K": reach, "residual_K": error}
        return {**made, "training": list(self.training), "geometry": self.geometry}


def fit_sindy(data: xr.Dataset, static: Sequence[float] | None = None, *, window: float | None = None) -> SindyFit:
    """Identify a thermal network from the rises of the core and of shells around it.

    Parameters
    ----------
    data : Dataset
        delta_T (K) over time and probe, from rest, evenly sampled; the first probe is heated and read. A random
        telegraph over some tens of microseconds, sampled every 2 ns, works best.
    static : sequence of float, K/W
        steady rise of each probe per watt, from one static solution each; default the data's own, which
        `thermofem.solve` with several parts to read and campaigns write.
    window : float, s
        half width of the test functions; default 15 samples. Shorter keeps faster poles and more noise.

    Returns
    -------
    SindyFit
        measured on the reference strip over 55 square waves of .1-10 us: three states 3.4 %, five .6 % of the swing.

    Raises
    ------
    InputError
        data that are not evenly sampled or lack probes; a window of less than one sample or more than a third of the
        data; an identified network that does not pass the gate.
    """
    probed = read_probes(data)
    names, wave = probed.names, probed.wave
    gains = probed.each("static", data.attrs.get("thermal_resistances", ()) if static is None else static)
    if gains.max() > gains[0]:
        hotter = names[int(np.argmax(gains))]
        raise checks.InputError(
            f"static of {hotter!r} is larger than that of {names[0]!r}, the heated part: hotter at rest"
        )
    stated = np.ravel(data.attrs.get("thermal_resistances", gains))
    if stated.shape == gains.shape and np.any(np.abs(gains - stated) > OTHER * stated):
        log.warning("static contradicts the thermal_resistances that the data state: %s and %s K/W", gains, stated)
    n, largest = gains.size, float(probed.rise[:, 0].max())
    present = np.ones((n, n + 1), dtype=bool)
    present[1:, n] = False  # power enters the core only
    units = Units.of([probed], gains)
    found = regress([probed], units, window, _rows(present, [np.ones(n + 1)]), degree=1)
    A, b = found[:, :-1] / units.rise, found[:, -1] / units.power
    poles = gate(A, b, float(gains[0]), name=names[0])
    misfit = poles.response(wave, probed.times) - probed.rise[:, 0]
    seen = np.where(np.abs(b) > 1e-9 * np.abs(b).max(), b, 0.0)
    equations = _equations(names, [*(f"T[{name}]" for name in names), "P"], np.column_stack([A, seen]))
    model = Network(A, b, names, poles, largest)
    return fitted(model, equations, _coefficients(A=A, b=b), misfit, [probed], data.attrs.get("geometry"))


@dataclass(frozen=True, eq=False)
class Probed:
    """Rises of the core and of shells around it under one drive.

    times [shape (m,), s], rise [shape (m, n), K]: the core's first.
    """

    times: Array
    rise: Array
    wave: Waveform
    names: tuple[str, ...]

    def each(self, name: str, values: ArrayLike) -> Array:
        """One positive number for each probe; InputError for others."""
        found = checks.array(name, values)
        checks.shape(name, found, (len(self.names),))
        checks.positive(f"smallest {name}", found.min())
        return found


@dataclass(frozen=True, eq=False)
class Units:
    """Units in which states, power and coefficients are of order one.

    rise [shape (n,), K]: of each probe; power [W]: a static unit power gives unit states; time [s]
    """

    rise: Array
    power: float
    time: float

    @classmethod
    def of(cls, data: Sequence[Probed], gains: Array) -> Units:
        """Those of data, with the static gains of the probes in K/W."""
        power = max(float(one.rise[:, 0].max()) for one in data) / gains[0]
        return cls(gains * power, power, UNIT * float(data[0].times[1] - data[0].times[0]))


def fitted(
    model: Any, equations: tuple[str, ...], parameters: dict[str, float], misfit: Array, data: Sequence[Probed],
    geometry: str | None,
) -> SindyFit:  # fmt: skip
    """Make the result of an identification; ``misfit`` is the network's error in K at the core."""
    rms = float(np.sqrt(np.mean(misfit**2)))
    return SindyFit(
        model=model,
        equations=equations,
        parameters=parameters,
        standard_errors=dict.fromkeys(parameters, float("nan")),
        residual=rms,
        relative_residual=rms / float(np.ptp(np.concatenate([one.rise[:, 0] for one in data]))),
        training=tuple(f"{type(one.wave).__name__.lower()}, from rest" for one in data),
        geometry=geometry,
    ).recorded()


def regress(data: Sequence[Probed], units: Units, window: float | None, rows: Sequence[Array], *, degree: int) -> Array:
    """Weak-form regression by pysindy, with coefficients c of order one held to ``rows @ c = 0``.

    window [s]: half width of the test functions, default `WINDOW` samples.
    rows [shape (n * terms,)]: terms of one equation after the other.
    degree: of the polynomials in (states, power), without the constant.
    Returns [shape (n, terms)]: K/s for each term in `Units`.
    """
    import pysindy
    from pysindy.optimizers import ConstrainedSR3

    times = data[0].times / units.time
    step, hint = float(data[0].times[1] - data[0].times[0]), "from one sample to a third of the data"
    given = WINDOW * step if window is None else window
    half = checks.between("window", given, step * (1 - 1e-9), float(data[0].times[-1]) / 3, unit="s", hint=hint)
    optimizer = ConstrainedSR3(
        reg_weight_lam=0.0,
        regularizer="l2",
        relax_coeff_nu=1e8,
        equality_constraints=True,
        constraint_lhs=np.array(rows),
        constraint_rhs=np.zeros(len(rows)),
        tol=1e-12,
    )
    terms = pysindy.PolynomialLibrary(degree=degree, include_bias=False)
    states = [one.rise / units.rise for one in data]
    u = [one.wave(one.times)[:, None] / units.power for one in data]
    before = np.random.get_state()  # noqa: NPY002 - pysindy draws the places of its test functions from the global state
    np.random.seed(SEED)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pysindy warns of its own array bookkeeping; the gate judges the result
            # 400: test functions, at random places
            library = pysindy.WeakPDELibrary(terms, spatiotemporal_grid=times, K=400, p=4, H_xt=[half / units.time])
            sindy = pysindy.SINDy(feature_library=library, optimizer=optimizer).fit(states, times, u=u)
    except np.linalg.LinAlgError:
        raise checks.InputError("the regression is singular: do power and static gains belong to the data?") from None
    finally:
        np.random.set_state(before)  # noqa: NPY002
    return np.asarray(sindy.coefficients(), dtype=float) * units.rise[:, None] / units.time


def read_probes(data: xr.Dataset) -> Probed:
    """The rises, drive and probes of a Dataset; InputError where they are no evenly sampled transient of shells."""
    if "delta_T" not in data or "probe" not in data["delta_T"].dims:
        raise checks.InputError(
            "data.delta_T has no probes: SINDy needs shells of oxide around the core beside it; describe them as "
            "[[probe]] in the geometry and solve with read=('core', 'shell', ...), or --read core --read shell"
        )
    if data.attrs.get("kind", "transient") != "transient" or "waveform" not in data.attrs:
        raise checks.InputError("data must be a transient from rest that carries its waveform")
    responses = [response_of(data.isel(probe=k)) for k in range(data.sizes["probe"])]
    times, rise = responses[0].times, np.stack([response.rise for response in responses], axis=1)
    warn_of(responses)
    checks.enough("data", times.size, 1000)
    steps = np.diff(times)
    if np.ptp(steps) > 1e-6 * steps.mean():
        raise checks.InputError("data.time is not evenly spaced; the weak form needs even samples")
    names = tuple(str(p) for p in data["probe"].values)
    if data.attrs.get("heated", names[0]) != names[0]:
        raise checks.InputError(
            f"the first probe is {names[0]!r}; it must be the heated part, {data.attrs['heated']!r}"
        )
    return Probed(times, rise, responses[0].wave, names)


def _equations(names: tuple[str, ...], terms: Sequence[str], table: Array) -> tuple[str, ...]:
    """The equations of a network as text, from the coefficient of each term (columns) in each equation (rows)."""
    return tuple(
        f"dT[{name}]/dt = " + " ".join(f"{c:+.4g} {term}" for c, term in zip(row, terms, strict=True) if c)
        for name, row in zip(names, table, strict=True)
    )


def fit_sindy_quadratic(
    data: xr.Dataset | Sequence[xr.Dataset],
    static: Sequence[float],
    *,
    power: float,
    steady: Sequence[float],
    window: float | None = None,
) -> SindyFit:
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
    probed = [read_probes(d) for d in datasets]
    check_together(datasets)
    times, names = probed[0].times, probed[0].names
    if any(p.names != names or p.times.shape != times.shape or not np.allclose(p.times, times) for p in probed):
        raise checks.InputError("every Dataset needs the same probes and times")
    gains, settled = probed[0].each("static", static), probed[0].each("steady", steady)
    power, n = checks.power("power", power), len(names)
    units = Units.of(probed, gains)
    point, pairs, present = np.append(settled / units.rise, power / units.power), _products(n), _present(n)
    small = np.append(np.ones(n + 1), np.zeros(len(pairs)))
    rows = _rows(present, [small, np.append(point, [point[j] * point[k] for j, k in pairs])])
    found = regress(probed, units, window, rows, degree=2)
    largest = max(float(p.rise[:, 0].max()) for p in probed)
    model = _model(np.where(present, found, 0.0), units, names[0], largest)
    gate(model.A, model.B, float(gains[0]))
    rise = float(model.steady_rise(power))
    if abs(rise - settled[0]) > STATIC * settled[0]:
        raise checks.InputError(
            f"the identified network is refused: it settles at {rise:.5g} K under {power:g} W, not {settled[0]:.5g}"
        )
    misfit = np.concatenate([model.response(p.wave, times) - p.rise[:, 0] for p in probed])
    geometry = common([d.attrs.get("geometry") for d in datasets])
    terms = [*(f"T[{name}]" for name in names), *(f"T[{name}]^2" for name in names), "P", f"T[{names[0]}] P"]
    table = np.column_stack([model.A, np.einsum("ijj->ij", model.H), model.B, model.G[:, 0]])
    named = _coefficients(A=model.A, b=model.B, H=model.H, G=model.G)
    parameters = {name: value for name, value in named.items() if value}
    return fitted(model, _equations(names, terms, table), parameters, misfit, probed, geometry)


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


def _rows(present: NDArray[np.bool_], points: Sequence[Array]) -> list[Array]:
    """Equality constraints: terms that are not present are zero, and states with these values of the terms are steady.

    present [shape (n, terms)]
    points [each of shape (terms,)]
    """
    rows = []
    for equation, there in zip(np.eye(len(present)), present, strict=True):
        rows += [np.kron(equation, term) for term in (*np.eye(there.size)[~there], *points)]
    return rows


def _model(rows: Array, units: Units, name: str, largest: float) -> Quadratic:
    """The network in K, W and seconds from the coefficients of `regress`."""
    n, scale = units.rise.size, units.rise
    H, G = np.zeros((n, n, n)), np.zeros((n, n))
    for column, (j, k) in zip(rows[:, n + 1 :].T, _products(n), strict=True):
        if j == k < n:
            H[:, j, j] = column / scale[j] ** 2
        elif j < k == n:
            G[:, j] = column / (scale[j] * units.power)
    A, B, C = rows[:, :n] / scale, rows[:, n] / units.power, np.eye(n)[0]
    return Quadratic(A, H, G, B, C, inputs=(name,), outputs=(name,), largest_rise=largest)


def _coefficients(**arrays: Array) -> dict[str, float]:
    """Entries of arrays by name and indices, counted from 1, such as ``A_1_2``."""
    return {
        "_".join([name, *(str(i + 1) for i in at)]): float(value)
        for name, array in arrays.items()
        for at, value in np.ndenumerate(array)
    }
