"""FEM in the loop: against the certified reduction, a monolithic integration, closed forms, and itself."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from time import process_time
from types import SimpleNamespace

import numpy as np
import pytest
from correctors import MW, NETWORK, RING, Exact, traces_apart
from models import coarse_fem, coarse_warm_fem, warm_fem
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh
from scipy.sparse import bmat, diags

import coupled
import surrogate
import thermofem as th
from coupled.kernel import units as eq
from coupled.kernel.tableaus import Method
from coupled.runs.pulsing import crossings
from thermofem.transient import integrate
from thermofem.waveforms import PiecewiseCubic


@cache
def strip():
    heat = th.assemble(th.strip_ring())
    return heat, surrogate.reduce(heat.system, tolerance=1e-6).model


@pytest.mark.parametrize(("dBm", "GHz"), [(8, 0), (5, 0), (7, -10), (10, 20), (8, 25), (6, 10)])
def test_the_fem_in_the_loop_is_the_certified_reduction(dBm, GHz):
    """The reduction is within 1e-6 of R_th; left are 1e-4 K of tolerance and how finely the steps sample the duty."""
    heat, reduction = strip()
    drive = {"power": 1e-3 * 10 ** (dBm / 10), "detuning": GHz * 1e9, "duration": 6e-6, "rtol": 1e-9}
    run = coupled.cosimulate(RING, heat, max_discrepancy=1e-4, **drive)
    found, wanted = coupled.pulsing(run), coupled.pulsing(coupled.simulate(RING, reduction, **drive))
    assert found.regime == wanted.regime == "self-pulsing"
    for name in ("period", "duty", "swing"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-4, abs=0)
    assert run.attrs["largest_discrepancy"] < 1e-4
    assert abs(run.attrs["heat_imbalance"]) < 1e-7  # the cubics between the grid times of the fast part


def test_period_at_8_dBm_after_20_us():
    """The last cycle from cold: 680 ns and 5.87 K, found independently; 1e-2 for what the other mesh differs."""
    found = coupled.pulsing(coupled.cosimulate(RING, strip()[0], power=MW, duration=20e-6))
    assert found.period == pytest.approx(680e-9, rel=1e-2, abs=0)
    assert found.swing == pytest.approx(5.87, rel=1e-2)


@pytest.mark.parametrize("predictor", [None, surrogate.newton(tau_th=275e-9)], ids=["own", "newton"])
@pytest.mark.slow
def test_a_monolithic_stiff_integration_agrees(predictor):
    """Light, carriers and every temperature of a mesh in one system, by SciPy's Radau: 1e-5 of the largest rise."""
    times, rise, error = _monolithic()
    run = coupled.cosimulate(
        RING, coarse_fem(), predictor=predictor, power=20e-3, duration=times[-1], max_discrepancy=1e-5, rtol=1e-9
    )
    assert rise.max() > 4  # carriers and heat have switched
    assert error < 1e-6 * rise.max()
    assert np.abs(CubicSpline(run.time, run.delta_T)(times) - rise).max() < 1e-5 * rise.max()


@cache
def _monolithic():
    """Times, rise and how far a run at a tenth of the tolerance is off, for 928 unknowns.

    SciPy knows no mass matrix, so the field is written in all eigenvectors of the matrices, each with its own power;
    light and carriers see their sum. The Jacobian is an arrow.
    """
    system, times = coarse_fem(), np.linspace(0, 0.2e-6, 101)
    n, unit_gain = system.order, th.Foster(R=[1 / (eq.UW * eq.NS)], tau=[1.0])  # dx/dt = P - 1e-9 x
    light = eq.single_ring(RING, unit_gain, 20e-3, 0.0, 1e-9, Method.RODAS4)
    rate, modes = eigh(-system.A.toarray(), system.E.toarray())
    decay, c = -rate * eq.NS, system.C[0] @ modes
    b = modes.T @ system.B[:, 0] * eq.UW * eq.NS

    def right(t, y):
        rise = c @ y[3:]
        slopes = light.slopes(np.append(y[:3], rise))[0]
        return np.concatenate([slopes[:3], decay * y[3:] + b * (slopes[3] + 1e-9 * rise)])

    def jacobian(t, y):
        J = light.slopes(np.append(y[:3], c @ y[3:]))[1]
        return bmat([[J[:3, :3], np.outer(J[:3, 3], c)], [np.outer(b, J[3, :3]), diags(decay)]], format="csc")

    def solved(rtol):
        options = {"jac": jacobian, "rtol": rtol, "atol": 0.1 * rtol}
        return c @ solve_ivp(right, (0, times[-1] / eq.NS), np.zeros(3 + n), "Radau", times / eq.NS, **options).y[3:]

    rise = solved(1e-8)
    return times, rise, np.abs(solved(1e-7) - rise).max()


