"""The kernel: printed equations, their derivative, a step, the loop, the flow, other solvers, heat that runs away."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rings import BENT, LINEAR, NETWORKS, RING, SECOND_ORDER, printed_equations, state
from scipy.integrate import solve_ivp
from support import ring_ode

import coupled
import thermofem as th
from coupled.circuit.system import system_of
from coupled.kernel import integrator, units as eq
from coupled.kernel.rates import absorbed_power
from coupled.kernel.tableaus import Method, tableau

POWER = 10**0.8 * 1e-3
REAL = replace(RING, drop_rate=20e9, scattering_rate=3e9, kerr_coefficient=4.5e-18)
MAPPED = th.OutputMap(SECOND_ORDER, -4e-3)
KINDS = {f"{n} poles": model for n, model in NETWORKS.items()}
KINDS |= {"output map": MAPPED, "quadratic": BENT, "quadratic, linear": LINEAR}
THREE = [replace(RING, frequency=RING.frequency + f) for f in (0.0, 4e9, -3e9)]
CIRCUITS = {
    "bus": coupled.bus(THREE, phase=0.7, loss=0.3),
    "in order": coupled.Circuit(
        THREE,
        [coupled.Waveguide("ring 1.through", "ring 2.in"), coupled.Waveguide("ring 1.drop", "ring 3.in", phase=1.0)],
        [coupled.LaserPort("in", "ring 1.in")],
    ),
    "loops": coupled.scissor(THREE, phase=0.4),
}


def single(model, ring=REAL, power=POWER, detuning=-3e9, duration=1e-6, method=Method.RODAS5P):
    return eq.single_ring(ring, model, power, detuning, duration, method)


def network(name, method=Method.RODAS5P):
    return system_of(CIRCUITS[name], SECOND_ORDER, power={"in": POWER}, duration=1e-6).problem(method)


def of_circuit() -> np.ndarray:
    """A state of three rings off every symmetry."""
    rng = np.random.default_rng(1)
    return np.concatenate([np.ravel([state(2)[:3] + rng.uniform(0, 0.3, 3) for _ in range(3)]), rng.uniform(1, 4, 6)])


PROBLEMS = {name: lambda method, m=model: (single(m, method=method), m) for name, model in KINDS.items()}
PROBLEMS |= {name: lambda method, n=name: (network(n, method), None) for name in CIRCUITS}


def problem_and_state(name, method=Method.RODAS5P):
    problem, model = PROBLEMS[name](method)
    return problem, of_circuit() if model is None else state(problem.order)


@pytest.mark.parametrize(("power", "detuning"), [(6.31e-3, 0.0), (1e-2, -17e9)])
def test_the_equations_are_the_printed_ones_in_other_units(power, detuning):
    y = state(2)
    got = single(SECOND_ORDER, RING, power, detuning).slopes(y)[0] / eq.NS  # per second
    a, N = (y[0] + 1j * y[1]) * math.sqrt(eq.FJ), y[2] * eq.DENSITY
    da, dN, dx = printed_equations(a, N, y[3:], power, detuning, SECOND_ORDER)
    want = np.array([da.real / math.sqrt(eq.FJ), da.imag / math.sqrt(eq.FJ), dN / eq.DENSITY, *dx])
    # round-off of sums of a dozen terms up to 100 times larger than the result, and eps^2/N^2 = 1e-17 in S(N)
    assert got == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize("kind", ["quadratic", "quadratic, linear"])
def test_heat_flows_as_the_model_says(kind):
    model, y, rates = KINDS[kind], state(2), eq.internal_rates(REAL)[0]
    P = float(absorbed_power(y[0] ** 2 + y[1] ** 2, y[2], rates)) * eq.UW
    assert single(model).slopes(y)[0][3:] / eq.NS == pytest.approx(model.rate(y[3:], P), rel=1e-12)


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_jacobian_is_the_derivative(name):
    problem, y = problem_and_state(name)
    J = problem.slopes(y)[1]
    numeric = np.empty_like(J)
    for j in range(y.size):
        # fourth-order differences with a step of 1e-3 of the state: truncation 1e-12 f^(5) y^4/f', round-off 1e-13 f/f'
        h = 1e-3 * abs(y[j])
        f = [problem.slopes(y + k * h * np.eye(y.size)[j])[0] for k in (-2, -1, 1, 2)]
        numeric[:, j] = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)
    scale = np.abs(J).max(axis=1, keepdims=True)
    assert np.abs((J - numeric) / scale).max() < 1e-7


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("name", PROBLEMS)
def test_a_step_solves_the_same_systems_as_a_dense_factorization(name, method):
    problem, y = problem_and_state(name, method)
    table, h, J, k = tableau(method), 0.7, problem.slopes(y)[1], []
    matrix = np.eye(y.size) / (table.gamma * h) - J
    for a, c in zip(table.a, table.c, strict=True):
        at = y + sum((a[j] * k[j] for j in range(len(k))), np.zeros(y.size))
        k.append(np.linalg.solve(matrix, problem.slopes(at)[0] + sum(c[j] / h * k[j] for j in range(len(k)))))
    end, _ = problem.follow(y, np.array([h]), np.zeros((y.size, 0)))
    # round-off 1e-16 times coefficients up to 112, stages that cancel to a hundredth, and the series of N^p: 1e-11
    assert end == pytest.approx(at + k[-1], abs=1e-11 * np.abs(k).max())


def exact(y, duration):
    """The state after ``duration`` ns by an explicit method of order 8, at round-off."""
    problem = single(SECOND_ORDER)
    return solve_ivp(lambda _, y: problem.slopes(y)[0], (0, duration), y, "DOP853", rtol=3e-14, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("method", Method)
def test_observed_order(method):
    duration, errors = 0.05, []
    want = exact(state(2), duration)
    for n in (64, 128):  # steps of 0.8 and 0.4 ps, where the field decays in 3 ps
        end, _ = single(SECOND_ORDER, method=method).follow(state(2), np.full(n, duration / n), np.zeros((5, 0)))
        errors.append(np.abs(end - want).max())
    # the next order contributes about h/tau = 0.13 of the leading one: the observed order is off by log2(1.13) = 0.18
    assert np.log2(errors[0] / errors[1]) == pytest.approx(tableau(method).order, abs=0.2)
    assert errors[1] > 1e-12  # far from round-off, or the order would mean nothing


@pytest.mark.parametrize("method", Method)
def test_order_of_the_dense_output(method):
    """One less than the method's, so one step's error falls with the method's order itself."""
    errors = []
    for h in (1e-3, 5e-4):
        times = h * np.array([0.25, 0.6, 0.9])
        problem = single(SECOND_ORDER, duration=h * eq.NS, method=method)
        run = problem.integrate(state(2), rtol=1.0, times=times, first_step=h)
        assert run.accepted == 1
        want = [exact(state(2), t) for t in times]
        errors.append(max(np.abs(row[1:] - [*y[:3], y[3:].sum()]).max() for row, y in zip(run.rows, want, strict=True)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(tableau(method).order, abs=0.2)  # as above, h/tau = 0.15
    assert errors[1] > 1e-13


TIMES = np.linspace(0, 20e3, 2001)


def run_to(method, rtol, times=TIMES):
    problem = single(SECOND_ORDER, RING, POWER, 0.0, 20e-6, method)
    return problem.integrate(problem.zero(), rtol=rtol, times=times)


@pytest.fixture(scope="module")
def reference():
    return run_to(Method.RODAS5P, 1e-10).rows


@pytest.mark.parametrize(
    ("method", "tolerances"), [(Method.RODAS4, [1e-4, 1e-5, 1e-6]), (Method.RODAS5P, [1e-6, 1e-7, 1e-8])]
)
def test_the_error_follows_the_tolerance(method, tolerances, reference):
    """Over 37 self-pulsing cycles, each of which passes a tenfold error of its jumps on to the next."""
    size = np.abs(reference[:, 1:]).max(axis=0)
    rows = [run_to(method, rtol).rows for rtol in tolerances]
    errors = [np.sqrt(np.mean(((one - reference)[:, 1:] / size) ** 2)) for one in rows]
    # measured: 3e-4, 1.4e-5, 8.6e-7 and 2e-5, 1.5e-6, 6.4e-8; a factor of 2 is left for other processors' round-off
    assert np.all(np.array(errors) < 50 * np.array(tolerances))
    assert np.all(np.array(errors[:-1]) / errors[1:] > 5)  # a decade of tolerance brings most of a decade of error


def test_radau_on_the_printed_equations_agrees():
    """SciPy's Radau on the equations in SI, written independently: a check of everything, units included."""
    unit = eq.units(2)

    def f(t, z):
        y = np.maximum(z * unit, [-np.inf, -np.inf, 0, -np.inf, -np.inf])  # N^0.8 exists from 0 on
        da, dN, dx = printed_equations(y[0] + 1j * y[1], y[2], y[3:], POWER, 0.0, SECOND_ORDER)
        return np.array([da.real, da.imag, dN, *dx]) / unit * eq.NS

    times = np.linspace(0, 1200, 241)  # switch-on, heating, the fall of the carriers at 0.8 us and their jump at 1.1 us
    other = solve_ivp(f, (0, 1200), np.zeros(5), method="Radau", t_eval=times, rtol=1e-7, atol=1e-9)
    rows = run_to(Method.RODAS5P, 1e-9, times).rows
    want = np.column_stack([*other.y[:3], other.y[3:].sum(axis=0)])
    # Radau's own: 1e-7 a step, forgotten within the carriers' 40 ns (10 steps) and grown a little by the jump
    assert np.abs(rows[:, 1:] - want).max() < 2e-6


def test_splitting_poles_changes_nothing():
    """Each pole as eight equal ones: the same physics, so the same steps, and states equal to round-off."""
    split = th.Foster(R=np.repeat(SECOND_ORDER.R, 8) / 8, tau=np.repeat(SECOND_ORDER.tau, 8))
    runs = [coupled.simulate(RING, m, power=POWER, duration=2e-6, rtol=1e-5) for m in (SECOND_ORDER, split)]
    assert runs[0].sizes == runs[1].sizes
    # round-off of the sums, 1e-15 a step, grown by e^(0.015/ns x 300 ns) = 100 in each of three unstable passages
    assert runs[1].carriers.values == pytest.approx(runs[0].carriers.values, rel=1e-7)


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_flow_has_the_derivative_of_its_steps(name):
    problem, y = problem_and_state(name, Method.RODAS4)
    steps = problem.integrate(y, rtol=1e-4, keep_steps=True).steps[:40]
    end, V = problem.follow(y, steps, np.eye(y.size))
    numeric = np.empty_like(V)
    for j in range(y.size):
        # as for the Jacobian; the flow is less straight than the equations
        h = 1e-5 * abs(y[j])
        f = [problem.follow(y + k * h * np.eye(y.size)[j], steps, np.zeros((y.size, 0)))[0] for k in (-2, -1, 1, 2)]
        numeric[:, j] = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)
    assert np.abs(V - numeric).max() < 1e-6 * np.abs(V).max()
    assert np.all(np.isfinite(end))


def test_a_run_that_is_left_and_entered_again_is_the_same(monkeypatch):
    whole = run_to(Method.RODAS4, 1e-6, None)
    monkeypatch.setattr(integrator, "RETURN", 1e-9)  # back after every other step
    assert np.array_equal(run_to(Method.RODAS4, 1e-6, None).rows, whole.rows)


def test_it_gives_up_with_a_reason_instead_of_running_for_ever(monkeypatch):
    with pytest.raises(th.InputError, match="no step small enough"):
        single(SECOND_ORDER, detuning=math.nan).integrate(state(2), rtol=1e-6)
    monkeypatch.setattr(integrator, "MAX_STEPS", 100)
    with pytest.raises(th.InputError, match="more than 100 steps"):
        run_to(Method.RODAS4, 1e-6)


def test_an_interrupt_ends_a_long_run():
    def press(reached):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):  # at the first return of the kernel, a tenth of a second of work
        coupled.simulate(RING, SECOND_ORDER, power=POWER, duration=0.1, progress=press)


