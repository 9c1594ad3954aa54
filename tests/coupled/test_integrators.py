"""The Rosenbrock methods: structured solve, order, dense output, error control, and other people's integrators."""

from __future__ import annotations

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit
from paths import ROOT
from rings import LAWS, NETWORKS, RING, SECOND_ORDER, printed_equations, state
from scipy.integrate import solve_ivp

import thermofem as th
from coupled import Method
from coupled.kernel.tableaus import tableau
from coupled.kernels import equations as eq
from coupled.kernels.compiling import forget_if_older
from coupled.kernels.interrupts import new_watch
from coupled.kernels.kinds import Poles
from coupled.kernels.rosenbrock import (
    DONE,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    LaserPieces,
    dense_output,
    integrate,
    step,
    step_error,
)

POWER = 10**0.8 * 1e-3
FLOOR = np.array([1e-3, 1e-4, 1e-3])  # sqrt(fJ), 1e23/m^3, K


def problem(ring, model):
    """What the compiled functions take after the state and the time: drive, detuning, rates, dispersion, poles."""
    return eq.internal_pump(ring, POWER), 0.0, *eq.internal_rates(ring), eq.internal_thermal(model)


def one_step(y, h, ring, model, method):
    """The new state, the stages and their sums over the poles."""
    table, n = tableau(method), model.order
    stages = table.a.shape[0]
    k, total, out = np.empty((stages, 3 + n)), np.empty(stages), np.empty(3 + n)
    drive, detuning, rates, fcd, _ = problem(ring, model)
    light = np.full(stages, drive), np.full(stages, detuning), np.zeros(2)
    step(y, h, *light, rates, fcd, eq.internal_thermal(model), table, out, k, total, np.empty(n))
    return out, k, total


def steady_laser(duration, drive, detuning=0.0):
    """Constant light for ``duration`` ns."""
    return LaserPieces(np.array([0, duration]), np.array([[drive**2, 0, 0, 0]]), np.array([[detuning, 0, 0, 0.0]]))


def run(method, rtol, duration=20e3, times=(), model=SECOND_ORDER, max_steps=10**7):
    y = np.zeros(3 + model.order)
    drive, detuning, rates, fcd, _ = problem(RING, model)
    args = (tableau(method), rtol, FLOOR, np.asarray(times, dtype=float), 1, 0.0, np.zeros(3), max_steps, new_watch())
    rows, y, reached, _, _, counts = integrate(
        y, steady_laser(duration, drive, detuning), rates, fcd, eq.internal_thermal(model), *args
    )
    return rows, y, reached, counts


@pytest.mark.parametrize("method", Method)
@pytest.mark.parametrize("poles", NETWORKS)
@pytest.mark.parametrize("law", LAWS)
def test_a_step_solves_the_same_systems_as_a_dense_factorization(method, poles, law):
    ring, model, table, h = LAWS[law], NETWORKS[poles], tableau(method), 0.7
    y = state(poles)
    drive, detuning, rates, fcd, thermal = problem(ring, model)
    J = eq.jacobian(y, detuning, rates, fcd, thermal)
    matrix = np.eye(y.size) / (table.gamma * h) - J
    k: list[np.ndarray] = []
    for a, c in zip(table.a, table.c, strict=True):
        at = y + sum((a[j] * k[j] for j in range(len(k))), np.zeros(y.size))
        f = eq.right_hand_side(at, drive, detuning, rates, fcd, thermal)
        k.append(np.linalg.solve(matrix, f + sum((c[j] / h * k[j] for j in range(len(k))), np.zeros(y.size))))
    got, stages, total = one_step(y, h, ring, model, method)
    # Round-off 1e-16 times coefficients up to 112 and stages that cancel to a hundredth: 1e-12.
    size = np.abs(k).max()
    assert np.abs(stages - k).max() < 1e-12 * size
    assert got == pytest.approx(at + k[-1], abs=1e-12 * size)
    assert total == pytest.approx(stages[:, 3:].sum(axis=1), abs=1e-12 * size)