@pytest.mark.parametrize(
    "predictor", [None, NETWORK, coupled.loop.cosimulate.NO_PREDICTOR], ids=["own", "second order", "none"]
)
def test_any_predictor_gives_the_same_answer(predictor):
    """The other kinds of models are those of tests/test_every_model.py."""
    system, drive = coarse_fem(), {"power": MW, "duration": 0.3e-6, "rtol": 1e-7}
    reference = coupled.cosimulate(RING, system, max_discrepancy=1e-5, **drive)
    run = coupled.cosimulate(RING, system, predictor=predictor, max_discrepancy=1e-3, **drive)
    assert run.attrs["largest_discrepancy"] <= 1e-3
    # the light turns a discrepancy of 1e-3 K into ten times as much where it switches
    assert traces_apart(run, reference) * reference.delta_T.values.max() < 1e-2
    assert (run.attrs["passes"] > 2 * run.attrs["windows"]) == (predictor is not None)


@pytest.mark.slow
def test_the_error_falls_with_the_tolerance():
    drive = {"power": 20e-3, "duration": 0.2e-6, "rtol": 1e-8}
    fine = np.linspace(0, 0.2e-6, 20001)
    reduction = surrogate.reduce(coarse_fem(), tolerance=1e-7).model
    reference = coupled.simulate(RING, reduction, times=fine, **drive).delta_T.values
    errors = []
    for tolerance in (3e-1, 3e-2, 3e-3):
        run = coupled.cosimulate(
            RING, coarse_fem(), predictor=surrogate.newton(tau_th=275e-9), max_discrepancy=tolerance, **drive
        )
        errors.append(np.abs(np.interp(run.time, fine, reference) - run.delta_T).max())
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 4
    assert errors[2] < 3e-3


