"""Continuation of cycles in one parameter, and of their folds in two, by pseudo-arclength, between Hopf points.

Bifurcations on a branch, with mu the Floquet multipliers without the trivial multiplier 1:

    fold of cycles: d(parameter)/d(arclength) = 0,     period doubling: prod (1 + mu_i) = 0,
    torus: prod_(i<j) (1 - mu_i mu_j) = 0 with a pair of complex mu
    near a Hopf point:  x = x_0 + r Re(q exp(i w t)),     J q = i w q,     dr/dt = growth r + g r^3

r is the relative amplitude of the carriers and g the first Lyapunov coefficient (`steady_states.first_lyapunov`). A
branch whose cycles shrink ends at a Hopf point: the secant method finds the parameter at which the real part of a pair
of eigenvalues vanishes. The last entry of such a branch is the fixed point at that parameter.

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sections 10.2 and 10.3.
"""

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq, newton

from thermofem import InputError, dataset
from thermofem.arrays import Array
from thermofem.data.variables import contents

from ..equilibria.balance import balance, fixed_points
from ..equilibria.steady_states import states
from ..heaters import turned_by
from ..inputs import check_detuning, check_power
from ..kernel.tableaus import Method
from ..kernel.units import FJ, NS
from . import multiple_shooting as shooting
from .cycle_problem import LASER, CycleProblem, numbers_of
from .multiple_shooting import Family, Nodes, Place
from .orbit_measures import measure
from .return_map import FINE, PER_STEP, Orbit, Trace, time_weights

KIND = "Hopf curve"
BORN, FAINT = 0.02, 1e-3  # relative amplitude of the first cycle; of one still nearer to the Hopf point
FIRST_STEP, SHORTEST_STEP = 0.01, 1e-7  # steps, in units of `multiple_shooting.weights`
LONGEST_STEP = (0.1, 0.03)  # step of a branch, and of a curve of folds
TURN = 0.3  # of the largest values, what the nodes may change in a step
EASY, HARD, MORE = 3, 5, 4  # steps of Newton's method; more to a fold
SMALL, SMALLEST_FOLD = (
    0.05,
    0.03,
)  # relative range of a cycle, where a branch ends in a Hopf point, folds on a Hopf curve
AT = 1e-3  # largest distance of the multiplier of a bifurcation from -1 or from the unit circle
REPELLED = 1e10  # multiplier at which the parameter of a canard stays while the cycle changes
MOST_CYCLES = 400  # cycles of the branch from a Hopf point to a laser
HOPF = "Hopf"
BIFURCATIONS = ("fold", "period doubling", "torus")


def is_hopf_point(guess: Any) -> bool:
    """Whether a guess is a Dataset of `hopf_curves`, of which one point is the start of a branch."""
    return str(getattr(guess, "attrs", {}).get("kind")) == KIND


def laser_of(guess: Any, turn: float = 0.0) -> tuple[float, float]:
    """Power (W) and detuning (Hz) at a Hopf point, less the resonance shift ``turn`` (Hz) by constant heaters."""
    variables = getattr(guess, "variables", {})
    if "power" in variables and np.ndim(guess["power"]) != 0:
        raise InputError("guess is a whole Hopf curve; give one point of it, such as curve.isel(point=0)")
    what = "one point of a Dataset of coupled.hopf_curves, such as curve.isel(point=0)"
    contents("guess", guess, ("power", "detuning", "energy", "frequency"), what=what)
    power = check_power(guess["power"].item(), "guess['power']")
    return power, check_detuning(guess["detuning"].item(), "guess['detuning']") - turn


def _at_rest(p: CycleProblem, U: float, D: float) -> tuple[Array, Array]:
    """State vector and Jacobian at the fixed point (U, D), in internal units, for a real pump amplitude."""
    y = states(np.array([U]), np.array([D]), p.internal)[0][0]
    gamma = float(balance(U, p.internal).gamma)
    turn = 1j / (gamma - 1j * D)
    phase = np.array([turn.real, turn.imag]) / abs(turn)
    y[:2] = np.sqrt(U) * phase
    return y, p.kernel(Method.RODAS4).slopes(y)[1]


