"""Transients in closed form on a growing space: the full-order answer within rtol, heat that adds up, its limits."""

from __future__ import annotations

import copy
import pickle
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
from models import coarse, coarse_fem, coarse_poles
from test_transient import Cosine, three_poles

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


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("wave", [STEP, PULSE, SQUARE, RAMPS], ids=lambda wave: type(wave).__name__)
def test_it_is_the_answer_of_every_pole_within_rtol(wave, rtol):
    """All poles of the full system, diagonalised."""
    system = coarse_fem()
    assert worst(system.response(wave, TIMES, rtol=rtol), coarse_poles().response(wave, TIMES)) < rtol


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


@pytest.mark.parametrize("read", ["core", "box", "cladding"])
def test_heat_on_its_way_elsewhere(read):
    """From 20 ps on, where the heat is still in the core: of a hundredth of the window's largest rise on."""
    heat, times = th.assemble(th.strip_ring(), accuracy=1e-2), np.geomspace(2e-11, 3e-8, 40)
    found, exact = (
        th.solve(heat, STEP, times, read=read, rtol=rtol, method=method).delta_T.values
        for rtol, method in ((1e-3, "auto"), (1e-7, "stepping"))
    )
    there = exact > 1e-2 * exact.max()
    assert np.all(np.abs(found - exact)[there] < 1e-3 * exact[there])


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
    [th.strip_ring(), th.strip_ring().opened()],
    ids=["held bottom", "open sides"],
)
def test_the_energy_balance_closes(geometry):
    heat = th.assemble(geometry)
    for data in (th.solve(heat, PULSE, TIMES), th.solve_periodic(heat, SQUARE, 101)):
        assert data.attrs["method"] == "closed form"
        assert abs(data.attrs["heat_imbalance"]) < 1e-9  # round-off of the solves
    exact = th.solve(heat, PULSE, TIMES, rtol=1e-6, method="stepping").attrs
    for key in ("heat_in", "heat_stored", "heat_out"):
        assert th.solve(heat, PULSE, TIMES).attrs[key] == pytest.approx(exact[key], rel=1e-4)


def test_fields_are_made_once():
    """At the end, not for every size of the space: of many of them memory is short."""
    system, at = coarse_fem(), np.linspace(1e-9, 2e-6, 1000)
    one = at.size * system.order * 8
    tracemalloc.start()
    run = Modal(system).run(system.C, PULSE, TIMES, rtol=1e-6, snapshots=at)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert run.snapshots.nbytes == one
    assert peak < 3 * one  # itself, and the space and its factors


@pytest.mark.parametrize("rtol", [1e-2, 1e-5])
def test_times_long_before_the_heat_has_left_the_part(rtol):
    """From 1 ps on the shifts reach further, and what is small then still counts."""
    system, times = coarse_fem(), np.geomspace(1e-12, 1e-6, 40)
    assert worst(system.response(STEP, times, rtol=rtol), coarse_poles().response(STEP, times)) < rtol


def test_a_first_time_of_round_off_costs_no_more():
    """Nothing in the mesh is faster than its fastest cell."""
    system, times = coarse_fem(), np.array([1e-22, 1e-8, 1e-6])
    run = Modal(system).run(system.C, STEP, times, rtol=1e-5)
    assert run.factorizations <= 5
    assert worst(run.outputs[:, 0], coarse_poles().response(STEP, times)) < 1e-5


@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_no_gap_between_shifts_is_wider_than_said(rtol):
    """Two shifts four decades apart did not settle within 25 rounds from 10 ps on."""
    heat, times = th.assemble(th.strip_ring()), np.geomspace(1e-11, 1e-6, 6)
    data = th.solve(heat, STEP, times, read=("core", "box", "cladding"), rtol=rtol)
    assert (data.attrs["method"], data.attrs["solves"] < 80) == ("closed form", True)


@pytest.mark.parametrize("before", [1e-12, 1e-6, 1e-4])
def test_a_loud_power_after_a_faint_one(before):
    """The first times that matter are those behind the jump, 10 ps to 1 ns, not the microsecond before."""
    system, times = coarse_fem(), 1e-6 + np.array([1e-12, 1e-11, 1e-10, 1e-9])
    wave = th.Sampled([0, 1e-6, 1e-6, 1e-5], [before, before, 1.0, 1.0])
    run = Modal(system).run(system.C, wave, times, rtol=1e-6)
    assert worst(run.outputs[:, 0], coarse_poles().response(wave, times)) < 1e-6


@pytest.mark.parametrize("wave", [SQUARE, RAMPS, STEP], ids=lambda wave: type(wave).__name__)
def test_the_start_alone(wave):
    """Nothing is asked of the power beyond the last wanted time: a record may end, a train be short."""
    wave = th.SquareWave(2e-3, 1e-7, 0.5) if wave is SQUARE else wave
    assert coarse_fem().response(wave, [0.0]) == pytest.approx([0.0])


@pytest.mark.parametrize("rtol", [1e-7, 1e-6, 1e-5, 3e-5])
@pytest.mark.parametrize(
    ("read", "times"), [("oxide", [1e-7]), ("core", [1.1e-6]), ("core", np.geomspace(1.05e-9, 1e-7, 40))]
)
def test_a_change_that_is_small_by_chance(read, times, rtol):
    """One small change stopped 2.7 times rtol away: an error may just change its sign where pulses are short."""
    system, wave = coarse(8)[1].state_space(("core",), (read,)), th.SquareWave(1e-3, 2.8e-9, 0.00885)  # on for 25 ps
    run = Modal(coarse_fem(8)).run(system.C, wave, times, rtol=rtol)
    assert worst(run.outputs[:, 0], poles_read_at(read).response(wave, times)) < rtol


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4])
def test_changes_that_hardly_fall_do_not_pass_for_an_answer(rtol, monkeypatch):
    """Two shifts nine decades apart: what a round brings is small, what is missing is not."""
    monkeypatch.setattr(modal, "SPAN", 100.0)
    monkeypatch.setattr(modal, "ROUNDS", 60)
    system, times = coarse_fem(), np.geomspace(1e-14, 1e-6, 60)
    run = Modal(system).run(system.C, STEP, times, rtol=rtol)
    assert run is None or worst(run.outputs[:, 0], coarse_poles().response(STEP, times)) < rtol


def test_a_system_smaller_than_the_space_is_exact():
    found = three_poles().response(STEP, [0.0, 0.1, 1.0])
    assert found == pytest.approx(foster(three_poles()).response(STEP, [0.0, 0.1, 1.0]), rel=1e-12)
    assert three_poles().response(STEP, [0.0]) == pytest.approx([0.0])


def test_what_it_cannot_answer_is_stepped(monkeypatch):
    system, smooth = coarse_fem(), Cosine(1e6)
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
    first, stepped = th.solve(heat, pulse, times), th.solve(heat, Cosine(1e6), times)
    other = copied(heat)
    assert np.array_equal(th.solve(other, pulse, times).delta_T, first.delta_T)
    assert np.array_equal(th.solve(other, Cosine(1e6), times).delta_T, stepped.delta_T)
    assert other.thermal_resistance() == heat.thermal_resistance()


def test_refusals():
    skew = th.StateSpace(np.eye(2), np.array([[-1.0, 0.5], [0.0, -2.0]]), np.ones((2, 1)), np.ones((1, 2)))
    with pytest.raises(th.InputError, match="symmetric"):  # the factors take one triangle for both
        skew.response(STEP, [1.0])
    heat = th.assemble(th.strip_ring())
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
