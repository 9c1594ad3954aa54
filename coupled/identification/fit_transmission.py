"""Fit of slow sweeps of a laser through a resonance, hysteresis included, by the curve of all fixed points.

At fixed power all fixed points lie on one smooth curve (detuning, output), the tilted resonance, which includes its two
folds; at fixed detuning likewise. A slow sweep follows this curve and jumps at a fold. The residual of a sample (x, y)
is its signed distance from the nearest point (x(s), y(s)) of the curve,

    r = +-min_s hypot((x - x(s))/s_x, (y - y(s))/s_y),

with s_x half a step of the sweep and s_y the noise. No branch has to be assigned to a sample, the direction of the
sweep does not matter, and the residuals at a jump depend continuously on where the fold lies.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.constants import c, pi

from thermofem import Foster, InputError, checks
from thermofem.arrays import Array
from thermofem.data.variables import in_si
from thermofem.models import HasModel, ThermalModel
from thermofem.models.foster import second_order_poles

from ..arguments import check_power, check_ring, datasets
from ..equilibria.transmission import transmission
from ..parameters import SECOND_ORDER_FEM
from ..resonator import RingResonator
from ..thermal import check_geometry
from ..unknowns import SPAN, number_of, optical_names, span_of, varied
from .box_search import at_bound
from .forced_filters import noise_of

log = logging.getLogger("thermofem")

RESISTANCE, POWER = "thermal_resistance", "power"
SIDE = 3.0  # linewidths by which a curve extends beyond its sweep
NOISE = 2e-3  # of the range of a sweep: smallest noise that is assumed
# of an unknown, for slopes in the search and at its end: far above what the 600 points of a curve leave
STEP, WIDE = 2e-3, 5e-3
BLIND, OPEN = 1e-3, 0.05  # of the largest slope: none; share of a number along such directions that leaves it open
UNKNOWN = 1.0  # deviations of a logarithm from which on a parameter is not determined
WORSE = 1.5  # misfit over the noise above which a note reports it
IMPOSSIBLE = 1e3  # a residual where the parameters make no ring


@dataclass(frozen=True, eq=False)
class TransmissionFit(HasModel):
    """Result of `fit_transmission`.

    Attributes
    ----------
    parameters, standard_deviations : dict of str to float
        of the free parameters, in SI, and of three derived ones: "loaded_q", "intrinsic_q" and "heating" (K/W), R_th
        times the absorbed fraction of the intrinsic loss. A deviation is inf for a parameter not determined.
    ring, model : RingResonator, Foster
        with those parameters; of the model only R_th is meaningful, not its time constant.
    misfit : float
        root mean square of the residuals, about 1 where noise and step size explain them.
    curves : list of xarray.Dataset
        the fitted curve of fixed points for each sweep, as `transmission` returns it.
    notes : tuple of str
        reasons for which the result is doubtful.
    """

    parameters: dict[str, float]
    standard_deviations: dict[str, float]
    ring: RingResonator
    model: Foster
    misfit: float
    curves: list[xr.Dataset]
    notes: tuple[str, ...] = ()


class _Sweep(NamedTuple):
    """Samples of a sweep: x is ln P or the laser's frequency less that of the initial ring (Hz); y is the output."""

    x: Array
    y: Array
    port: str
    unit: str
    power: float | None
    detuning: float | None
    scales: tuple[float, float]


