"""Sparse identification (SINDy) of a thermal network from temperatures in and around the core, with an acceptance test.

States are the mean rises of the core and of oxide shells around it, the control is the absorbed power:

    dT_i/dt = sum_j A_ij T_j + b_i P,    A T_static + b = 0  (exact static gains imposed),    b_i = 0 outside the core

identified by pysindy in integral (weak) form, so that nothing is differentiated, and in time units of the order of the
sampling, so that the coefficients are of order one. Every identified network passes a gate or is refused: stable, real
poles, positive residues, static gain. pysindy's own simulation is not used; the poles answer in closed form.

What does not work, and is refused by the gate: states [dT, d(dT)/dt], no static-gain rows, noisy derivatives.

Sources: S. L. Brunton, J. L. Proctor, J. N. Kutz, PNAS 113, 3932 (2016); D. A. Messenger, D. M. Bortz, J. Comput. Phys.
443, 110525 (2021) (weak form); K. Champion et al., IEEE Access 8, 169259 (2020) (constraints).
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from thermofem import checks
from thermofem.arrays import Array, rms
from thermofem.data.dataset import response_of, warn_of
from thermofem.models import Network, gate
from thermofem.waveforms import Waveform

from .fit_result import Fit

WINDOW = 15.0  # half width of the test functions in samples: 30 ns at 2 ns keeps the poles of 2 ns and more (measured)


def fit_sindy(data: xr.Dataset, static: Sequence[float] | None = None, *, window: float | None = None) -> Fit:
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
    Fit
        with ``equations`` (in K, W and s) of a Network; parameters A (1/s) as ``A_row_column`` and b (K/J) as ``b_row``
        without errors: the weak form's residuals are correlated, their scatter says nothing. Measured on the reference
        strip over 55 square waves of .1-10 us: three states 3.4 %, five .6 % of the swing.

    Raises
    ------
    InputError
        data that are not evenly sampled or lack probes; a window of less than one sample or more than a third of the
        data; an identified network that does not pass the gate.
    """
    probed = read_probes(data)
    names = probed.names
    rise = probed.rise[:, 0]
    stated = data.attrs.get("thermal_resistances", ())
    gains = checks.array("static", stated if static is None else static)
    checks.shape("static", gains, (len(names),))
    checks.positive("smallest static", gains.min())
    if gains.max() > gains[0]:
        hotter = names[int(np.argmax(gains))]
        raise checks.InputError(
            f"static of {hotter!r} is larger than that of {names[0]!r}, the heated part: hotter at rest"
        )
    A, b = _regression(probed, gains, window)
    poles = gate(A, b, float(gains[0]), name=names[0])
    residual = rms(poles.response(probed.wave, probed.times) - rise)
    numbers = {f"A_{i + 1}_{j + 1}": float(value) for (i, j), value in np.ndenumerate(A)}
    numbers |= {f"b_{i}": value for i, value in enumerate(b.tolist(), 1)}
    return Fit(
        model=Network(A, b, names, poles, float(rise.max())),
        parameters=numbers,
        method="SINDy, weak form, static gains imposed",
        equations=_equations(names, A, b),
        residual=residual,
        relative_residual=residual / float(np.ptp(rise)),
        training=(f"{type(probed.wave).__name__.lower()}, from rest",),
        geometry=data.attrs.get("geometry"),
    ).recorded()


@dataclass(frozen=True, eq=False)
class Probed:
    """Rises of the core and of shells around it under one drive.

    times [shape (m,), s], rise [shape (m, n), K]: the core's first.
    """

    times: Array
    rise: Array
    wave: Waveform
    names: tuple[str, ...]


