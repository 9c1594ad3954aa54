"""Transients in closed form on a growing space: the full-order answer within rtol, heat that adds up, its limits."""

from __future__ import annotations

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from models import coarse, coarse_fem, coarse_poles
from test_transient import cosine

import thermofem as th
from thermofem.models import foster
from thermofem.transient import integrate, modal
from thermofem.transient.modal import Modal

STEP, PULSE, SQUARE = th.Constant(2e-3), th.Pulse(2e-3, 1e-6), th.SquareWave(2e-3, 0.4e-6, 1 / 3)
RAMPS = th.Sampled([0.0, 0.3e-6, 0.31e-6, 20e-6], [0.0, 2e-3, 0.0, 1e-3])
TIMES = np.geomspace(1e-9, 20e-6, 60)


READ = ("core", "cladding", "box", "substrate")


@cache
def poles_read_at(part):
    """All poles of a finer mesh, with the residues of one part's mean temperature."""
    return foster(coarse(8)[1].state_space(("core",), (part,)))


@cache
def stepped(wave):
    """The reference strip by stepping, a thousand times tighter, read everywhere."""
    return th.solve(th.assemble(th.strip_ring()), wave, TIMES, read=READ, rtol=1e-7, method="stepping")


def worst(found, exact):
    """Largest error relative to the largest value so far."""
    return float((np.abs(found - exact) / np.maximum.accumulate(np.abs(exact))).max())


DRIVES = {
    "step": (STEP, TIMES),
    "pulse": (PULSE, TIMES),
    "square": (SQUARE, TIMES),
    "ramps": (RAMPS, TIMES),
    # from 1 ps on the shifts reach further, and what is small then still counts
    "long before the heat has left the part": (STEP, np.geomspace(1e-12, 1e-6, 40)),
    # the first times that matter are those behind the jump, 10 ps to 1 ns, not the microsecond before
    **{
        f"a loud power after {faint:g} W": (
            th.Sampled([0, 1e-6, 1e-6, 1e-5], [faint, faint, 1.0, 1.0]),
            1e-6 + np.array([1e-12, 1e-11, 1e-10, 1e-9]),
        )
        for faint in (1e-12, 1e-6, 1e-4)
    },
}


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("drive", DRIVES)
def test_it_is_the_answer_of_every_pole_within_rtol(drive, rtol):
    """All poles of the full system, diagonalised."""
    system = coarse_fem()
    assert worst(system.response(*DRIVES[drive], rtol=rtol), coarse_poles().response(*DRIVES[drive])) < rtol


def test_the_periodic_state_is_that_of_every_pole():
    system = coarse_fem()
    exact = coarse_poles().periodic_response(SQUARE, 301)
    assert np.abs(system.periodic_response(SQUARE, 301, rtol=1e-6) - exact).max() < 1e-6 * exact.max()


@pytest.mark.parametrize("read", READ)
@pytest.mark.parametrize("wave", [STEP, PULSE], ids=["step", "pulse"])
def test_stepping_the_mesh_agrees_wherever_it_is_read(read, wave):
    """Relative to the largest rise so far, or 1e-6 of the largest of all: what has not arrived is not held."""
    heat = th.assemble(th.strip_ring())
    found = th.solve(heat, wave, TIMES, read=read, rtol=1e-4)
    exact = stepped(wave)
    assert (found.attrs["method"], exact.attrs["method"]) == ("closed form", "stepping")
    assert found.attrs["solves"] < exact.attrs["solves"] / 10
    exact = exact.sel(probe=read)
    rise = np.abs(exact.delta_T.values)
    allowed = 1e-4 * np.maximum.accumulate(rise) + 1e-6 * rise.max()
    assert np.all(np.abs(found.delta_T.values - exact.delta_T.values) < allowed)