def born(family: Family, guess: Any, size: float = BORN) -> tuple[Place, Array]:
    """Start a branch of cycles at a Hopf point: return its first cycle and the unit tangent towards larger cycles.

    family: its base is at the power and detuning of the point.
    guess: one point of `hopf_curves`.
    size: relative amplitude of the carriers in the first cycle.
    Raises InputError: no eigenvalue near the frequency of the point, or Newton's method finds no small cycle.
    """
    p = family.base
    U = float(guess["energy"]) / FJ
    omega = 2 * np.pi * NS * float(guess["frequency"])
    shift = float(balance(U, p.internal).shift)
    fixed, J = _at_rest(p, U, shift - p.laser[1])
    values, vectors = np.linalg.eig(J)
    off = np.abs(values - 1j * omega)
    k = int(np.argmin(off))
    if not off[k] < 1e-3 * omega:
        raise InputError("guess is a Hopf point of another ring or model: no pair of eigenvalues is at its frequency")
    v = vectors[:, k] / vectors[2, k]
    q = np.asarray((-1j * fixed[2] * v).real)  # the carriers rise through their mean
    outward = np.concatenate([q, [0.0, 0.0]])
    T = 2 * np.pi / omega
    for r in (size, size / 4):
        y = fixed + r * q
        trial = Nodes(y[None], np.array([T]), family.start())
        turn = shooting.flow(p.flow.fine, y, T, FINE)
        unit = shooting.weights(family, Trace(y, turn.y, T, turn.rows, []))
        row = outward * unit
        row /= np.linalg.norm(row)
        extent = shooting.extent_of(turn.rows)
        place = shooting.corrected(family, trial, row[None], unit, extent=extent)
        if place is not None and place.extent > r / 4:
            return place, place.frame(outward * place.unit)[0]
    raise InputError("no small cycle was found at the Hopf point given as guess: Newton's method finds none")


def hopf_near(family: Family, place: Place) -> Place | None:
    """The Hopf point where a branch of shrinking cycles ends, as a cycle of zero amplitude; None if none is near."""
    orbit = place.orbit
    start = float(place.values[0])
    span = float(family.ranges[0])
    energies = (orbit.trace.rows[:, 1:3] ** 2).sum(axis=1)
    energy = float(time_weights(orbit) @ energies) / orbit.T
    omega = 2 * np.pi / orbit.T

    def pair(value: float) -> tuple[Array, complex, Array]:
        """State, critical eigenvalue (1/ns) and Jacobian at the fixed point of the cycle's mean energy."""
        p = family.at(np.array([value]))
        U, D, _ = fixed_points(*p.laser, p.internal)
        k = int(np.argmin(np.abs(U - energy)))
        y, J = _at_rest(p, U[k], D[k])
        values = np.linalg.eigvals(J).astype(complex)
        critical = np.argmin(np.abs(values - 1j * omega))
        return y, complex(values[critical]), J

    def growth(value: float) -> float:
        """Real part of the critical eigenvalue, 1/ns."""
        return pair(value)[1].real

    try:
        value = float(newton(growth, start, x1=start + 1e-5 * span, tol=1e-11 * span, maxiter=20))
        y, root, J = pair(value)
    except (RuntimeError, ValueError):
        return None
    T = 2 * np.pi / root.imag
    if abs(value - start) > 0.05 * span or abs(T - orbit.T) > 0.1 * orbit.T:
        return None
    problem = family.at(np.array([value])).kernel(Method.RODAS4)
    row = shooting.flow(problem, y, 1e-3, 1e-5).rows[0]
    times = np.linspace(0, T, PER_STEP + 1)
    rows = np.column_stack([times, np.tile(row[1:], (times.size, 1))])
    durations = np.array([T])
    still = Orbit(Trace(y, y, T, rows, [(y, durations)]), expm(J * T))
    return place._replace(nodes=Nodes(y[None], durations, np.array([value])), orbit=still)


class Found(NamedTuple):
    """A cycle on a branch and the bifurcation at which it lies: one of `BIFURCATIONS`, `HOPF`, or "" for none."""

    place: Place
    kind: str


