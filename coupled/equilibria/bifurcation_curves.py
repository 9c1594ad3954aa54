"""Hopf and fold curves of the whole plane of power and detuning, without a search for roots in it.

Energy U and detuned D fix a fixed point, and with it power and detuning (`balance`). Its eigenvalues obey

    A(lambda, U) + D^2 - D B(lambda, U) = 0
    A = (lambda + gamma) [lambda + gamma_2 + alpha/(lambda + rho)]
    B = kerr + [beta + Z(lambda) (heat (lambda + rho) + cross)]/(lambda + rho)
    gamma_2 = gamma + 2 tpa U,     made = 4 g U^2,   alpha = fca made,   beta = S'(N) made,   rho = d(N/tau)/dN
    heat = 4 thermal_shift (absorbed + fca N + 2 tpa U) U,     cross = 2 thermal_shift fca U made
    kerr = 2 U times the Kerr shift of unit energy,            Z = d(dT)/dP at lambda

A Hopf point has lambda = i w: the imaginary part gives D, and the real part leaves one real equation over the plane of
U and w,

    D = Im A/Im B,      (Im A)^2 - Im A Im B Re B + (Im B)^2 Re A = 0,

whose zero contours are found on a lattice (`contours`) and refined by Newton's method in (log U, D, log w). Where Im A
and Im B vanish, contours of two different D cross: they are cut there, and joined to the nearest end.
A fold has lambda = 0, a quadratic equation in D: D = -U shift' +- sqrt((U shift')^2 - gamma^2 - 2 U gamma gamma').
"""

from typing import Any, NamedTuple

import contourpy
import numpy as np
import xarray as xr
from scipy.optimize import elementwise

from thermofem.arrays import Array, ArrayLike, Complex, NDArray, runs_of
from thermofem.data import dataset
from thermofem.models import ThermalModel

from ..arguments import check_axis, check_ring
from ..kernel.units import FJ, NS, UW, internal_pump
from ..resonator import RingResonator
from ..thermal import trusted
from .balance import InternalRing, absorbable, balance, dispersion, energy, farthest_s, internal_ring
from .contours import Segment, intervals_in_window, joined, one_sign, refined, zeros
from .steady_states import first_lyapunov, jacobians, states

ENERGIES, FREQUENCIES = 160, 200  # grid of the contour
FOLD_POINTS, FOLD_GRID = 300, 1200  # of a curve; of the search for its stretches in the window


class Plane(NamedTuple):
    """A ring in internal units and the window that is asked for."""

    ring: RingResonator
    at: InternalRing
    powers: Array
    detunings: Array
    energies: Array


def hopf_curves(
    ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike
) -> list[xr.Dataset]:  # fmt: skip
    """Return the curves on which an oscillation neither grows nor decays: a pair of eigenvalues +- i w.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `simulate`.
    powers : array, W
        of a map; the curves are cut to their range.
    detunings : array, Hz
        of a map; likewise.

    Returns
    -------
    list of xarray.Dataset
        one for each curve, over point: power (W), detuning (Hz), energy (J), frequency (Hz, w / 2 pi), leading,
        whether no other mode grows there, so that the curve bounds a stable region, and lyapunov (1/s), the first
        Lyapunov coefficient g of dr/dt = growth r + g r^3 for carriers N (1 + r cos wt), or in a ring without carriers
        for the larger of Re a and Im a: below 0 the bifurcation is supercritical, above 0 subcritical, with a pulsing
        ring beside the stable point. A curve that leaves the window goes on to its first point outside.

    Raises
    ------
    InputError
        as `stability_map`.

    Warns OutsideTrainingWarning where the ring is hotter on a curve than in the training of the model.

    A quadratic model has other poles at every energy, and takes ten times as long as a network, 0.2 to 0.5 s.

    Measured by dense eigenvalues at the returned power and detuning: the pair's real part is below 3e-13 w.
    """
    plane = plane_of(ring, model, powers, detunings)
    return _trusted(model, plane, unwatched(plane))


def unwatched(plane: Plane) -> list[xr.Dataset]:
    """`hopf_curves` without the warning about the training of the thermal model."""

    def place(point: Array) -> Array:
        return np.array([point[0], np.arcsinh(point[1] / plane.at.rates.loss), point[2]])

    curves = []
    # ends within 0.3 in log U, arsinh(D/loss) and log w, a few cells of the lattice, belong together
    for line in joined(_pieces(plane), place, 0.3):
        every = _from_outside(plane, *_smooth(plane, line))
        for part in _inside(plane, *every[:2]):
            U, D, omega = (values[part] for values in every)
            growth, values = _criticality(plane, U, D, omega)
            curve = _dataset(plane, "Hopf curve", U, D, omega)
            about = {"units": "1", "long_name": "no other mode grows"}
            curve["leading"] = ("point", _others_decay(values, omega), about)
            curve["lyapunov"] = ("point", growth / NS, {"units": "1/s", "long_name": "first Lyapunov coefficient"})
            curves.append(curve)
    return curves