def exact(y, duration):
    """The state after ``duration`` ns by an explicit method of order 8, at round-off."""
    drive, detuning, rates, fcd, thermal = problem(RING, SECOND_ORDER)

    def f(_, y):
        return eq.right_hand_side(y, drive, detuning, rates, fcd, thermal)

    return solve_ivp(f, (0, duration), y, method="DOP853", rtol=3e-14, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("method", Method)
def test_observed_order(method):
    start, duration = state(2), 0.05
    want, errors = exact(start, duration), []
    for n in (64, 128):  # steps of 0.8 and 0.4 ps, where the field decays in 3 ps
        y = start
        for _ in range(n):
            y = one_step(y, duration / n, RING, SECOND_ORDER, method)[0]
        errors.append(np.abs(y - want).max())
    # The next order contributes about h/tau = 0.13 of the leading one: the observed order is off by log2(1.13) = 0.18.
    assert np.log2(errors[0] / errors[1]) == pytest.approx(tableau(method).order, abs=0.2)
    assert errors[1] > 1e-12  # far from round-off, or the order would mean nothing


@pytest.mark.parametrize("method", Method)
def test_order_of_the_dense_output(method):
    """One less than the method's, so one step's error falls with the method's order itself."""
    y, table, errors = state(2), tableau(method), []
    for h in (2e-3, 1e-3, 5e-4):
        out, k, total = one_step(y, h, RING, SECOND_ORDER, method)
        worst = 0.0
        for x in (0.25, 0.6, 0.9):
            got = [dense_output(x, y[i], out[i], np.ascontiguousarray(k[:, i]), table.dense) for i in range(3)]
            got.append(dense_output(x, y[3:].sum(), out[3:].sum(), total, table.dense))
            want = exact(y, x * h)
            worst = max(worst, np.abs(np.array(got) - [*want[:3], want[3:].sum()]).max())
        errors.append(worst)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(table.order, abs=0.2)  # as above, h/tau = 0.15
    assert errors[2] > 1e-13


@pytest.mark.parametrize("poles", [1, 4])
@pytest.mark.parametrize(("part", "size"), [("field", 5.0), ("carriers", 2.0), ("heat", 7.0)])
def test_field_carriers_and_heat_weigh_alike_in_the_error(part, size, poles):
    y, out = np.array([3.0, 4.0, 2.0, *np.full(poles, 7 / poles)]), np.zeros(3 + poles)
    k = np.zeros((6, 3 + poles))
    at = {"field": np.array([0.6, -0.8, 0]), "carriers": np.array([0, 0, -1.0]), "heat": np.zeros(3)}[part]
    k[-1] = [*at, *np.full(poles, (part == "heat") / poles) * (-1) ** np.arange(poles)]  # an error of 1 in all
    network = Poles(np.empty((2, poles)), 0.0)
    want = 1 / size / np.sqrt(3) / 1e-6  # round-off decides the tolerance
    error = njit(step_error)
    assert error(y, out, 7.0, 0.0, k, 1e-6, FLOOR, network) == pytest.approx(want, rel=1e-14)
    assert error(out, y, 0.0, 7.0, k, 1e-6, FLOOR, network) == pytest.approx(want, rel=1e-14)
    assert error(y, out, 7.0, 0.0, k, 1e-6, np.full(3, 100.0), Poles(np.empty((2, poles)), 0.0)) == pytest.approx(
        want * size / 100, rel=1e-14
    )


TIMES = np.linspace(0, 20e3, 2001)


@pytest.fixture(scope="module")
def reference():
    return run(Method.RODAS5P, 1e-10, times=TIMES)[0]


def rms(rows, reference):
    """Root mean square error of field, carriers and temperature in units of their maxima."""
    return np.sqrt(np.mean(((rows - reference)[:, 1:] / np.abs(reference[:, 1:]).max(axis=0)) ** 2))


@pytest.mark.parametrize(
    ("method", "tolerances"), [(Method.RODAS4, [1e-4, 1e-5, 1e-6]), (Method.RODAS5P, [1e-6, 1e-7, 1e-8])]
)
def test_the_error_follows_the_tolerance(method, tolerances, reference):
    """Over 37 self-pulsing cycles, each of which passes a tenfold error of its jumps on to the next."""
    errors = [rms(run(method, rtol, times=TIMES)[0], reference) for rtol in tolerances]
    # Measured: 3e-4, 1.4e-5, 8.6e-7 and 2e-5, 1.5e-6, 6.4e-8; a factor of 2 is left for other processors' round-off.
    assert np.all(np.array(errors) < 50 * np.array(tolerances))
    assert np.all(np.array(errors[:-1]) / errors[1:] > 5)  # a decade of tolerance brings most of a decade of error
    assert np.all(np.array(errors[:-1]) / errors[1:] < 50)


def test_radau_on_the_printed_equations_agrees():
    """SciPy's Radau on the equations in SI, written independently: a check of everything, units included."""
    unit = np.array([np.sqrt(eq.FJ), np.sqrt(eq.FJ), eq.DENSITY, 1, 1])

    def f(t, z):
        y = np.maximum(z * unit, [-np.inf, -np.inf, 0, -np.inf, -np.inf])  # N^0.8 exists from 0 on
        da, dN, dx = printed_equations(y[0] + 1j * y[1], y[2], y[3:], POWER, 0.0, SECOND_ORDER)
        return np.array([da.real, da.imag, dN, *dx]) / unit * eq.NS

    times = np.linspace(0, 1200, 241)  # switch-on, heating, the fall of the carriers at 0.8 us and their jump at 1.1 us
    other = solve_ivp(f, (0, 1200), np.zeros(5), method="Radau", t_eval=times, rtol=1e-7, atol=1e-9)
    rows = run(Method.RODAS5P, 1e-9, duration=1200.0, times=times)[0]
    want = np.column_stack([*other.y[:3], other.y[3:].sum(axis=0)])
    # Radau's own: 1e-7 a step, forgotten within the carriers' 40 ns (10 steps) and grown a little by the jump.
    assert np.abs(rows[:, 1:] - want).max() < 2e-6


@pytest.mark.parametrize("method", Method)
def test_splitting_poles_changes_nothing(method):
    """Each pole as eight equal ones: the same physics, so the same steps, and states equal to round-off."""
    R, tau = np.repeat(SECOND_ORDER.R, 8) / 8, np.repeat(SECOND_ORDER.tau, 8)
    one, _, _, steps = run(method, 1e-5, duration=2e3)
    many, _, _, steps_many = run(method, 1e-5, duration=2e3, model=th.Foster(R=R, tau=tau))
    assert np.array_equal(steps, steps_many)
    # Round-off of the sums, 1e-15 a step, grown by e^(0.015/ns x 300 ns) = 100 in each of three unstable passages and
    # seen on edges of 6 sqrt(fJ) in 1 ns.
    assert many == pytest.approx(one, rel=1e-7, abs=1e-7)


def test_it_gives_up_with_a_reason_instead_of_running_for_ever():
    rows, _, reached, counts = run(Method.RODAS4, 1e-6, max_steps=100)
    assert counts[2] == TOO_MANY_STEPS
    assert counts[:2].sum() == 100
    assert reached == rows[-1, 0] < 20e3
    drive, _, rates, fcd, _ = problem(RING, SECOND_ORDER)
    args = (tableau(Method.RODAS4), 1e-6, FLOOR, np.empty(0), 1, 0.0, np.zeros(3), 10**6, new_watch())
    laser = steady_laser(1.0, drive, np.nan)
    _, _, reached, _, _, counts = integrate(np.zeros(5), laser, rates, fcd, eq.internal_thermal(SECOND_ORDER), *args)
    assert (reached, counts[2]) == (0, STEP_TOO_SMALL)
    assert run(Method.RODAS4, 1e-4, duration=1.0)[3][2] == DONE


def test_machine_code_older_than_what_it_calls_is_forgotten(tmp_path):
    kernel = SimpleNamespace(__module__="kernels.here", stats=SimpleNamespace(cache_path=str(tmp_path)))
    names = ("called.py", "here.run-7.py311.nbi", "there.run-7.py311.nbi")
    called, index, other = (tmp_path / name for name in names)
    for path, age in ((called, 0), (index, 1), (other, -1)):  # seconds by which the edit of called.py is older
        path.touch()
        os.utime(path, (1e9 + age, 1e9 + age))
    forget_if_older(kernel, str(called))
    assert index.exists()
    os.utime(called, (1e9 + 2, 1e9 + 2))
    (tmp_path / "here.gone-9.py311.nbi").symlink_to(tmp_path / "gone")  # another process deleted it between two looks
    forget_if_older(kernel, str(called))
    assert not index.exists()
    assert other.exists()


@pytest.mark.slow
def test_a_class_that_a_kernel_takes_may_be_renamed(tmp_path):
    """Numba reads the old machine code of a file before it sees that the file is newer, and with it the old class."""
    for name in ("Old", "Renamed"):
        (tmp_path / "made.py").write_text(
            "from typing import NamedTuple\nfrom coupled.kernels.compiling import compiled\n\n"
            f"class {name}(NamedTuple):\n    x: float\n\n"
            f"@compiled\ndef twice(a):\n    return 2 * a.x\n\nprint(twice({name}(1.5)))\n"
        )
        code = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]; import made"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert done.stdout == "3.0\n", done.stderr