def follow(
    family: Family,
    start: Place,
    along: Array,
    ends: Any,
    most: int,
    kinds: Collection[str] = BIFURCATIONS,
) -> tuple[list[Found], str]:
    """Return the cycles of a branch, or the folds of a surface of cycles (q = 2), and the reason why it ends.

    start, along: the first cycle, and a vector of which the projection on the tangent space is the direction to go.
    ends: of the range of the parameters (SI), numbers or shape (2, q): a branch stops there, a curve of folds beyond.
    most: largest number of cycles. kinds: the bifurcations to locate, of `BIFURCATIONS`.
    """
    place = start
    step = FIRST_STEP
    rows = start.frame(along)
    out = [Found(start, "")]
    shortest = start.orbit.T
    folds = len(rows) > 1

    def outside(q: Place) -> float:
        """Signed test of the range: negative while all parameters lie between their ``ends``."""
        return float(np.max((q.values - ends[0]) * (q.values - ends[1])))

    while len(out) < most:
        step = min(step, _longest(place, rows[0]))
        ahead = shooting.predicted(family, place, rows, step)
        after = _frame_ahead(place, ahead) if ahead else rows
        turns_sharply = after[0] @ rows[0] < 0.8
        if ahead is None or (turns_sharply and step > 1e-4):
            step /= 2
            if step < SHORTEST_STEP:
                return out, "Newton's method finds no next cycle"
            continue
        out += _between(family, place, ahead, rows, step, kinds)
        if outside(ahead) > 0:
            end = ahead if folds else _located(family, place, rows, step, outside)
            if end:
                out.append(Found(end, ""))
            return out, "the end of the range"
        good = shooting.on_good_nodes(family, ahead, after)
        if good is None:
            return out, "its nodes cannot be placed"
        shrinks = good[0].extent < place.extent
        place, rows = good
        out.append(Found(place, ""))
        shortest = min(shortest, place.orbit.T)
        if shrinks and folds and place.extent < SMALLEST_FOLD:
            return out, "a Hopf curve"
        if shrinks and not folds and place.extent < SMALL:
            hopf_point = hopf_near(family, place)
            if hopf_point:
                return [*out, Found(hopf_point, HOPF)], "a Hopf point"
        if place.orbit.size > REPELLED:
            return out, f"the branch turns vertical: a deviation grows by {place.orbit.size:.1g} in a period"
        # a cycle this much longer than the shortest one runs into a saddle
        if 30.0 * shortest < place.orbit.T:
            return out, "the period grows without bound"
        step *= _step_factor(ahead.steps - (MORE if folds else 0))
    return out, "the number of points"


def _frame_ahead(place: Place, ahead: Place) -> Array:
    """The frame of the next cycle, whose first row points away from the cycle before it."""
    advance = ahead.x - place.x
    return ahead.frame(advance * ahead.unit)


def _step_factor(iterations: int) -> float:
    """Factor of the step of the continuation by the number of Newton steps that the last cycle took."""
    if iterations <= EASY:
        return 1.6
    return 0.6 if iterations >= HARD else 1.0


def doubling(place: Place) -> float:
    """Test function of period doubling: prod (1 + mu_i), which vanishes where a multiplier is -1."""
    return float(np.prod(1 + place.orbit.others).real)


def torus(place: Place) -> float:
    """Test function of a torus bifurcation: prod_(i<j) (1 - mu_i mu_j), zero where a product of multipliers is 1."""
    mu = place.orbit.others
    i, j = np.triu_indices(mu.size, 1)
    return float(np.prod(1 - mu[i] * mu[j]).real)


def _longest(place: Place, row: Array) -> float:
    """Longest continuation step at a cycle: the states at the nodes change by at most `TURN` of their largest values.

    For a small cycle the limit is proportional to its amplitude, so that no step passes beyond its Hopf point.
    """
    states = place.unit[: place.orbit.start.size]
    moved = float(np.abs(place.change(row).y * states).max())
    allowed = TURN * min(1.0, 2 * place.extent)
    return min(LONGEST_STEP[place.values.size - 1], allowed / max(moved, 1e-12))