def subcritical(ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike) -> bool:
    """Whether one of the `hopf_curves` is subcritical where it bounds a stable region."""
    curves = unwatched(plane_of(ring, model, powers, detunings))
    return any(bool(np.any(curve["leading"] & (curve["lyapunov"] > 0))) for curve in curves)


def fold_curves(
    ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike
) -> list[xr.Dataset]:  # fmt: skip
    """Return the curves on which two fixed points meet and vanish; they depend on R_th alone.

    Parameters, errors, warnings and result as `hopf_curves`, without frequency and leading.
    """
    plane = plane_of(ring, model, powers, detunings)
    curves = []
    for first, last in _folded(plane):

        def along(angle: Array, first: float = first, last: float = last) -> tuple[Array, Array]:
            U = first * np.exp(np.sin(angle / 2) ** 2 * np.log(last / first))
            a, b = _fold_equation(plane, U)
            return U, np.copysign(np.sqrt(np.maximum(a * a - b, 0)), angle) - a  # smooth where both roots meet

        def seen(angle: Array, along: Any = along) -> Array:
            return _window(plane, *along(angle))

        parts = intervals_in_window(seen, np.linspace(-np.pi, np.pi, FOLD_GRID))
        for angle in (np.linspace(*part, FOLD_POINTS) for part in parts):
            beyond = np.clip([2 * angle[0] - angle[1], 2 * angle[-1] - angle[-2]], -np.pi, np.pi)
            curves.append(_dataset(plane, "fold curve", *along(np.concatenate([beyond[:1], angle, beyond[1:]]))))
    return _trusted(model, plane, curves)


def plane_of(ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike) -> Plane:
    """Check the input and find the energies that its fixed points can have."""
    check_ring(ring)
    P, nu = check_axis("powers", powers), check_axis("detunings", detunings)
    at, shifts = internal_ring(ring, model, absorbable(ring, P[-1])), 2 * np.pi * NS * nu
    weak, strong = internal_pump(ring, P[0]), internal_pump(ring, P[-1])
    high = energy(0.0, strong, at)
    low = energy(farthest_s(np.abs(shifts).max(), strong, at), weak, at)
    return Plane(ring, at, P, shifts, np.geomspace(low, high, ENERGIES))


def _trusted(model: ThermalModel, plane: Plane, curves: list[xr.Dataset]) -> list[xr.Dataset]:
    """The curves; OutsideTrainingWarning where their fixed points are hotter than the training of the model."""
    for curve in curves:
        trusted(model, balance(curve["energy"].values / FJ, plane.at).dT)
    return curves


def _frequencies(plane: Plane) -> Array:
    """Frequencies of the lattice in rad/ns, from far below the slowest thermal pole to above the beat of the laser."""
    here = balance(plane.energies, plane.at)
    highest = here.gamma.max() + np.abs(here.shift).max() + np.abs(plane.detunings).max()
    return np.geomspace(1e-4 * plane.at.heat.slowest, 2 * highest, FREQUENCIES)


def _terms(plane: Plane, log_U: Array, log_w: Array) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """A and B at lambda = i w, for arrays of one shape."""
    z = 1j * np.exp(log_w)
    U, which = np.unique(np.exp(log_U), return_inverse=True)
    every = (values[which].reshape(z.shape) for values in _secular(U, plane.at))
    gamma, gamma_2, rho, alpha, beta, heat, cross, kerr, power = every
    Z = plane.at.heat.impedance(z, power)
    return (z + gamma) * (z + gamma_2 + alpha / (z + rho)), kerr + (beta + Z * (heat * (z + rho) + cross)) / (z + rho)


def _secular(U: Array, ring: InternalRing) -> tuple[Array, ...]:
    """gamma, gamma_2, rho, alpha, beta, heat, cross and kerr at the energies ``U``, and the absorbed power in uW."""
    rates, at = ring.rates, balance(U, ring)
    made = 4 * rates.g * U * U
    rho = (1 + rates.b * at.N * (2 + rates.a * at.N)) / (rates.tau0 * (1 + rates.a * at.N) ** 2)
    heat = 4 * rates.thermal_shift * (rates.absorbed + rates.fca * at.N + 2 * rates.tpa * U) * U
    alpha, beta = rates.fca * made, dispersion(at.N, ring.fcd)[1] * made
    cross, kerr = 2 * rates.thermal_shift * rates.fca * U * made, 2 * rates.kerr * U
    return at.gamma, at.gamma + 2 * rates.tpa * U, rho, alpha, beta, heat, cross, kerr, at.P_abs


