"""Certified reduction: the bound is above the true error, below the tolerance, and the physics survives."""

from functools import cache
from itertools import combinations_with_replacement

import numpy as np
import pytest
from audit import reductions
from scipy.sparse.linalg import splu
from surrogate_systems import discretized, geometries, slicot, strip

import surrogate
import thermofem as th
from surrogate.reduction.certified_space import PER_DECADE, SOLVE_ROUND_OFF
from thermofem.algebra.pole_responses import pole_responses
from thermofem.models import foster

GEOMETRIES = list(geometries(8))
FREQUENCY = np.geomspace(1e3, 1e12, 28)  # three a decade


def bound_at(rom, frequency):
    """The larger of the two samples around each frequency."""
    k = np.clip(np.searchsorted(rom.frequency, frequency), 1, rom.frequency.size - 1)
    return np.maximum(rom.bound[k - 1], rom.bound[k])


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize(("tolerance", "most"), [(1e-3, 14), (1e-4, 18), (1e-5, 24)])
def test_true_error_below_bound_below_tolerance(geometry, tolerance, most):
    system = strip(**geometry)
    rom = surrogate.reduce(system, tolerance)
    exact = impedance(**geometry)
    error = abs(exact - rom.model.impedance(FREQUENCY)) / system.thermal_resistance
    # between two samples (1/60 decade) the bound changes by less than its curvature allows
    assert np.all(error <= bound_at(rom, FREQUENCY) * np.exp(rom.order * (np.log(10) / PER_DECADE) ** 2 / 8))
    assert rom.bound.max() <= rom.error_bound <= tolerance
    assert rom.order <= most
    # effectivity: the bound is under 3 times the error where that is largest
    assert bound_at(rom, FREQUENCY)[error.argmax()] < 3 * error.max()
    assert rom.model.passive
    # s = 0 is a shift: exact up to the round-off of the solves, here and of the reference
    assert rom.model.thermal_resistance == pytest.approx(system.thermal_resistance, rel=SOLVE_ROUND_OFF)


def test_shifts_far_apart_have_one_between_them_for_the_bound():
    """Open sides: heat that spreads for ever is slow beside the core's."""
    system = th.assemble(th.strip_ring().opened()).system
    exact = system.impedance(FREQUENCY)
    for tolerance in (1e-3, 1e-4):
        rom = surrogate.reduce(system, tolerance)
        assert rom.shifts[1] < rom.shifts[3] < rom.shifts[2]
        error = abs(exact - rom.model.impedance(FREQUENCY)) / system.thermal_resistance
        assert rom.error_bound <= tolerance
        assert error.max() <= bound_at(rom, FREQUENCY)[error.argmax()] < 2 * error.max()  # 2.7 to 2.9 without it


@cache
def impedance(**geometry):
    """Full-order impedance at FREQUENCY, solved once for each geometry."""
    return strip(**geometry).impedance(FREQUENCY)


def test_bound_is_the_residual_norm_of_the_full_system():
    """The closed form R = Rhat Phi against residuals formed from the full matrices, one frequency at a time."""
    system = strip(smallest=0.1)
    rom = surrogate.reduce(system, 1e-3)
    K, M, b = -system.A.tocsc(), system.E.tocsc(), system.B[:, 0]
    shifts = rom.shifts[1:]
    factors = [splu((K + s * M).tocsc()) for s in shifts]
    joint = 0
    for i in range(150, rom.frequency.size - 150, 60):
        omega = 2 * np.pi * rom.frequency[i]
        z = np.asarray(rom.model.R) / (1 + 1j * omega * np.asarray(rom.model.tau))
        r = b - (K + 1j * omega * M) @ rom.lift(z)
        norms = [np.real(r.conj() @ (f.solve(r.real) + 1j * f.solve(r.imag))) for f in factors]
        rate = omega * np.append(0, np.geomspace(1e-4, 1e4, 20001))  # the minimum of rho is flat: 1e-7 of it
        ways = {}
        for (s, q), (t, p) in combinations_with_replacement(zip(shifts, norms, strict=True), 2):
            rho = np.min(np.hypot(rate, omega) / np.sqrt((rate + s) * (rate + t)))
            ways[s, t] = np.sqrt(q * p) / rho
        direct = min(ways.values())
        joint += min(ways, key=ways.get) == tuple(shifts)
        # r is the difference of vectors about 1e3 times larger, squared: 1e-16 x 1e6, and the lift adds its own
        assert rom.bound[i] == pytest.approx(direct / system.thermal_resistance, rel=1e-6)
    assert joint  # between the two shifts both together bound best