def fit_transmission(
    ring: RingResonator,
    sweeps: xr.Dataset | Sequence[xr.Dataset],
    *,
    free: Sequence[str],
    model: ThermalModel | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> TransmissionFit:
    """Fit parameters of a ring to slow sweeps: its steady transmission is compared with all of them at once.

    Parameters
    ----------
    ring : RingResonator
        start values of the free parameters, and values of the others.
    sweeps : xarray.Dataset or sequence of them
        drop or through over one dimension, in W, in "1" (fraction of the bus power), or in an arbitrary unit (its scale
        is then fitted, one per port and unit); with power (W), and wavelength (m) or detuning (Hz, from the ring's
        frequency), one of them swept along the dimension, the other constant. Upward, downward or both.
    free : sequence of str
        fields of the ring or its carriers ("frequency", "bus_rate", "loss_rate", "scattering_rate", "tau0", ..),
        "thermal_resistance" (K/W), and "power", a common factor of all powers, such as a fibre coupling loss.
    model : ThermalModel, optional
        source of the thermal resistance, or of its start value; by default the paper's.
    bounds : mapping of name to (low, high), optional
        by default a factor of 4 either side of the start; of "frequency" the range of the sweeps (Hz).

    Returns
    -------
    TransmissionFit

    Raises
    ------
    InputError
        a name, bound or sweep that cannot be used.

    Without two-photon absorption the sweeps determine only "heating", the product of R_th and the absorbed fraction of
    the loss, and not the two factors.

    >>> import coupled, thermofem as th
    >>> ring, heat = coupled.borghi2021(), th.Foster(R=[9e3], tau=[1e-6])
    >>> seen = [coupled.transmission(ring, heat, power=p, detuning=(-50e9, 30e9)) for p in (1e-4, 3e-3)]
    >>> seen = [sweep.drop_vars("through") for sweep in seen]
    >>> found = coupled.fit_transmission(ring, seen, free=["thermal_resistance"])
    >>> print(f"{found.parameters['thermal_resistance']:.0f} K/W")
    9000 K/W
    """
    check_ring(ring)
    doubts = tuple(check_geometry(ring, model).values())
    data = [_sweep(f"sweeps[{k}]", one, ring) for k, one in enumerate(datasets("sweeps", sweeps))]
    heat = second_order_poles(**asdict(SECOND_ORDER_FEM)) if model is None else model
    search = _search(ring, float(heat.thermal_resistance), data, free, bounds)
    x, r, J = _best(search)
    return _result(search, x, r, J, doubts)


def _sweep(name: str, given: Any, ring: RingResonator) -> _Sweep:
    """Check the Dataset of a sweep and convert it to a `_Sweep`, in SI."""
    ports = [port for port in ("drop", "through") if port in given]
    if len(ports) != 1 or given[ports[0]].ndim != 1:
        raise InputError(f"{name} needs one of the variables drop and through, over one dimension")
    y = checks.array(f"{name}.{ports[0]}", given[ports[0]].values)
    known = in_si(name, given.drop_vars(ports[0]))

    def of(key: str) -> Any:
        value = known[key].values if key in known.variables else known.attrs.get(key)
        return None if value is None else np.asarray(value, dtype=float)

    power = of("power")
    nu = of("detuning")
    wavelength = of("wavelength")
    nu = c / wavelength - ring.frequency if wavelength is not None else nu
    moves = [value is not None and bool(np.ptp(value) > 0) for value in (power, nu)]
    if power is None or nu is None or sum(moves) != 1 or (power if moves[0] else nu).shape != y.shape:
        raise InputError(
            f"{name} needs power (W) and wavelength (m) or detuning (Hz), variables or attributes; one of them is swept"
        )
    for value in np.atleast_1d(power):
        check_power(float(value), f"{name}.power")
    x = np.log(power) if moves[0] else nu
    unit = str(given[ports[0]].attrs.get("units", "W"))
    step = np.abs(np.diff(x))
    scales = float(np.median(step[step > 0])) / 2, max(noise_of(y), NOISE * float(np.ptp(y)))
    watts, hertz = (None if moving else float(np.mean(value)) for moving, value in zip(moves, (power, nu), strict=True))
    return _Sweep(x, y, ports[0], unit, watts, hertz, scales)


@dataclass(frozen=True, eq=False)
class _Search:
    """The least-squares problem: unknowns x, their start and bounds, and the residuals of all samples.

    x holds logarithms of the parameters, but for "frequency" its shift in linewidths; then the logarithms of the
    scales of arbitrary units.
    """

    ring: RingResonator
    resistance: float
    data: list[_Sweep]
    names: tuple[str, ...]
    start: Array
    low: Array
    high: Array
    units: tuple[tuple[str, str], ...]

    @property
    def linewidth(self) -> float:
        """Full width at half maximum of the initial ring's resonance, Hz."""
        return self.ring.linear_rate / pi

    def values(self, x: Array) -> dict[str, float]:
        """The free parameters at the unknowns ``x``: a dict from name to value in SI."""
        free = zip(self.names, x, strict=False)
        return {n: self.ring.frequency + v * self.linewidth if n == "frequency" else float(np.exp(v)) for n, v in free}

    def build(self, x: Array) -> tuple[RingResonator, Foster, float]:
        """Ring, thermal model and factor on all powers at the unknowns ``x``, shape (unknowns,)."""
        values = self.values(x)
        resistance = values.pop(RESISTANCE, self.resistance)
        factor = values.pop(POWER, 1.0)
        return varied(self.ring, values), Foster(R=[resistance], tau=[1e-6]), factor

    def curves(self, x: Array) -> list[xr.Dataset]:
        """The curve of all fixed points for each sweep at the unknowns ``x``, as `transmission` returns it."""
        ring, heat, factor = self.build(x)
        shift = ring.frequency - self.ring.frequency
        side = SIDE * self.linewidth

        def curve(power: float | None, detuning: float | None) -> xr.Dataset:
            moved = np.concatenate([one.x for one in self.data if (one.power is None) is (power is None)])
            low = moved.min()
            high = moved.max()
            if power is not None:
                span = (low - shift - side, high - shift + side)
                return transmission(ring, heat, power=power * factor, detuning=span)
            assert detuning is not None
            return transmission(ring, heat, power=np.exp([low - 0.5, high + 0.5]) * factor, detuning=detuning - shift)

        drives = [(one.power, one.detuning) for one in self.data]
        found = {drive: curve(*drive) for drive in dict.fromkeys(drives)}
        return [found[drive] for drive in drives]

    def residuals(self, x: Array) -> Array:
        """Signed distances of all samples from their curves at the unknowns ``x``, shape (samples,)."""
        try:
            curves = self.curves(x)
        except (InputError, RuntimeError):
            return np.full(sum(one.x.size for one in self.data), IMPOSSIBLE)
        shift = (self.values(x).get("frequency", self.ring.frequency)) - self.ring.frequency
        factor = self.values(x).get(POWER, 1.0)
        rows = []
        for one, curve in zip(self.data, curves, strict=True):
            own = curve["detuning"].values + shift if one.power is not None else np.log(curve["power"].values / factor)
            y = curve[one.port].values / (curve["power"].values if one.unit == "1" else 1.0)
            if (one.port, one.unit) in self.units:
                y = y * np.exp(x[len(self.names) + self.units.index((one.port, one.unit))])
            rows.append(_distances(one, own, y))
        return np.concatenate(rows)


def _distances(sweep: _Sweep, x: Array, y: Array) -> Array:
    """Signed distances of a sweep's samples from the polyline (x, y) in units of ``sweep.scales``, shape (samples,)."""
    line = np.array([x / sweep.scales[0], y / sweep.scales[1]])
    seen = np.array([sweep.x / sweep.scales[0], sweep.y / sweep.scales[1]])
    begin, along = line[:, :-1, None], np.diff(line)[:, :, None]
    to = seen[:, None, :] - begin
    share = np.clip((to * along).sum(axis=0) / np.maximum((along**2).sum(axis=0), 1e-300), 0, 1)
    off = to - share * along
    square = (off**2).sum(axis=0)
    nearest = square.argmin(axis=0), np.arange(sweep.x.size)
    side = (along[0] * off[1] - along[1] * off[0])[nearest]
    return np.asarray(np.sqrt(square[nearest]) * np.where(side < 0, -1.0, 1.0))


def _search(
    ring: RingResonator, resistance: float, data: list[_Sweep], free: Sequence[str],
    bounds: Mapping[str, tuple[float, float]] | None,
) -> _Search:  # fmt: skip
    """Set up the fit: resolve the names of the free parameters, with their starts and bounds."""
    checks.check_names("free", free)
    given = checks.mapping("bounds", bounds, hint='such as {"loss_rate": (1e9, 1e10)}')
    for name in given:
        checks.choice("a name in bounds", name, free)
    low = []
    high = []
    start = []
    width = ring.linear_rate / pi
    others = {RESISTANCE: resistance, POWER: 1.0}
    for name in free:
        checks.choice("a name in free", name, optical_names(ring) | {*others})
        value = others[name] if name in others else number_of(ring, name)
        if name == "frequency":
            nu = np.concatenate([one.x if one.power is not None else [one.detuning] for one in data])
            ends = (value + nu.min() - SIDE * width, value + nu.max() + SIDE * width)
            a, b = (np.array(span_of(name, given, ends)) - value) / width
            start.append(min(max(0.0, a), b))
        else:
            value = checks.positive(name, value, hint="a free parameter must start above 0")
            a, b = np.log(span_of(name, given, (value / SPAN, value * SPAN)))
            start.append(min(max(np.log(value), a), b))
        low.append(a)
        high.append(b)
    units = tuple(dict.fromkeys((one.port, one.unit) for one in data if one.unit not in ("W", "1")))
    for port, unit in units:  # the highest sample stands for a resonance
        tops = [(one.y.max(), one.power or np.exp(one.x.max())) for one in data if (one.port, one.unit) == (port, unit)]
        top = max(float(np.log(y / p)) for y, p in tops)
        start.append(top)
        low.append(top - np.log(30))
        high.append(top + np.log(30))
    return _Search(ring, resistance, data, tuple(free), np.array(start), np.array(low), np.array(high), units)


def _best(search: _Search) -> tuple[Array, Array, Array]:
    """Minimise the residuals: returns the unknowns x, the residuals and their Jacobian.

    A first search uses a robust loss (soft L1), as samples beyond a fold have large residuals at first.
    """
    from scipy.optimize import least_squares

    def descended(x: Array, loss: str, jac: str, step: float) -> Any:
        return least_squares(
            search.residuals, x, jac=jac, bounds=(search.low - 1e-12, search.high + 1e-12), loss=loss, max_nfev=60,
            xtol=1e-8, ftol=1e-8, diff_step=step / np.maximum(np.abs(x), 1e-2), x_scale=1.0,
        )  # fmt: skip

    first = descended(search.start, "soft_l1", "2-point", STEP)
    best = descended(first.x, "linear", "3-point", WIDE)
    if best.fun[0] == IMPOSSIBLE:
        raise InputError("no ring in the bounds has a steady transmission at these powers")
    return best.x, best.fun, best.jac


def _result(search: _Search, x: Array, r: Array, J: Array, doubts: tuple[str, ...]) -> TransmissionFit:
    """Parameters with standard deviations from the Jacobian J, derived quantities, and notes, as a TransmissionFit."""
    misfit = float(np.sqrt(r @ r / max(r.size - x.size, 1)))
    _, size, V = np.linalg.svd(J, full_matrices=False)
    seen = size > BLIND * size[0]
    ring, heat, _ = search.build(x)
    values, names = search.values(x), search.names

    def derived(x: Array) -> Array:
        ring, heat, _ = search.build(x)
        own = ring.loss_rate + ring.scattering_rate
        heating = heat.thermal_resistance * ring.loss_rate / own if own else 0.0
        return np.log([ring.loaded_q, ring.intrinsic_q, max(heating, 1e-300)])

    by_x = [(derived(x + 1e-5 * e) - derived(x - 1e-5 * e)) / 2e-5 for e in np.eye(x.size)]
    along = np.vstack([np.eye(x.size)[: len(names)], np.transpose(by_x)]) @ V.T
    relative = np.sqrt((along[:, seen] ** 2 / size[seen] ** 2).sum(axis=1)) * max(misfit, 1.0)
    relative[np.linalg.norm(along[:, ~seen], axis=1) > OPEN * np.linalg.norm(along, axis=1)] = np.inf
    every = values | dict(zip(("loaded_q", "intrinsic_q", "heating"), np.exp(derived(x)).tolist(), strict=True))
    deviations = {}
    notes = list(doubts)
    for (name, value), s in zip(every.items(), relative, strict=True):
        known = s < UNKNOWN
        deviations[name] = (s * (search.linewidth if name == "frequency" else value)) if known else np.inf
        if not known and name in names:
            notes.append(f"the sweeps do not determine {name} alone: other values fit as well; free fewer")
    for k in np.flatnonzero(at_bound(x, search.low, search.high)):
        name = names[k] if k < len(names) else "the scale"
        notes.append(f"{name} ended on a bound of its search: the others hold for this value only; widen bounds")
    if misfit > WORSE:
        notes.append(
            f"the curves miss the samples by {misfit:.3g} times their noise and steps: the deviations are widened by "
            "it, and hold no error of the model"
        )
    for note in notes[len(doubts) :]:
        log.warning("%s", note)
    return TransmissionFit(every, deviations, ring, heat, misfit, search.curves(x), tuple(notes))