def _resultant(A: Complex, B: Complex) -> tuple[Array, Array]:
    """The equation of a Hopf point over U and w, scaled to lie between -1 and 1, and D = Im A/Im B where it holds."""
    flat = np.abs(B.imag) < np.finfo(float).tiny
    D = A.imag / np.where(flat, np.finfo(float).tiny, B.imag)
    size = A.imag**2 + B.imag**2 * (np.abs(B) ** 2 + np.abs(A))
    return (A.imag**2 - A.imag * B.imag * B.real + A.real * B.imag**2) / size, D


def _pieces(plane: Plane) -> list[Segment]:
    """Zero contours of the resultant, cut where Im A = Im B = 0; points are rows (log U, D, log w)."""

    def values(x: Array, y: Array) -> tuple[Array, Array, Array]:
        A, B = _terms(plane, *np.meshgrid(x, y))
        return _resultant(A, B)[0], A.imag, B.imag

    log_U, log_w = refined(values, np.log(plane.energies), np.log(_frequencies(plane)))
    F, *both = values(log_U, log_w)
    crossed = ~one_sign(both[0], 2) & ~one_sign(both[1], 2)
    pieces = []
    for line in contourpy.contour_generator(z=F).lines(0.0):
        line = np.asarray(line)
        column, row = np.minimum(line.astype(int), [log_U.size - 2, log_w.size - 2]).T
        clear = ~crossed[row, column]
        x, y = _refined(plane, line, log_U, log_w)
        D = _resultant(*_terms(plane, x, y))[1]
        pieces += [Segment(np.array([x, D, y])[:, a:b], (a > 0, b < x.size)) for a, b in runs_of(clear)]
    return pieces


def _refined(plane: Plane, line: Array, log_U: Array, log_w: Array) -> tuple[Array, Array]:
    """log U and log w of the points of a contour, moved along the grid edges on which they lie to the exact zero."""
    low, high = np.floor(line + 1e-9).astype(int), np.ceil(line - 1e-9).astype(int)
    start, end = (np.array([log_U[i[:, 0]], log_w[i[:, 1]]]) for i in (low, high))

    def along(t: Array, x0: Array, y0: Array, x1: Array, y1: Array) -> Array:
        return _resultant(*_terms(plane, x0 + t * (x1 - x0), y0 + t * (y1 - y0)))[0]

    t = elementwise.find_root(along, (np.zeros(len(line)), np.ones(len(line))), args=(*start, *end)).x
    x, y = start + np.where(np.isfinite(t), t, 0.0) * (end - start)  # nan where an edge of no length has its zero
    return x, y


def _smooth(plane: Plane, line: Array) -> tuple[Array, Array, Array]:
    """Halve the segments that are long in the window, with new points on the curve, and return U, D and w."""
    for _ in range(14):
        at = _window(plane, np.exp(line[0]), line[1])
        low, high = np.minimum(at[:, 1:], at[:, :-1]), np.maximum(at[:, 1:], at[:, :-1])
        near = np.all((low < 1.2) & (high > -0.2), axis=0)
        # no straight line is longer than 0.01 of the window
        long = np.flatnonzero(near & (np.hypot(*(high - low)) > 0.01))
        if long.size == 0:
            break
        start = (line[:, long] + line[:, long + 1]) / 2
        scale = np.array([1, plane.at.rates.loss, 1])[:, None]
        size = np.linalg.norm((line[:, long + 1] - line[:, long]) / scale, axis=0)
        found = _projected(plane, start, scale)
        good = np.linalg.norm((found - start) / scale, axis=0) < size  # not another stretch of the curve
        line = np.insert(line, long[good] + 1, found[:, good], axis=1)
    return np.exp(line[0]), line[1], np.exp(line[2])


def _projected(plane: Plane, at: Array, scale: Array) -> Array:
    """The nearest Hopf points by Newton's method, each step the shortest one in (log U, D/gamma, log w)."""
    h = 1e-6
    for _ in range(8):
        A, B = _terms(plane, at[0], at[2])
        by_D = 2 * at[1] - B
        slopes = [by_D * scale[1]]
        for row in (0, 2):
            shift = h * np.eye(3)[row][:, None]
            (A1, B1), (A0, B0) = (_terms(plane, *(at + s * shift)[[0, 2]]) for s in (1, -1))
            slopes.append(((A1 - A0) - at[1] * (B1 - B0)) / (2 * h))
        J = np.array([slopes[1], slopes[0], slopes[2]])  # 3 x points, complex: two real rows for each point
        F = A + at[1] ** 2 - at[1] * B
        g11, g22, g12 = ((p * q).sum(axis=0) for p, q in ((J.real, J.real), (J.imag, J.imag), (J.real, J.imag)))
        d = g11 * g22 - g12**2
        with np.errstate(divide="ignore", invalid="ignore"):  # what is nan is left out
            u, v = (g22 * F.real - g12 * F.imag) / d, (g11 * F.imag - g12 * F.real) / d
        at = at - scale * (J.real * u + J.imag * v)
    return at


