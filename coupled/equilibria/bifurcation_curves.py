"""Hopf and fold curves in the plane of power and detuning, computed without a grid of laser settings.

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

whose roots in w are found at many U. From each root the curve is continued in both directions in the coordinates
(log U, arsinh D/loss, log w), where curves do not intersect, until it closes or leaves the range of U or w.
A fold has lambda = 0, a quadratic equation in D: D = -U shift' +- sqrt((U shift')^2 - gamma^2 - 2 U gamma gamma').
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from thermofem.arrays import Array, ArrayLike, Complex, Indices, Mask, runs_of
from thermofem.data import dataset
from thermofem.models import ThermalModel

from ..heaters import warmed
from ..inputs import check_axis, check_ring
from ..kernel.rates import absorbed_slopes, dispersion, recombination
from ..kernel.units import FJ, NS, UW, internal_pump
from ..resonator import RingResonator
from ..thermal import trusted
from .balance import InternalRing, absorbable, balance, farthest, internal_ring, peak
from .steady_states import first_lyapunov, jacobian, states
from .zeros import distances, intervals_in_window, zeros

ENERGIES, FREQUENCIES = 400, 200  # at which roots are looked for
LONGEST_STEP, SHORTEST_STEP = 0.1, 1e-7  # along a curve
FINE_STEP = 0.01  # of the window, the longest step in it
BEND = 0.995  # cosine of the angle between two steps
DIFFERENCE = 1e-6  # in log U and log w, for slopes
FOLD_POINTS, FOLD_GRID = 300, 1200  # of a curve; of the search for its stretches in the window


class Plane(NamedTuple):
    """A ring with its thermal model, and the window of powers (W) and detunings (rad/ns) with its energies U (fJ)."""

    ring: RingResonator
    model: ThermalModel
    at: InternalRing
    powers: Array
    detunings: Array
    energies: Array
    doubts: dict[str, Any]


def hopf_curves(
    ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike
) -> list[xr.Dataset]:  # fmt: skip
    """Return the Hopf curves: fixed points with a pair of eigenvalues +- i w, where self-pulsing begins or ends.

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
        one for each curve, over point: power (W), detuning (Hz), energy (J), frequency (Hz, w / 2 pi), leading
        (True if all other eigenvalues decay, so that the curve bounds a stable region), and lyapunov (1/s), the first
        Lyapunov coefficient g of dr/dt = growth r + g r^3 for carriers N (1 + r cos wt), or in a ring without carriers
        for the larger of Re a and Im a: below 0 the bifurcation is supercritical, above 0 subcritical, with a pulsing
        ring coexisting with the stable fixed point. A curve that leaves the window includes its first point outside.

    Raises
    ------
    InputError
        as `stability_map`.

    Warns OutsideTrainingWarning where the ring is hotter on a curve than in the training of the model.

    The poles of a quadratic model depend on the energy, so it takes five times as long as a network, 1 to 2 s.

    Accuracy, from the eigenvalues of the Jacobian at the returned points: the pair's real part is below 3e-13 w.
    """
    plane = _plane(ring, model, powers, detunings)
    curves = []
    for line in (part for whole in _lines(plane) for part in _inside(plane, whole)):
        U, D, omega = _values(plane, line)
        growth, leading = _criticality(plane, U, D, omega)
        frequency = omega / (2 * np.pi * NS)
        lyapunov = growth / NS
        curve = _dataset(plane, "Hopf curve", U, D, frequency=frequency, leading=leading, lyapunov=lyapunov)
        curves.append(curve)
    return curves


def fold_curves(
    ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike
) -> list[xr.Dataset]:  # fmt: skip
    """Return the fold curves, on which two fixed points merge and vanish; R_th is all they need of the thermal model.

    Parameters, errors, warnings and result as `hopf_curves`, without frequency, leading and lyapunov.
    """
    plane = _plane(ring, model, powers, detunings)
    return [curve for first, last in _folded(plane) for curve in _fold_curves(plane, first, last)]


def _plane(ring: RingResonator, model: ThermalModel, powers: ArrayLike, detunings: ArrayLike) -> Plane:
    """Check the window and compute the range of energies of its fixed points."""
    check_ring(ring)
    P = check_axis("powers", powers)
    nu = check_axis("detunings", detunings)
    warm = warmed(ring, model)
    at = internal_ring(ring, warm.model, absorbable(ring, P[-1]))
    shifts = 2 * np.pi * NS * nu
    faint, high = peak([internal_pump(ring, P[0]), internal_pump(ring, P[-1])], at)
    low = faint / np.cosh(farthest(np.abs(shifts).max(), high, at)) ** 2
    return Plane(ring, model, at, P, shifts, np.geomspace(low, high, ENERGIES), warm.doubts)


def _terms(plane: Plane, log_U: Array, log_w: Array) -> tuple[Complex, Complex]:
    """A and B at lambda = i w, complex, of the shape of ``log_U`` and ``log_w``."""
    z = 1j * np.exp(log_w)
    U, which = np.unique(np.exp(log_U), return_inverse=True)
    s = _secular(U, plane.at).at(which, z.shape)
    Z = plane.at.heat.impedance(z, s.power)
    by_carriers = z + s.rho
    A = (z + s.gamma) * (z + s.gamma_2 + s.alpha / by_carriers)
    B = s.kerr + (s.beta + Z * (s.heat * by_carriers + s.cross)) / by_carriers
    return A, B


class Secular(NamedTuple):
    """Coefficients of A and B (above) at fixed points of given energies, and the absorbed power in uW."""

    gamma: Array
    gamma_2: Array
    rho: Array
    alpha: Array
    beta: Array
    heat: Array
    cross: Array
    kerr: Array
    power: Array

    def at(self, which: Indices, shape: tuple[int, ...]) -> "Secular":
        """Those of the energies with the indices ``which``, in another shape."""
        return Secular(*(values[which].reshape(shape) for values in self))


def _secular(U: Array, ring: InternalRing) -> Secular:
    """The coefficients at energies ``U`` (fJ)."""
    rates = ring.rates
    at = balance(U, ring)
    made = 4 * rates.g * U * U
    P_by_U, P_by_N = absorbed_slopes(U, at.N, rates)
    _, rho = recombination(at.N, rates)
    _, S_slope = dispersion(at.N, ring.fcd)
    return Secular(
        gamma=at.gamma,
        gamma_2=at.gamma + 2 * rates.tpa * U,
        rho=rho,
        alpha=rates.fca * made,
        beta=S_slope * made,
        heat=2 * rates.thermal_shift * P_by_U * U,
        cross=rates.thermal_shift * P_by_N * made,
        kerr=2 * rates.kerr * U,
        power=at.P_abs,
    )


def _lines(plane: Plane) -> list[Array]:
    """All curves of Hopf points, each an array of rows log U, arsinh D/loss and log w, shape (3, points)."""
    here = balance(plane.energies, plane.at)
    tiny = np.finfo(float).tiny
    highest = here.gamma.max() + np.abs(here.shift).max() + np.abs(plane.detunings).max()
    slowest = NS * plane.at.model.slowest_rate
    log_U = np.log(plane.energies)
    log_w = np.log(np.geomspace(1e-4 * slowest, 2 * highest, FREQUENCIES))

    def resultant(x: Array, k: Indices) -> Array:
        A, B = _terms(plane, log_U[k], x)
        scale = np.abs(B) ** 2 + np.abs(A)
        size = A.imag**2 + B.imag**2 * scale + tiny
        mixed = A.imag * B.imag * B.real
        value = A.imag**2 - mixed + A.real * B.imag**2
        return value / size

    root, k = zeros(resultant, log_w, log_U.size)
    A, B = _terms(plane, log_U[k], root)
    D = A.imag / (B.imag + tiny)
    seeds = np.column_stack([log_U[k], np.arcsinh(D / plane.at.rates.loss), root])
    low = np.array([log_U[0], log_w[0]])
    high = np.array([log_U[-1], log_w[-1]])
    lines = []
    while len(seeds):
        first = _hopf_point(plane, seeds[0])
        seeds = seeds[1:]
        if first is None:
            continue
        line = _line(plane, *first, low, high)
        lines.append(line)
        # a root nearer to the curve than this lies on it
        seeds = seeds[distances(seeds, line.T) > 5e-3]
    return lines


def _line(plane: Plane, start: Array, tangent: Array, low: Array, high: Array) -> Array:
    """Continue a Hopf curve from ``start`` along ``tangent`` until it closes, or in both directions; shape (3, points).

    low, high: bounds of (log U, log w); the curve ends at its first point outside.
    """
    line = [start]
    for direction in (tangent, -tangent):
        x = start
        t = direction
        step = FINE_STEP
        place = _window(plane, *_values(plane, start)[:2])
        while step > SHORTEST_STEP and np.all((low <= x[::2]) & (x[::2] <= high)):
            returns = np.linalg.norm(start - x) < step and t @ tangent > BEND
            if len(line) > 3 and returns:
                return np.array([*line, start]).T
            following = _hopf_point(plane, x + step * t)
            if following is None:
                step /= 2
                continue
            point, along = following
            ahead = _window(plane, *_values(plane, point)[:2])
            outside = float(np.maximum(place - 1, -place).max())
            bends = abs(along @ t) < BEND
            if bends or np.linalg.norm(ahead - place) > max(FINE_STEP, outside / 2):
                step /= 2
                continue
            x = point
            t = along * np.sign(along @ t)
            place = ahead
            step = min(1.5 * step, LONGEST_STEP)
            line.append(x)
        line.reverse()
    return np.array(line).T


def _hopf_point(plane: Plane, x: Array) -> tuple[Array, Array] | None:
    """The Hopf point near ``x`` by Newton's method (minimum-norm steps), and the unit tangent of the curve; or None."""
    sides = DIFFERENCE * np.hstack([np.zeros((3, 1)), np.eye(3), -np.eye(3)])
    for _ in range(10):
        points = x[:, None] + sides
        A, B = _terms(plane, points[0], points[2])
        _, D, _ = _values(plane, points)
        F = A + D * D - D * B
        slopes = (F[1:4] - F[4:]) / (2 * DIFFERENCE)
        along = np.cross(slopes.real, slopes.imag)
        square = along @ along
        if not 0 < square < np.inf:
            return None
        residual = F[0].real * slopes.imag - F[0].imag * slopes.real
        move = np.cross(residual, along) / square
        x = x - move
        if np.linalg.norm(move) < 1e-9:  # the error is the square of a move, and 1e-10 of it
            return x, along / np.sqrt(square)
        if np.linalg.norm(move) > 1:
            return None
    return None