def _regression(probed: Probed, gains: Array, window: float | None) -> tuple[Array, Array]:
    """A (1/s) and b (K/J) of the network by pysindy, in units in which a static unit power gives unit states.

    gains [shape (n,), K/W]: static gain of each probe.
    window [s]: half width of the test functions, default `WINDOW` samples.
    """
    import pysindy

    from .ruled_least_squares import RuledLeastSquares

    n = gains.size
    step = float(probed.times[1] - probed.times[0])
    half = WINDOW * step if window is None else window
    least = step * (1 - 1e-9)
    most = float(probed.times[-1]) / 3
    half = checks.between("window", half, least, most, unit="s", hint="from one sample to a third of the data")
    power = float(probed.rise[:, 0].max()) / gains[0]
    # 50.0: time unit in samples: 100 ns at 2 ns
    time = 50.0 * step  # W, s
    rise = gains * power  # K, of each probe
    # of each row of [A, b]: it sums to zero, as unit power leads to unit rises; power enters the core only
    at_rest = np.ones((1, n + 1))
    unheated = np.eye(n + 1)[-1:]
    terms = pysindy.PolynomialLibrary(degree=1, include_bias=False)
    states = probed.rise / rise
    u = probed.wave(probed.times)[:, None] / power
    times = probed.times / time
    before = np.random.get_state()  # noqa: NPY002 - pysindy draws the places of its test functions from the global state
    np.random.seed(0)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pysindy warns of its own array bookkeeping; the gate judges the result
            # 400: test functions, at random places
            library = pysindy.WeakPDELibrary(terms, spatiotemporal_grid=times, K=400, p=4, H_xt=[half / time])
            rows = []
            for rules in (at_rest, np.vstack([at_rest, unheated])):
                optimizer = pysindy.WrappedOptimizer(RuledLeastSquares(rules), unbias=False)
                sindy = pysindy.SINDy(feature_library=library, optimizer=optimizer)
                sindy.fit([states], times, u=[u])
                rows.append(np.asarray(sindy.coefficients(), dtype=float))
    except np.linalg.LinAlgError:
        raise checks.InputError("the regression is singular: do power and static gains belong to the data?") from None
    finally:
        np.random.set_state(before)  # noqa: NPY002
    of_core, of_others = rows
    unit_rows = np.vstack([of_core[:1], of_others[1:]])
    both = unit_rows * rise[:, None] / time
    return both[:, :n] / rise, both[:, n] / power


def read_probes(data: xr.Dataset) -> Probed:
    """Rises, drive and probes of a Dataset; InputError unless it is an evenly sampled transient of core and shells."""
    if "delta_T" not in data or "probe" not in data["delta_T"].dims:
        raise checks.InputError(
            "data.delta_T has no probes: SINDy needs shells of oxide around the core beside it; describe them as "
            "[[probe]] in the geometry and solve with read=('core', 'shell', ...), or --read core --read shell"
        )
    if data.attrs.get("kind", "transient") != "transient" or "waveform" not in data.attrs:
        raise checks.InputError("data must be a transient from rest that carries its waveform")
    responses = [response_of(data.isel(probe=k)) for k in range(data.sizes["probe"])]
    first = responses[0]
    times = first.times
    rise = np.stack([response.rise for response in responses], axis=1)
    warn_of(responses)
    checks.enough("data", times.size, 1000)
    steps = np.diff(times)
    if np.ptp(steps) > 1e-6 * steps.mean():
        raise checks.InputError("data.time is not evenly spaced; the weak form needs even samples")
    names = tuple(map(str, data["probe"].values))
    heated = data.attrs.get("heated", names[0])
    if heated != names[0]:
        raise checks.InputError(f"the first probe is {names[0]!r}; it must be the heated part, {heated!r}")
    return Probed(times, rise, first.wave, names)


def _equations(names: tuple[str, ...], A: Array, b: Array) -> tuple[str, ...]:
    """The equations of a network as text; power enters the first only."""
    terms = [*(f"T[{name}]" for name in names), "P"]
    rows = np.column_stack([A, b])
    rows[1:, -1] = 0.0
    equations = []
    for name, row in zip(names, rows, strict=True):
        right = [f"{c:+.4g} {term}" for c, term in zip(row, terms, strict=True) if c]
        equations.append(f"dT[{name}]/dt = {' '.join(right)}")
    return tuple(equations)