def _window(plane: Plane, U: Array, D: Array) -> Array:
    """Power (logarithmic) and detuning of fixed points as fractions of the window, shape (2, n)."""
    power, shift = _laser(plane, U, D)
    width = max(np.log(plane.powers[-1] / plane.powers[0]), 0.01)
    height = max(float(np.ptp(plane.detunings)), 0.01 * plane.at.rates.loss)
    return np.array([np.log(power / plane.powers[0]) / width, (shift - plane.detunings[0]) / height])


def _fold_equation(plane: Plane, U: Array) -> tuple[Array, Array]:
    """a and b of D^2 + 2 a D + b = 0."""
    here = balance(U, plane.at)
    return U * here.shift_slope, here.gamma**2 + 2 * U * here.gamma * here.gamma_slope


def _folded(plane: Plane) -> list[tuple[float, float]]:
    """Intervals of U with folds."""
    log_U = np.linspace(np.log(plane.energies[0]), np.log(plane.energies[-1]), 10 * ENERGIES)

    def square(x: Array) -> Array:
        a, b = _fold_equation(plane, np.exp(x))
        return (a * a - b) / (a * a + np.abs(b))

    ends = np.concatenate([log_U[:1], zeros(lambda x, _: square(x), log_U)[0], log_U[-1:]])
    has = square((ends[1:] + ends[:-1]) / 2) > 0
    return [(float(np.exp(low)), float(np.exp(high))) for low, high in zip(ends[:-1][has], ends[1:][has], strict=True)]


def _laser(plane: Plane, U: Array, D: Array) -> tuple[Array, Array]:
    """Power in W and detuning in rad/ns of the fixed points (U, D)."""
    here = balance(U, plane.at)
    return U * (here.gamma**2 + D**2) / (2 * plane.ring.bus_rate * NS) * UW, here.shift - D


def _inside(plane: Plane, U: Array, D: Array) -> list[slice]:
    """Parts of a curve within the window, each with one more point of the curve at both ends."""
    at = _window(plane, U, D)
    inside = np.all((at >= 0) & (at <= 1), axis=0)
    return [slice(max(a - 1, 0), b + 1) for a, b in runs_of(inside)]


def _from_outside(plane: Plane, *every: Array) -> list[Array]:
    """A closed curve with a point outside the window as the first one, so that no part within is cut in two."""
    closed = all(values[0] == values[-1] for values in every)
    outside = np.flatnonzero(~np.all((at := _window(plane, *every[:2])) >= 0, axis=0) | np.any(at > 1, axis=0))
    if not closed or outside.size == 0:
        return list(every)
    return [np.append(np.roll(values[:-1], -outside[0]), values[outside[0]]) for values in every]


def _criticality(plane: Plane, U: Array, D: Array, w: Array) -> tuple[Array, NDArray[np.complex128]]:
    """First Lyapunov coefficients in 1/ns, for the relative amplitude of the carriers, and the eigenvalues."""
    y, detuning = states(U, D, plane.at)
    size = np.abs(y)
    size[:, :2], size[:, 2] = np.sqrt(U)[:, None], np.maximum(size[:, 2], 1e-12)
    size[:, 3:] = np.maximum(size[:, 3:].sum(axis=1), 1e-12)[:, None]
    carriers = plane.at.rates.g > 0
    unit = np.full(U.size, 2) if carriers else np.abs(y[:, :2]).argmax(axis=1)
    g, values = first_lyapunov(lambda x: jacobians(x, detuning, plane.at), y, size, w, unit)
    return g * np.take_along_axis(y, unit[:, None], axis=1)[:, 0] ** 2, values


def _others_decay(values: NDArray[np.complex128], w: Array) -> NDArray[np.bool_]:
    """Whether all eigenvalues but the two nearest to +- i w decay, for each row."""
    rest = values.real.copy()
    for sign in (1, -1):
        near = np.abs(values - sign * 1j * w[:, None]).argmin(axis=1)
        np.put_along_axis(rest, near[:, None], -1.0, axis=1)
    return np.all(rest < 0, axis=1)


def _dataset(plane: Plane, kind: str, U: Array, D: Array, omega: Array | None = None) -> xr.Dataset:
    """One curve in SI."""
    power, shift = _laser(plane, U, D)
    values = {"power": power, "detuning": shift / (2 * np.pi * NS), "energy": U * FJ}
    if omega is not None:
        values["frequency"] = omega / (2 * np.pi * NS)
    return xr.Dataset(
        {name: ("point", v, dataset.describe({"power": "input_power"}.get(name, name))) for name, v in values.items()},
        attrs={"kind": kind, "ring": plane.ring.name},
    )