def _values(plane: Plane, x: Array) -> tuple[Array, Array, Array]:
    """U, D and w of points with the coordinates log U, arsinh D/loss and log w, shape (3, ...)."""
    U = np.exp(x[0])
    D = plane.at.rates.loss * np.sinh(x[1])
    omega = np.exp(x[2])
    return U, D, omega


def _window(plane: Plane, U: Array, D: Array) -> Array:
    """Coordinates of fixed points (U, D) in the window, shape (2, ...): log power and detuning, each 0 to 1 inside."""
    power, shift = _laser(plane, U, D)
    width = max(np.log(plane.powers[-1] / plane.powers[0]), 0.01)
    height = max(float(np.ptp(plane.detunings)), 0.01 * plane.at.rates.loss)
    horizontal = np.log(power / plane.powers[0]) / width
    vertical = (shift - plane.detunings[0]) / height
    return np.array([horizontal, vertical])


def _fold_equation(plane: Plane, U: Array) -> tuple[Array, Array]:
    """Coefficients a and b, of the shape of U, of the fold condition D^2 + 2 a D + b = 0."""
    here = balance(U, plane.at)
    by_loss = 2 * U * here.gamma * here.gamma_slope
    return U * here.shift_slope, here.gamma**2 + by_loss


def _folded(plane: Plane) -> list[tuple[float, float]]:
    """Intervals (low, high) of the energy U in which the fold condition has real roots D."""

    def square(x: Array) -> Array:  # below 1; a^2 = b at the ends
        a, b = _fold_equation(plane, np.exp(x))
        return ((a * a - b) / (a * a + np.abs(b)))[None]

    log_U = np.linspace(np.log(plane.energies[0]), np.log(plane.energies[-1]), 10 * ENERGIES)
    return [(float(np.exp(low)), float(np.exp(high))) for low, high in intervals_in_window(square, log_U)]