def _between(
    family: Family, place: Place, ahead: Place, rows: Array, step: float, kinds: Collection[str]
) -> list[Found]:
    """Bifurcations of the given kinds on the branch between a cycle and the next one, in order of arclength."""

    def fold(q: Place) -> float:
        return float(q.frame(rows[0])[0, -1])

    out = []
    for kind, test in zip(BIFURCATIONS, (fold, doubling, torus), strict=True):
        if kind in kinds and test(place) * test(ahead) < 0:
            located = _located(family, place, rows, step, test)
            if located is not None and _is_there(kind, located):
                out.append(Found(located, kind))

    def arclength(bifurcation: Found) -> float:
        advance = bifurcation.place.x - place.x
        return float(advance * place.unit @ rows[0])

    return sorted(out, key=arclength)


def _located(family: Family, place: Place, rows: Array, step: float, test: Callable[[Place], float]) -> Place | None:
    """The cycle where ``test`` vanishes, by Brent's method in arclength, to 1e-10; None without convergence."""
    cycles: dict[float, Place] = {}

    def test_at(s: float) -> float:
        if s not in cycles:
            cycle = shooting.predicted(family, place, rows, s, FINE)
            if cycle is None:
                raise ArithmeticError
            cycles[s] = cycle
        return test(cycles[s])

    try:
        root = float(brentq(test_at, 0.0, step, xtol=1e-10, rtol=1e-12))
        return cycles[root]
    except (ArithmeticError, ValueError):
        return None


def _is_there(kind: str, place: Place) -> bool:
    """Whether a multiplier lies at -1 (period doubling) or a complex pair on the unit circle (torus), to `AT`.

    The test functions also change sign where a multiplier passes through infinity, near a saddle.
    """
    mu = place.orbit.others
    if kind == "period doubling":
        return bool(np.abs(1 + mu).min() < AT)
    if kind == "torus":  # a complex pair whose product is 1
        on_circle = np.abs(np.abs(mu) - 1) < AT
        return bool(np.any(on_circle & (np.abs(mu.imag) > AT)))
    return True


def described(family: Family, places: list[Place], **further: Any) -> dict[str, Any]:
    """Parameters and measures of cycles, and ``further`` columns, in SI: variables of a Dataset over point."""
    p = family.base
    measures = [measure(place.orbit.trace.rows)[:6] for place in places]  # without times
    duty, swing, extinction, lowest, highest, hottest = np.array(measures).T
    values = np.array([place.values for place in places]).T
    variables: dict[str, Any] = {}
    for name, column in zip(family.names, values, strict=True):
        _, unit = numbers_of(p)[name]
        variables[name] = ("point", column, {"units": unit or "1", "long_name": name})
    dropped = 2 * p.ring.drop_bus_rate * FJ
    columns = {
        "period": np.array([place.orbit.T for place in places]) * NS,
        "duty": duty,
        "swing": swing,
        "highest_rise": hottest + p.rise,
        "extinction": extinction,
        "drop_low": lowest * dropped,
        "drop_high": highest * dropped,
    }
    return variables | dataset.variables("point", columns | further)


def near_hopf(p: CycleProblem, guess: Any) -> Orbit:
    """The cycle of a problem, by continuation in power and detuning from a Hopf point at another power or detuning."""
    power, detuning = laser_of(guess, turned_by(p.rise, p.ring))
    base = replace(p, power=power, detuning=detuning)
    place = None
    far = {"power": abs(p.power / power - 1), "detuning": abs(p.detuning - detuning) / p.ring.linear_rate}
    moved = [name for name in LASER if far[name] > 0]
    names = sorted(moved, key=lambda name: -far[name])  # the cycle grows at first
    if not names:
        raise InputError("the Hopf point given as guess is at this power and detuning: its cycle has no size there")
    for name in names:
        here = getattr(base, name)
        target = getattr(p, name)
        family = Family(base, (name,), np.array([abs(target - here)]))
        if place is None:
            start, along = born(family, guess, FAINT)
        else:
            start = shooting.first_place(family, place.orbit.trace) or place
            along = np.eye(start.unit.size)[-1] * (target - here)
        cycles, why = follow(family, start, along, (target, 2 * here - target), MOST_CYCLES)
        place = cycles[-1].place
        if abs(float(place.values[0]) - target) > 1e-6 * abs(target - here):
            raise InputError(
                f"no cycle at {name} = {target:g} on the branch from the Hopf point given as guess: the branch "
                f"ends with {why}; continue_cycle shows where it goes"
            )
        base = replace(base, **{name: target})
    return place.orbit  # type: ignore[union-attr]