def test_it_does_not_depend_on_what_ran_before():
    heat, other = th.assemble(th.strip_ring()), th.assemble(th.strip_ring())
    th.solve(other, PULSE, TIMES, read="substrate", rtol=1e-7)
    first, second = (th.solve(one, PULSE, TIMES) for one in (heat, other))
    # factors of other numbers in the same place: round-off
    assert first.delta_T.values == pytest.approx(second.delta_T.values, rel=1e-9)
    with ThreadPoolExecutor(4) as pool:
        several = list(pool.map(lambda rtol: th.solve(other, PULSE, TIMES, rtol=rtol), [1e-4] * 4))
    assert all(np.array_equal(one.delta_T, second.delta_T) for one in several)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_fields_are_those_of_the_stepped_mesh(rtol):
    """In the energy norm, in which two rounds bring them five times nearer: slower than what the core feels of them."""
    system, at = coarse_fem(), [3e-9, 1e-6, 1.5e-6]
    found = Modal(system).run(system.C, PULSE, TIMES, rtol=rtol, snapshots=at).snapshots
    exact = integrate(system, PULSE, TIMES, rtol=1e-8, snapshots=at).snapshots
    for mine, full in zip(found, exact, strict=True):
        assert (mine - full) @ system.E @ (mine - full) < rtol**2 * (full @ system.E @ full)


@pytest.mark.parametrize(
    "geometry",
    [th.strip_ring(), th.strip_ring().opened(), th.straight_guide()],
    ids=["held bottom", "open sides", "straight"],
)
def test_the_energy_balance_closes(geometry):
    heat = th.assemble(geometry)
    for data in (th.solve(heat, PULSE, TIMES), th.solve_periodic(heat, SQUARE, 101)):
        assert data.attrs["method"] == "closed form"
        assert abs(data.attrs["heat_imbalance"]) < 1e-9  # round-off of the solves
    exact = th.solve(heat, PULSE, TIMES, rtol=1e-6, method="stepping").attrs
    for key in ("heat_in", "heat_stored", "heat_out"):
        assert th.solve(heat, PULSE, TIMES).attrs[key] == pytest.approx(exact[key], rel=1e-4)


def test_a_first_time_of_round_off_costs_no_more():
    """Nothing in the mesh is faster than its fastest cell."""
    system, times = coarse_fem(), np.array([1e-22, 1e-8, 1e-6])
    run = Modal(system).run(system.C, STEP, times, rtol=1e-5)
    assert run.factorizations <= 5
    assert worst(run.outputs[:, 0], coarse_poles().response(STEP, times)) < 1e-5


@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_no_gap_between_shifts_is_wider_than_said(rtol):
    """Two shifts four decades apart do not settle within 25 rounds from 10 ps on."""
    heat, times = th.assemble(th.strip_ring()), np.geomspace(1e-11, 1e-6, 6)
    data = th.solve(heat, STEP, times, read=("core", "box", "cladding"), rtol=rtol)
    assert (data.attrs["method"], data.attrs["solves"] < 80) == ("closed form", True)


@pytest.mark.parametrize("rtol", [1e-7, 1e-6, 1e-5, 3e-5])
@pytest.mark.parametrize(
    ("read", "times"), [("oxide", [1e-7]), ("core", [1.1e-6]), ("core", np.geomspace(1.05e-9, 1e-7, 40))]
)
def test_a_change_that_is_small_by_chance(read, times, rtol):
    """One small change stopped 2.7 times rtol away: an error may just change its sign where pulses are short."""
    system, wave = coarse(8)[1].state_space(("core",), (read,)), th.SquareWave(1e-3, 2.8e-9, 0.00885)  # on for 25 ps
    run = Modal(coarse_fem(8)).run(system.C, wave, times, rtol=rtol)
    assert worst(run.outputs[:, 0], poles_read_at(read).response(wave, times)) < rtol


def test_what_it_cannot_answer_is_stepped(monkeypatch):
    system, smooth = coarse_fem(), cosine(1e6)
    assert Modal(system).run(system.C, smooth, TIMES, rtol=1e-4) is None
    exact = integrate(system, smooth, TIMES, rtol=1e-5).outputs[:, 0]
    assert np.array_equal(system.response(smooth, TIMES, rtol=1e-5), exact)
    t = np.array([0.5, 1.0])
    growing = th.StateSpace(np.eye(2), -np.diag([-1.0, 2.0]), np.array([[0.5], [2.0]]), np.array([[0.5, 2.0]]))
    found = growing.response(th.Constant(1.0), t)
    assert found == pytest.approx(0.25 * np.expm1(t) - 2 * np.expm1(-2 * t), rel=1e-5)
    monkeypatch.setattr(modal, "ROUNDS", 4)
    assert Modal(system).run(system.C, STEP, TIMES, rtol=1e-4) is None


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda heat: pickle.loads(pickle.dumps(heat))])
def test_a_heat_problem_travels_to_another_process_after_a_run(copied):
    """The factors of qdldl and the locks around them could not be copied."""
    heat = th.assemble(th.strip_ring(), 1e-2)
    pulse, times = th.Pulse(1e-3, 1e-6), [1e-9, 1e-7, 1e-5]
    first, stepped = th.solve(heat, pulse, times), th.solve(heat, cosine(1e6), times)
    other = copied(heat)
    assert np.array_equal(th.solve(other, pulse, times).delta_T, first.delta_T)
    assert np.array_equal(th.solve(other, cosine(1e6), times).delta_T, stepped.delta_T)
    assert other.thermal_resistance() == heat.thermal_resistance()