def _fold_curves(plane: Plane, first: float, last: float) -> list[xr.Dataset]:
    """The parts in the window of the fold curve that runs from the energy ``first`` to ``last`` (fJ) and back."""

    def along(angle: Array) -> tuple[Array, Array]:
        share = np.sin(angle / 2) ** 2
        U = first * (last / first) ** share
        a, b = _fold_equation(plane, U)
        root = np.sqrt(np.maximum(a * a - b, 0))
        return U, np.copysign(root, angle) - a  # smooth where both roots meet

    def in_window(angle: Array) -> Array:
        return _window(plane, *along(angle))

    curves = []
    for begin, end in intervals_in_window(in_window, np.linspace(-np.pi, np.pi, FOLD_GRID)):
        U, D = along(np.linspace(begin, end, FOLD_POINTS))
        curves.append(_dataset(plane, "fold curve", U, D))
    return curves


def _laser(plane: Plane, U: Array, D: Array) -> tuple[Array, Array]:
    """Power (W) and detuning (rad/ns) of the laser at which (U, D) are fixed points; both of their shape."""
    here = balance(U, plane.at)
    pump_squared = U * (here.gamma**2 + D**2)
    power = pump_squared / (2 * plane.ring.bus_rate * NS) * UW
    return power, here.shift - D