def test_eigenvalues_at_8_dbm_on_resonance():
    branch = coupled.steady_states(RING, SECOND_ORDER, power=POWER, detuning=0.0).isel(branch=0)
    y = ring_ode.state_at(branch, RING, SECOND_ORDER, POWER, 0.0) / eq.units(2)
    residual, J = single(SECOND_ORDER, RING, POWER, 0.0).slopes(y)
    assert np.abs(residual / np.abs(J).max(axis=1)).max() < 1e-11  # of states of order 1 to 10
    # an unstable focus, a real pole and the optical pair, per ns; digits as far as they were computed
    values = np.linalg.eigvals(J)
    values = sorted(values[values.imag >= 0], key=lambda v: -v.real)
    assert values[0] == pytest.approx(0.01518554 + 0.006693j, abs=2e-6)
    assert values[1] == pytest.approx(-0.00580991, abs=1e-7)
    assert values[2] == pytest.approx(-112.08 + 128.18j, abs=0.01)


@pytest.mark.parametrize("kind", ["output map", "quadratic"])
def test_a_run_agrees_with_another_integrator(kind):
    model, times = KINDS[kind], np.linspace(20, 400, 20)
    problem = single(model, power=6.31e-3, duration=400e-9)
    other = solve_ivp(
        lambda _, y: problem.slopes(y)[0], (0, 400), np.zeros(5), method="LSODA", t_eval=times, rtol=1e-11, atol=1e-13
    )
    run = coupled.simulate(REAL, model, power=6.31e-3, detuning=-3e9, duration=400e-9, times=times * eq.NS, rtol=1e-9)
    z = other.y[3:].sum(axis=0)
    want = z - 4e-3 * z**2 if kind == "output map" else model.C @ other.y[3:]
    assert run.delta_T.values == pytest.approx(want, rel=1e-6)  # 1e-9 a step over a thousand of them
    assert run.carriers.values == pytest.approx(other.y[2] * eq.DENSITY, rel=1e-6)