def test_for_real_s_the_reduction_approaches_from_below():
    system = strip()
    K, M, b = -system.A.tocsc(), system.E.tocsc(), system.B[:, 0]
    s = np.geomspace(1e3, 1e12, 20)
    exact = np.array([b @ splu((K + x * M).tocsc()).solve(b) for x in s])
    left = np.inf
    for tolerance in (1e-1, 1e-2, 1e-3, 1e-4, 1e-6):
        model = surrogate.reduce(system, tolerance).model
        missing = exact - (np.asarray(model.R) / (1 + s[:, None] * model.tau)).sum(axis=1)
        assert np.all(missing >= -SOLVE_ROUND_OFF * system.thermal_resistance)
        assert 0 < missing.max() < left
        left = missing.max()


def test_step_and_periodic_state_match_the_full_order_integrator():
    system = strip()
    model = surrogate.reduce(system, 1e-6).model
    times = np.geomspace(1e-9, 1e-4, 40)
    wave = th.SquareWave(power=2e-3, period=1e-6, duty=1 / 3)
    step, periodic = system.step_response(times, rtol=1e-5), system.periodic_response(wave, 101, rtol=1e-5)
    # the integrator is asked for 1e-5 of the largest rise; the reduction adds 1e-6 of R_th at any one frequency
    assert np.abs(model.step_response(times) - step).max() < 2e-5 * step.max()
    assert np.abs(model.periodic_response(wave, 101) - periodic).max() < 2e-5 * periodic.max()


def test_lifted_states_are_the_field_of_the_full_system():
    system = strip()
    rom = surrogate.reduce(system, 1e-5)
    wave = th.Pulse(power=2e-3, width=1e-6)
    times = np.array([2e-7, 1e-6, 3e-6])
    full = th.transient.integrate(system, wave, times, rtol=1e-6, snapshots=times).snapshots
    lifted = rom.lift(pole_responses(1 / rom.model.tau, wave, times) * rom.model.gain)
    assert np.allclose(lifted @ system.C[0], rom.model.response(wave, times), rtol=1e-9)
    # the mean over the core is certified; the field converges as the square root of the bound, here .003 of its peak
    assert np.abs(lifted - full).max() < np.sqrt(rom.tolerance) * full.max()


def test_heater_and_core_have_a_certificate_per_channel():
    system = discretized(heater=True, smallest=0.1).state_space(("core", "heater"), ("core", "heater", "box"))
    rom = surrogate.reduce(system, 1e-4)
    assert rom.model.inputs == ("core", "heater")
    assert rom.channel_bounds.shape == (3, 2)
    assert rom.channel_bounds.max() == rom.error_bound <= 1e-4
    frequency, B = np.geomspace(1e4, 1e10, 13), system.B + 0j
    exact = np.array([system.C @ splu((2j * np.pi * f * system.E - system.A).tocsc()).solve(B) for f in frequency])
    for j, read in enumerate(system.outputs):
        for i, heated in enumerate(system.inputs):
            error = abs(exact[:, j, i] - foster(rom.model.channel(heated, read)).impedance(frequency))
            assert error.max() <= rom.channel_bounds[j, i] * system.gain[j, i]
    # reciprocity survives the projection
    assert rom.model.gain[0, 1] == pytest.approx(rom.model.gain[1, 0], rel=1e-9)
    cross = surrogate.reduce(system.channel("heater", "core"), 1e-4)
    assert cross.model.thermal_resistance == pytest.approx(system.gain[0, 1], rel=1e-8)
    assert cross.error_bound <= 1e-4


def test_for_several_ports_a_finer_sampling_finds_nothing_higher(monkeypatch):
    """That the bound is smooth between samples is proved for one port and assumed for several: checked here."""
    system = discretized(heater=True, smallest=0.2).state_space(("core", "heater"), ("core", "heater"))
    coarse = surrogate.reduce(system, 1e-3)
    monkeypatch.setattr("surrogate.reduction.certified_space.PER_DECADE", 20 * PER_DECADE)
    fine = surrogate.reduce(system, 1e-3)
    assert fine.order == coarse.order
    assert fine.bound.max() > coarse.bound.max()  # there is something between the samples
    assert np.all(fine.bound.max(axis=0) <= coarse.channel_bounds)


