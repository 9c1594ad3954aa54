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

from __future__ import annotations

import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from thermofem import Quadratic, checks
from thermofem.arrays import Array
from thermofem.data.dataset import response_of, warn_of
from thermofem.models import HasModel, Network, gate
from thermofem.waveforms import Waveform

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("thermofem")

OTHER = 0.05  # relative difference of static gains that is told
WINDOW = 15.0  # half width of the test functions in samples: 30 ns at 2 ns keeps the poles of 2 ns and more (measured)
SEED = 0
UNIT = 50.0  # time unit in samples: 100 ns at 2 ns


Identified = TypeVar("Identified", Network, Quadratic)


@dataclass(frozen=True, eq=False)
class SindyFit(HasModel, Generic[Identified]):
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

    model: Identified
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


def fit_sindy(
    data: xr.Dataset, static: Sequence[float] | None = None, *, window: float | None = None, impose: bool = True
) -> SindyFit[Network]:
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
    impose : bool
        the static gains as equality rows. Without them the gate refuses nearly every network.

    Returns
    -------
    SindyFit
        measured on the reference strip over 55 square waves of .1-10 us: three states 3.4 %, five .6 % of the swing.

    Raises
    ------
    InputError
        data that are not evenly sampled or lack probes; a window of less than one sample or more than a third of the
        data; an identified network that does not pass the gate.
    MissingLibraryError
        pysindy or cvxpy cannot be loaded.
    """
    times, rise, wave, names = read_probes(data)
    gains = checks.array("static", data.attrs.get("thermal_resistances", ()) if static is None else static)
    if gains.size != rise.shape[1] or gains.min() <= 0:
        raise checks.InputError(f"static has {gains.size} values for {rise.shape[1]} probes; one positive K/W for each")
    if gains.max() > gains[0]:
        hotter = names[int(np.argmax(gains))]
        raise checks.InputError(
            f"static of {hotter!r} is larger than that of {names[0]!r}, the heated part: hotter at rest"
        )
    stated = np.ravel(data.attrs.get("thermal_resistances", gains))
    if stated.shape == gains.shape and np.any(np.abs(gains - stated) > OTHER * stated):
        log.warning("static contradicts the thermal_resistances that the data state: %s and %s K/W", gains, stated)
    step = float(times[1] - times[0])
    half = half_width(window, times)
    largest = float(rise[:, 0].max())
    power_unit = largest / gains[0]
    scale, unit = gains * power_unit, UNIT * step  # a static unit power gives unit states
    coefficients = _identify(
        rise / scale, wave(times) / power_unit, times / unit, half / unit, checks.flag("impose", impose)
    )
    A = coefficients[:, :-1] * scale[:, None] / scale / unit
    b = coefficients[:, -1] * scale / power_unit / unit
    poles = gate(A, b, float(gains[0]), name=names[0])
    model = Network(A, b, names, poles, largest)
    n = len(names)
    parameters = {f"A_{i + 1}_{j + 1}": float(A[i, j]) for i in range(n) for j in range(n)}
    parameters |= {f"b_{i + 1}": float(b[i]) for i in range(n)}
    misfit = poles.response(wave, times) - rise[:, 0]
    return fitted(model, _equations(A, b, names), parameters, misfit, rise[:, 0], [wave], data.attrs.get("geometry"))


def half_width(window: float | None, times: Array) -> float:
    """Half width of the test functions in s, `WINDOW` samples if None; InputError where none or all lie in it."""
    step, hint = float(times[1] - times[0]), "from one sample to a third of the data"
    given = WINDOW * step if window is None else window
    return checks.between("window", given, step * (1 - 1e-9), float(times[-1]) / 3, unit="s", hint=hint)


def fitted(
    model: Any, equations: tuple[str, ...], parameters: dict[str, float], misfit: Array, rise: Array,
    waves: Sequence[Waveform], geometry: str | None,
) -> SindyFit[Any]:  # fmt: skip
    """Make the result of an identification; ``misfit`` is the network's error in K at the core's ``rise``."""
    rms = float(np.sqrt(np.mean(misfit**2)))
    fit = SindyFit(
        model=model,
        equations=equations,
        parameters=parameters,
        standard_errors=dict.fromkeys(parameters, float("nan")),
        residual=rms,
        relative_residual=rms / float(np.ptp(rise)),
        training=tuple(f"{type(wave).__name__.lower()}, from rest" for wave in waves),
        geometry=geometry,
    )
    return replace(fit, model=replace(model, origin=fit.provenance))


def _identify(states: Array, control: Array, times: Array, half: float, impose: bool) -> Array:
    """Coefficients (n, n + 1) of the states and the control in each equation, all of order one."""
    n = states.shape[1]
    rows = [np.outer(np.eye(n)[i], np.eye(n + 1)[n]).ravel() for i in range(1, n)]  # power enters the core only
    if impose:
        rows += [np.outer(np.eye(n)[i], np.ones(n + 1)).ravel() for i in range(n)]  # A 1 + b = 0
    return regress([states], [control], times, half, rows, degree=1)


def regress(
    states: Sequence[Array], controls: Sequence[Array], times: Array, half: float, rows: Sequence[Array], *, degree: int
) -> Array:
    """Weak-form regression by pysindy on one or several trajectories, coefficients held to ``rows @ c = 0``.

    states, controls [shapes (m, n) and (m,)]: of order one, all at ``times``.
    half: half width of the test functions, in the unit of ``times``.
    rows [shape (n * terms,)]: terms of one equation after the other.
    degree: of the polynomials in (states, control), without the constant.
    Returns [shape (n, terms)]
    """
    try:
        import pysindy
        from pysindy.optimizers import ConstrainedSR3
    except ImportError as error:
        raise checks.MissingLibraryError(
            f"fit_sindy needs pysindy and cvxpy: {error}; pip install pysindy cvxpy"
        ) from None

    constraints = {"constraint_lhs": np.array(rows), "constraint_rhs": np.zeros(len(rows))} if rows else {}
    optimizer = ConstrainedSR3(
        reg_weight_lam=0.0,
        regularizer="l2",
        relax_coeff_nu=1e8,
        equality_constraints=bool(rows),
        tol=1e-12,
        **constraints,
    )
    terms = pysindy.PolynomialLibrary(degree=degree, include_bias=False)
    u = [c[:, None] for c in controls]
    before = np.random.get_state()  # noqa: NPY002 - pysindy draws the places of its test functions from the global state
    np.random.seed(SEED)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pysindy warns of its own array bookkeeping; the gate judges the result
            # 400: test functions, at random places
            library = pysindy.WeakPDELibrary(terms, spatiotemporal_grid=times, K=400, p=4, H_xt=[half])
            sindy = pysindy.SINDy(feature_library=library, optimizer=optimizer).fit(list(states), times, u=u)
    except np.linalg.LinAlgError:
        raise checks.InputError("the regression is singular: do power and static gains belong to the data?") from None
    finally:
        np.random.set_state(before)  # noqa: NPY002
    return np.asarray(sindy.coefficients(), dtype=float)


def read_probes(data: xr.Dataset) -> tuple[Array, Array, Waveform, tuple[str, ...]]:
    """Times, rises (time, probe), drive and names of the probes."""
    checks.has("data", data, "data_vars", hint="a Dataset is needed, such as th.solve returns")
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
    if times.size < 1000:
        raise checks.InputError(f"data has {times.size} samples; identification needs at least 1000")
    steps = np.diff(times)
    if np.ptp(steps) > 1e-6 * steps.mean():
        raise checks.InputError("data.time is not evenly spaced; the weak form needs even samples")
    names = tuple(str(p) for p in data["probe"].values)
    if data.attrs.get("heated", names[0]) != names[0]:
        raise checks.InputError(
            f"the first probe is {names[0]!r}; it must be the heated part, {data.attrs['heated']!r}"
        )
    return times, rise, responses[0].wave, names


def _equations(A: Array, b: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """The equations of the network as text."""
    lines = []
    for row, gain, name in zip(A, b, names, strict=True):
        terms = [f"{a:+.4g} T[{other}]" for a, other in zip(row, names, strict=True) if a != 0]
        if abs(gain) > 1e-9 * np.abs(b).max():
            terms.append(f"{gain:+.4g} P")
        lines.append(f"dT[{name}]/dt = {' '.join(terms)}")
    return tuple(lines)