def test_a_quadratic_model_without_its_quadratic_part_is_the_network():
    a, b = (coupled.simulate(RING, m, power=6.31e-3, duration=2e-6) for m in (SECOND_ORDER, LINEAR))
    assert a.sizes == b.sizes
    # round-off, grown as in the splitting of poles
    assert b.carriers.values == pytest.approx(a.carriers.values, rel=1e-6)


FAST = -1e6 * np.eye(2)


def test_light_and_heat_that_run_away_end_in_one_line():
    away = th.Quadratic(FAST, np.full((2, 2, 2), 1e30), 0 * FAST, 1e9 * np.ones(2), np.ones(2))
    with pytest.raises(th.InputError, match="no step small enough"):
        coupled.simulate(RING, away, power=1e-4, duration=1e-10)


@pytest.mark.parametrize("lasers", [(), coupled.Laser(1e-6, -2e9)])
@pytest.mark.parametrize("G", [1e26, 1e30])
def test_heat_that_grows_within_a_step_is_not_damped(G, lasers, monkeypatch):
    """An L-stable step can end on the unstable fixed point -B/G, a rise of -2e-21 K under light."""
    monkeypatch.setattr(integrator, "MAX_STEPS", 100_000)
    away = th.Quadratic(FAST, np.zeros((2, 2, 2)), np.full((2, 2), G), 1e9 * np.ones(2), np.ones(2))
    with pytest.raises(th.InputError, match=r"no step small enough|takes more than"):
        coupled.simulate(RING, away, power=1e-4, duration=1e-10, lasers=lasers)


def test_no_cycle_damps_heat_that_grows_within_an_interval():
    """A third mode that grows at 3e11 1/s: Newton's method finds a stable cycle, on which it rests at -B/G."""

    def with_third(gain: float) -> th.Quadratic:
        rate = np.array([*1 / SECOND_ORDER.tau, 1e9])
        G, B = np.diag([0, 0, gain]), np.array([*SECOND_ORDER.gain, 1e6])
        return th.Quadratic(-np.diag(rate), np.zeros((3, 3, 3)), G, B, np.ones(3))

    cycle = coupled.limit_cycle(RING, with_third(0.0), power=6.31e-3)
    with pytest.raises(th.InputError, match="near the one given as guess"):
        coupled.limit_cycle(RING, with_third(1e14), power=6.31e-3, guess=cycle)