def test_slicot_heat_conduction(validated):
    """A smooth system: what the basis leaves of the port is soon 1e-5 of it."""
    system = slicot()
    source, ours = "published with ten digits", system.thermal_resistance
    validated("Compact models", "static gain of SLICOT heat-cont", ours, 0.1105583195, within=5e-11, source=source)
    frequency = np.geomspace(1e-4, 1e5, 50)
    for tolerance in (1e-3, 1e-6, 1e-7):
        rom = surrogate.reduce(system, tolerance)
        error = abs(system.impedance(frequency) - rom.model.impedance(frequency)) / 0.1105583195
        assert error.max() <= rom.error_bound <= tolerance
        assert rom.model.thermal_resistance == pytest.approx(0.1105583195, abs=5e-11)


def test_a_system_that_is_already_small_is_returned_exactly():
    model = th.Foster(R=[1000.0, 2000.0, 5000.0], tau=[2e-8, 3e-7, 1e-5])
    gain = np.sqrt(model.gain)
    system = th.StateSpace(np.eye(3), -np.diag(1 / np.asarray(model.tau)), gain[:, None], gain[None])
    rom = surrogate.reduce(system, 1e-6)
    assert rom.order == 3
    assert np.allclose(rom.model.R, model.R, rtol=1e-9)
    assert np.allclose(rom.model.tau, model.tau, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"A": np.array([[-1.0, 2.0], [2.0, -1.0]])}, "positive"),
        ({"A": np.diag([1.0, -5.0]), "B": np.array([[0.1], [1.0]]), "C": np.array([[0.1, 1.0]])}, "a mode grows"),
        ({"A": np.diag([3.0, -3.0])}, "a static gain is not positive"),  # it is 1/3 - 1/3
        ({"A": np.diag([1e5, -1e5])}, "a static gain is not positive"),  # it was reduced, with a bound of 1e-9
        ({"B": np.zeros((2, 1))}, "zero everywhere"),
    ],
)
def test_what_is_no_heat_problem_is_refused(change, reason):
    parts = {"E": np.eye(2), "A": -np.diag([1.0, 2.0]), "B": np.ones((2, 1)), "C": np.ones((1, 2)), **change}
    with pytest.raises(th.InputError, match=reason):
        surrogate.reduce(th.StateSpace(**parts))


@pytest.mark.parametrize("tolerance", [0.0, 1e-12, 0.5, float("nan")])
def test_tolerance_out_of_range(tolerance):
    with pytest.raises(th.InputError, match="tolerance"):
        surrogate.reduce(strip(), tolerance)


@pytest.mark.parametrize("n", [2, 5, 7, 12])
@pytest.mark.parametrize("ports", [1, 2])
def test_the_bound_holds_where_the_basis_holds_the_ports_to_round_off(n, ports):
    """Short chains of lumps: what is left of the ports says nothing there, and a bound of 1e-10 can stand for 2e-8."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        K = 1e-4 * (np.diag(2 + rng.random(n)) - np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1))
        M, B = np.diag(10 ** rng.uniform(-12, -10, n)), np.eye(n)[:, :ports]
        names = ("core", "heater")[:ports]
        rom = surrogate.reduce(th.StateSpace(M, -K, B, B.T, inputs=names, outputs=names), tolerance=1e-7)
        small = rom.model if ports == 1 else rom.model.channel("heater", "core")
        full = th.StateSpace(M, -K, B[:, [-1]], B[:, [0]].T, inputs=names[-1:], outputs=names[:1])
        f = np.geomspace(1e2, 1e10, 100)
        # solves of these small matrices leave 1e-12
        scale = np.sqrt(np.prod(np.diag(np.linalg.inv(K))[[0, ports - 1]]))
        error = np.abs(full.impedance(f) - small.impedance(f)).max() / scale
        assert error < rom.error_bound + 1e-12
        assert rom.error_bound <= 1e-7
        assert small.order <= n


@pytest.mark.slow
def test_bounds_of_random_pencils_hold_and_no_tolerance_is_refused_falsely():
    """The first of the 1500 of `make audit`, and ports that differ by 1e-1 to 1e-12."""
    cases = [reductions.case(seed) for seed in (*range(15), 911)] + [
        reductions.nearly_equal(10.0**-k, k) for k in (3, 6, 9, 12)
    ]
    for one in cases:
        found = reductions.judge(one)
        assert not found.refusal, (one.name, found.refusal)
        assert found.ratio <= 1, one.name