def test_the_start_alone():
    """Nothing is asked of the power beyond the last wanted time: a record may end, a train be short."""
    for wave in (th.SquareWave(2e-3, 1e-7, 0.5), RAMPS, STEP):
        assert coarse_fem().response(wave, [0.0]) == pytest.approx([0.0])


def test_refusals():
    skew = th.StateSpace(np.eye(2), np.array([[-1.0, 0.5], [0.0, -2.0]]), np.ones((2, 1)), np.ones((1, 2)))
    with pytest.raises(th.InputError, match="symmetric"):  # the factors take one triangle for both
        skew.response(STEP, [1.0])
    heat = th.assemble(th.strip_ring(), 1e-2)
    with pytest.raises(th.InputError, match="method"):
        th.solve(heat, PULSE, TIMES, method="guess")
    for times, rtol in (([1e-6, 0.5e-6], 1e-4), ([-1e-9, 1e-6], 1e-4), (TIMES, 1.0)):
        with pytest.raises(th.InputError, match=r"times|rtol"):
            th.solve(heat, PULSE, times, rtol=rtol)


def poles(E, A, B, C):
    """A small dense system of two states."""
    return th.StateSpace(np.diag(E), np.diag(A), np.array(B)[:, None], np.array(C)[None])


@pytest.mark.parametrize(
    ("system", "exact"),
    [
        (poles([1.0, 1.0], [-1.0, -2.0], [1.0, 0.0], [1.0, 0.0]), lambda t: -np.expm1(-t)),  # one pole is never heated
        (poles([1.0, 1.0], [-1.0, -2.0], [0.0, 0.0], [1.0, 1.0]), lambda t: 0 * t),  # nor any
        (poles([1.0, 1.0], [1.0, 2.0], [1.0, 1.0], [1.0, 0.0]), np.expm1),  # growing
        (poles([1.0, 1.0], [1.0, -2.0], [1.0, 1.0], [1.0, 0.0]), np.expm1),
        (poles([1.0, -1.0], [-1.0, -2.0], [1.0, 1.0], [1.0, 0.0]), lambda t: -np.expm1(-t)),  # E not definite
        (poles([1.0, -3.0], [-1.0, -2.0], [1.0, 1.0], [1.0, 0.0]), lambda t: -np.expm1(-t)),
    ],
)
def test_what_is_hardly_heat_flow(system, exact):
    """Poles that nothing heats, that grow, or that E does not measure: in closed form or stepped, but answered."""
    t = np.array([0.1, 0.5])
    assert system.response(th.Constant(1.0), t) == pytest.approx(exact(t), rel=1e-5)


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6])
def test_a_space_that_cannot_grow_is_no_settled_one(rtol):
    """Rates whose heat hardly reaches the last hundred states: the space stopped growing with an error of 7e-2."""
    rates = np.append(1e5 * np.geomspace(1, 1e5, 200), np.geomspace(1e4, 1e6, 100))
    gains = np.append(np.ones(200), np.full(100, 1e-6)) * rates
    read = np.append(np.zeros(200), np.ones(100))
    system = th.StateSpace(np.eye(300), -np.diag(rates), np.sqrt(gains)[:, None], (read * np.sqrt(gains))[None])
    times = np.geomspace(1e-9, 1e-5, 30)
    rise = system.response(th.Constant(1e-3), times, rtol=rtol)
    exact = 1e-3 * -np.expm1(-times[:, None] * rates) @ (read * gains / rates)
    # relative to the largest so far, or to a tenth of what the field would mean at the probe (`esdirk.FAR`)
    assert np.abs(rise - exact).max() <= 2 * rtol * exact[-1]