def _inside(plane: Plane, line: Array) -> list[Array]:
    """The parts of a curve (`_lines`) within the window, each extended by one point at both ends.

    A closed curve is rotated to start outside, so that no part inside is cut.
    """
    place = _window(plane, *_values(plane, line)[:2])
    inside = np.all((place >= 0) & (place <= 1), axis=0)
    closed = inside.size > 1 and np.array_equal(line[:, 0], line[:, -1])
    if closed and not inside.all():
        order = (np.arange(inside.size) + inside.argmin()) % (inside.size - 1)
        line = line[:, order]
        inside = inside[order]
    return [line[:, max(a - 1, 0) : b + 1] for a, b in runs_of(inside)]


def _criticality(plane: Plane, U: Array, D: Array, w: Array) -> tuple[Array, Mask]:
    """First Lyapunov coefficients (1/ns, for the relative amplitude of the carriers) at Hopf points.

    Also whether all eigenvalues but the two nearest to +- i w have negative real parts; both of shape (m,).
    """
    growth = []
    leading = []
    for y, detuning, omega in zip(*states(U, D, plane.at), w, strict=True):
        light = np.hypot(*y[:2])
        heat = max(np.abs(y[3:]).sum(), 1e-12)
        size = np.array([light, light, max(abs(y[2]), 1e-12), *np.full(y.size - 3, heat)])
        unit = 2 if plane.at.rates.g > 0 else int(np.abs(y[:2]).argmax())
        at_detuning = partial(jacobian, detuning=detuning, ring=plane.at)
        g, values = first_lyapunov(at_detuning, y, size, omega, unit)
        from_pair = np.abs(values**2 + omega**2)
        others = from_pair.argsort()[2:]
        growth.append(g * y[unit] ** 2)
        leading.append(np.all(values.real[others] < 0))
    return np.array(growth), np.array(leading)


def _dataset(plane: Plane, kind: str, U: Array, D: Array, **further: Any) -> xr.Dataset:
    """One curve as a Dataset over point, in SI; warns where dT exceeds the training range of the model."""
    power, shift = _laser(plane, U, D)
    trusted(plane.model, balance(U, plane.at).dT)
    values = {"power": power, "detuning": shift / (2 * np.pi * NS), "energy": U * FJ, **further}
    attrs = {"kind": kind, "ring": plane.ring.name, **plane.doubts}
    return xr.Dataset(dataset.variables("point", values, power="input_power"), attrs=attrs)