def test_k_of_T_in_the_loop():
    """The run's own absorbed power through the full-order nonlinear solver gives the run's temperature."""
    system = coarse_warm_fem()
    run = coupled.cosimulate(RING, system, power=0.1, duration=40e-9, max_discrepancy=5e-4)
    times, spline = run.time.values, CubicSpline(run.time, run.absorbed)
    wave, some = PiecewiseCubic.of_spline(spline), slice(None, None, times.size // 10)
    alone, linear = (integrate(model, wave, times[some], rtol=1e-4).outputs[:, 0] for model in (system, system.linear))
    rise = run.delta_T.values[some]
    assert rise == pytest.approx(alone, rel=0, abs=5e-4)
    assert np.abs(rise - linear).max() > 1.5e-3  # so that it is seen


def test_a_quadratic_reduction_predicts_k_of_T():
    """It knows what the linear reduction leaves to the second pass, where the corrector cannot be revised."""
    system, drive = coarse_warm_fem(), {"power": 0.1, "duration": 40e-9, "max_discrepancy": 5e-4}
    model = surrogate.reduce_quadratic(system, 0.01).model
    poles = coupled.FEM(system).predictor.linear
    plain = [SimpleNamespace(advance=fem.advance, accept=fem.accept) for fem in (coupled.FEM(system) for _ in "ab")]
    run, linear = (
        coupled.cosimulate(RING, one, predictor=p, **drive) for one, p in zip(plain, (model, poles), strict=True)
    )
    assert run.attrs["passes"] == run.attrs["windows"]
    assert linear.attrs["passes"] > linear.attrs["windows"]
    assert np.interp(linear.time, run.time, run.delta_T) == pytest.approx(linear.delta_T.values, rel=0, abs=1e-3)


def test_pulses_with_k_of_T_are_as_accurate_as_the_discrepancy():
    """The first pass leaves 0.3 mK, which shifts the second pulse by 60 ps: 4.8 mK on its edge, if nothing follows."""
    silicon, oxide = th.materials.find("Si"), th.materials.find("SiO2")
    laws = {"conductivity_law": th.materials.PowerLaw(0.33), "specific_heat_law": th.materials.PowerLaw(0.5)}
    materials = (replace(silicon, conductivity_law=th.materials.PowerLaw(-1.3)), replace(oxide, **laws))
    heat, drive = th.assemble(replace(th.strip_ring(), materials=materials)), {"power": MW, "duration": 1.5e-6}
    run = coupled.cosimulate(RING, heat, **drive)
    plain = SimpleNamespace(advance=(fem := coupled.FEM(heat, max_discrepancy=3e-5)).advance, accept=fem.accept)
    exact = coupled.cosimulate(RING, plain, predictor=fem.predictor, max_discrepancy=3e-5, rtol=1e-8, **drive)
    assert exact.attrs["passes"] > exact.attrs["windows"]  # the second pass is the full FEM's own
    assert run.attrs["passes"] == run.attrs["windows"]
    assert CubicSpline(exact.time, exact.delta_T)(run.time) == pytest.approx(run.delta_T.values, rel=0, abs=1e-3)
    assert abs(run.attrs["heat_imbalance"]) < 1e-6


def test_what_fast_modes_leave_in_a_slope_is_not_read():
    """8 steps; a cubic with the slope at the beginning of each is 1.6 mK off, and takes 23."""
    heat, reduction = strip()
    drive = {"power": MW, "duration": 1.5e-6, "rtol": 1e-8}
    run = coupled.cosimulate(RING, heat, **drive)
    exact = coupled.simulate(RING, reduction, times=run.time.values, **drive)
    assert run.delta_T.values == pytest.approx(exact.delta_T.values, rel=0, abs=3e-4)
    assert run.attrs["fem_steps"] < 15


def test_tables_in_the_loop():
    """c_p of SiO2(T) has a kink at 300 K, which pulses cross; parabolas alone take 34 steps and a pass more."""
    run = coupled.cosimulate(RING, warm_fem(), power=MW, duration=1.5e-6)
    assert run.delta_T.max() > 300 - 293.15
    assert run.attrs["passes"] == run.attrs["windows"]
    assert run.attrs["fem_steps"] < 25
    assert abs(run.attrs["heat_imbalance"]) < 3e-7


def test_the_estimate_is_what_another_pass_changes():
    """One window with a pulse, and a corrector that cannot be revised: the run at 10 mK against one at 0.01 mK."""
    runs = []
    for allowed in (1e-2, 1e-5):
        fem = coupled.FEM(strip()[0], max_discrepancy=1e-5)
        plain = SimpleNamespace(advance=fem.advance, accept=fem.accept)
        drive = {"power": 20e-3, "duration": 0.15e-6, "max_discrepancy": allowed, "rtol": 1e-8}
        runs.append(coupled.cosimulate(RING, plain, predictor=NETWORK, **drive))
    apart = np.abs(CubicSpline(runs[1].time, runs[1].delta_T)(runs[0].time) - runs[0].delta_T.values).max()
    assert runs[0].attrs["windows"] == 1
    assert 0.5 < runs[0].attrs["estimated_change"] / apart < 2


def test_a_heater_beside_the_light():
    """Weak light reads the temperature that the heater makes: compare with the heater alone."""
    heat = th.assemble(th.heated_ring())
    heater = next(name for name in heat.heated if name != "core")
    wave, times = th.Pulse(20e-3, width=0.4e-6, start=0.1e-6), np.linspace(0, 1e-6, 51)
    alone = integrate(heat.channels(heater, "core"), wave, times, rtol=1e-6).outputs[:, 0]
    run = coupled.cosimulate(RING, heat, power=1e-9, duration=1e-6, heaters={heater: wave}, field_times=[0.5e-6])
    assert np.interp(times, run.time, run.delta_T) == pytest.approx(alone, rel=0, abs=2e-3)
    assert alone.max() > 1
    assert run.attrs["passes"] == run.attrs["windows"]  # the reduction knows the heater
    assert float(run.field.max()) > 2 * alone.max()  # the heater is hotter than the ring


def test_a_predictor_may_know_the_heater():
    heat = th.assemble(th.heated_ring())
    several = surrogate.reduce(heat.channels(("core", "heater"), "core"), tolerance=1e-4).model
    drive = {"power": 1e-9, "duration": 0.3e-6, "heaters": {"heater": th.Constant(20e-3)}}
    run = coupled.cosimulate(RING, heat, predictor=several, **drive)
    assert run.attrs["passes"] == run.attrs["windows"]
    alone = heat.channels("heater", "core").response(th.Constant(20e-3), [0.3e-6])
    assert run.delta_T.values[-1] == pytest.approx(alone[0], rel=0, abs=1e-3)


def test_a_laser_that_sweeps():
    heat, reduction = strip()
    drive = {
        "power": 1e-3,
        "detuning": coupled.Sweep([0, 1e-6, 2e-6], [20e9, -30e9, 20e9]),
        "duration": 2e-6,
        "rtol": 1e-7,
    }
    run, reference = coupled.cosimulate(RING, heat, **drive), coupled.simulate(RING, reduction, **drive)
    assert traces_apart(run, reference) < 1e-3
    assert "detuning" in run


def test_fields_are_those_of_the_temperature_that_is_read():
    heat, _ = strip()
    times = [0.0, 0.13e-6, 0.5e-6]
    run = coupled.cosimulate(RING, heat, power=MW, duration=0.5e-6, field_times=times)
    r, z = run.r.values, run.z.values
    inside = (abs(r - 7.955e-6) < 0.2e-6) & (z > 0.02e-6) & (z < 0.2e-6)
    for time, field in zip(times, run.field.values, strict=True):
        rise = np.interp(time, run.time, run.delta_T)
        assert field[inside].mean() == pytest.approx(rise, rel=0.03, abs=1e-12)  # silicon is nearly even
    assert run.field.values[2].max() < 1.2 * run.delta_T.values.max()


def test_the_result_says_what_it_took():
    """Passes, solves and the CPU time of both sides; how fast that is stands in benchmarks/."""
    heat, drive = th.assemble(th.strip_ring(), 1e-4), {"power": MW, "max_discrepancy": 1e-3}
    coupled.cosimulate(RING, heat, duration=10e-9, **drive)  # compiles, and orders the matrix
    begin = process_time()
    run = coupled.cosimulate(RING, heat, duration=3e-6, **drive)
    spent = process_time() - begin
    said = run.attrs
    assert said["fem_unknowns"] == heat.unknowns > 6000
    assert said["passes"] == run.passes.sum()
    assert said["windows"] == run.sizes["window"] == run.discrepancy.size
    assert said["largest_discrepancy"] == run.discrepancy.max() <= 1e-3
    assert said["fem_solves"] >= 5 * said["fem_steps"] > 0  # a solve for every stage
    assert 0 < said["cpu_optics"] < said["cpu_corrector"]
    assert said["cpu_optics"] + said["cpu_corrector"] < spent


def test_progress_reaches_the_end():
    seen = []
    coupled.cosimulate(RING, coarse_fem(), power=1e-6, duration=1e-6, progress=seen.append)
    assert seen[-1] == pytest.approx(1e-6, rel=1e-12, abs=0)
    assert np.all(np.diff(seen) > 0)


@cache
def coarse_strip():
    heat = th.assemble(th.strip_ring(), accuracy=1e-2)
    return heat, surrogate.reduce(heat.system, tolerance=1e-6)


def periods(run):
    t, N = run["time"].values, run["carriers"].values
    return np.diff(crossings(t, N, (N.min() + N.max()) / 2))


def test_the_fem_is_settled_from_the_first_period():
    """The settled period, 684.9 ns, after one period; the certificate is 1e-6, left are 1e-4 K of 6 K of tolerance."""
    heat, reduction = coarse_strip()
    cycle = coupled.limit_cycle(RING, reduction, power=MW)
    run = coupled.cosimulate(
        RING, heat, power=MW, duration=2.3 * cycle.attrs["period"], initial=cycle, max_discrepancy=1e-4, rtol=1e-8
    )
    found = periods(run)
    assert found == pytest.approx(np.full(found.size, cycle.attrs["period"]), rel=2e-5)
    assert found.size >= 1
    assert cycle.attrs["period"] == pytest.approx(684.9e-9, rel=5e-3)  # the mesh of accuracy 1e-2
    assert abs(run.attrs["heat_imbalance"]) < 1e-7
    cold = coupled.cosimulate(RING, heat, power=MW, duration=3e-6)
    assert abs(periods(cold)[-1] / cycle.attrs["period"] - 1) > 1e-2  # so that beginning there is seen


@pytest.mark.parametrize("system", [coarse_fem, coarse_warm_fem])
def test_a_run_goes_on_where_another_ended(system):
    """Two halves and the whole differ by less than their tolerances, with constant and with varying conductivity."""
    heat, drive = system(), {"power": 20e-3, "max_discrepancy": 1e-4, "rtol": 1e-8}
    whole = coupled.cosimulate(RING, heat, duration=60e-9, **drive)
    first = coupled.cosimulate(RING, heat, duration=30e-9, **drive)
    second = coupled.cosimulate(RING, heat, duration=30e-9, initial=first, **drive)
    rise = np.interp(second["time"].values + 30e-9, whole["time"].values, whole["delta_T"].values)
    assert second["delta_T"].values[0] == pytest.approx(first["delta_T"].values[-1], rel=0, abs=1e-12)
    assert second["delta_T"].values == pytest.approx(rise, rel=0, abs=1e-3)
    assert second["delta_T"].values[-1] > 0.5
    assert second.attrs["final_light"] == pytest.approx(whole.attrs["final_light"], rel=1e-3, abs=0)


def test_a_beginning_in_other_units_is_the_same():
    """mK are no K, 6209 K for 6.2 K; a cycle without some rows would begin 15 K too hot."""
    heat, network = coarse_fem(), surrogate.reduce(coarse_fem(), tolerance=1e-4)
    run = coupled.cosimulate(RING, heat, power=20e-3, duration=5e-9)
    cycle = coupled.limit_cycle(RING, NETWORK, power=MW)
    scaled = run.assign(final_rise=(run["final_rise"].dims, 1e3 * run["final_rise"].values, {"units": "mK"}))
    milli = cycle.assign(absorbed=("time", 1e3 * cycle["absorbed"].values, {"units": "mW"}))
    drive = {"power": MW, "duration": 1e-9, "predictor": network}
    for one, other in ((run, scaled), (cycle, milli)):
        a, b = (coupled.cosimulate(RING, heat, initial=given, **drive) for given in (one, other))
        assert float(b["delta_T"][0]) == pytest.approx(float(a["delta_T"][0]), rel=1e-9)
    for bad, words in (
        (cycle.isel(time=slice(0, -5)), "a whole cycle has"),
        (run.assign_attrs(final_light="x"), "final_light"),
        (cycle.drop_vars("absorbed"), "has no 'absorbed'"),
    ):
        with pytest.raises(th.InputError, match=words):
            coupled.cosimulate(RING, heat, initial=bad, **drive)


def test_what_cannot_be_a_beginning():
    drive = {"power": 1e-3, "duration": 5e-9}
    run = coupled.cosimulate(RING, coarse_fem(), **drive)
    for heat, initial, words in (
        (coarse_fem(), coupled.simulate(RING, NETWORK, **drive), "has no 'final_rise'; a run of coupled.cosimulate"),
        (coarse_strip()[0], run, "on another mesh"),
        (Exact(NETWORK), run, "keeps its own state"),
    ):
        with pytest.raises(th.InputError, match=words):
            coupled.cosimulate(RING, heat, initial=initial, **drive)


def test_finite_elements_that_made_a_run_begin_another_with_its_end_alone():
    """Times of the second run go on from the field's own, 5 ns."""
    fem = coupled.FEM(coarse_strip()[0])
    run = coupled.cosimulate(RING, fem, power=MW, duration=5e-9)
    with pytest.raises(th.InputError, match=r"heat is a coupled\.FEM that made a run before"):
        coupled.cosimulate(RING, fem, power=MW, duration=5e-9)
    on = coupled.cosimulate(RING, fem, power=MW, duration=5e-9, initial=run)
    assert float(on.delta_T[0]) == pytest.approx(float(run.delta_T[-1]), rel=1e-9)
