"""What the page says a ring does, against `pulsing` and `limit_cycle`."""

from __future__ import annotations

import pytest
from browser import opened
from page_cases import argument, run_from_cold

import coupled
import thermofem as th

TRACE = """r => {
    const { pulsing, cycle } = globalThis.ringPage.engineOf().trace({ ...r, rtol: 1e-6 });
    return { ...pulsing, settled: cycle && { period: cycle.period, duty: cycle.duty, pattern: cycle.pattern } };
}"""
STILL_MOVES = "slow heat still moves the ring"
RING = coupled.borghi2021()
SLOW = th.Foster(R=[2000, 2000], tau=[1e-7, 15e-6])


@pytest.mark.parametrize("count", [40, pytest.param(200, marks=pytest.mark.slow)])
def test_a_run_gets_the_verdict_of_pulsing(js, count):
    """Regime, cycles and pattern of runs from cold, with the same steps; of warming rings also how long it takes."""
    seen = {"self-pulsing": 0, "stable": 0, "slow transient": 0, STILL_MOVES: 0}
    for seed in range(count):
        ring, model, power, detuning, duration = run_from_cold(seed)
        run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=duration, rtol=1e-6, method="rodas4")  # fmt: skip  # noqa: E501
        mine = coupled.pulsing(run)
        page = js(TRACE, argument(ring, model, power, detuning, duration=duration, settled=False))
        assert (page["regime"], page["cycles"]) == (mine.regime, mine.cycles), (seed, mine.reason)
        seen[mine.regime] += 1
        if mine.regime == "self-pulsing":
            assert page["pattern"] == mine.pattern, seed
        if STILL_MOVES in mine.reason:
            seen[STILL_MOVES] += 1
            now, end = page["heat"]["now"], page["heat"]["end"]
            assert f"{now:.3g} K of {end:.3g} K" in mine.reason, seed
            assert page["wanted"] * 1e-9 == pytest.approx(mine.suggested_duration, rel=0.06)  # it has two digits
    assert min(seen.values()) >= count // 40


UNSTABLE = [1294, 1437]  # an oscillation that dies away, and carriers that rest, where no fixed point is stable


@pytest.mark.parametrize("seed", UNSTABLE)
def test_rest_beside_an_unstable_fixed_point_is_a_slow_transient(js, seed):
    ring, model, power, detuning, duration = run_from_cold(seed)
    run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=duration, rtol=1e-6, method="rodas4")
    mine = coupled.pulsing(run)
    page = js(TRACE, argument(ring, model, power, detuning, duration=duration, settled=False))
    assert "but no fixed point is stable" in mine.reason
    assert page["regime"] == mine.regime == "slow transient"
    (rise,) = coupled.steady_states(ring, model, power=power, detuning=detuning)["delta_T"].values
    assert page["leaves"] == pytest.approx(rise, rel=1e-9)


@pytest.mark.parametrize("seed", [17, 38])
def test_the_duty_of_a_settled_cycle_of_short_pulses(js, seed):
    """Steps of the page pass the tops of these pulses: duties read off its samples err by 8e-4 and 1.8e-3."""
    ring, model, power, detuning, duration = run_from_cold(seed)
    page = js(TRACE, argument(ring, model, power, detuning, duration=duration, settled=True))
    cycle = coupled.limit_cycle(ring, model, power=power, detuning=detuning)
    assert page["settled"]["duty"] == pytest.approx(cycle.attrs["duty"], rel=2e-4)


def test_pulses_that_become_equal_are_one_period(js):
    """They alternate by 1 % after 17 us, and are equal when settled."""
    ring, model, power, detuning, duration = run_from_cold(1433)
    page = js(TRACE, argument(ring, model, power, detuning, duration=duration, settled=True))
    cycle = coupled.limit_cycle(ring, model, power=power, detuning=detuning)
    assert (page["pattern"], page["settled"]["pattern"]) == (2, 1)
    assert page["settled"]["period"] * 1e-9 == pytest.approx(cycle.attrs["period"], rel=1e-6, abs=0)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("slow") / "ring.html"
    coupled.explore(RING, {"slow": SLOW}, path)
    return path


@pytest.mark.slow
def test_slow_heat_that_still_moves_a_ring_is_told(browser, file):
    """After 20 us 0.0535 K of 0.0619 K; the carriers rest, the heat does not. A run of 82 us shows it at rest."""
    with opened(browser, file, "#power=-7&detuning=10&view=cold") as page:
        text = page.inner_text("#summary")
        (point,) = page.evaluate("ringPage.shown.states")
        assert "After 20 µs slow heat still moves the ring: ΔT = 0.0535 K, 0.00847 K from the fixed point" in text
        assert f"at ΔT = {point['delta_T']:.3g} K" in text
        assert "It rests there after some 82 µs" in text
    with opened(browser, file, "#power=-7&detuning=10&view=cold&duration=82") as page:
        assert f"The ring comes to rest at ΔT = {point['delta_T']:.4g}" in page.inner_text("#summary")
