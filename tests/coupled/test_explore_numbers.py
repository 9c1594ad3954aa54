"""The page's own integrator, fixed points, Hopf points and cycles against Python's, on random rings and models."""

from __future__ import annotations

from importlib import metadata

import numpy as np
import pytest
from page_cases import argument, ring_and_model
from scipy.optimize import linear_sum_assignment

import coupled
import thermofem as th
from coupled.explore import bundle

CASES = 60  # every ring with every lifetime and Kerr effect of `ring_and_model`
SAME = 1e-6  # the aim of the comparison; what is measured stands at each test


READY = """
const p = globalThis.ringPage;
const system = p.systemOf(r.ring, r.model);
const drive = p.driveOf(system, r.power);
const turn = p.turnOf(r.detuning);
"""


def test_traces(js):
    """The same method and step control: what differs is round-off, which grows while the ring pulses."""
    worst = 0.0
    for seed in range(CASES):
        ring, model, power, detuning = ring_and_model(seed)
        times = np.linspace(0, 1e-6, 51)
        run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=1e-6, rtol=1e-7, method="rodas4", times=times)  # fmt: skip  # noqa: E501
        rows = js(
            f"""r => {{ {READY}
            const run = p.integrate(system, drive, turn, p.cold(system), r.times.at(-1),
                {{ method: "rodas4", rtol: 1e-7, times: r.times }});
            return Array.from(run.rows.slice(0, 5 * run.count)); }}""",
            argument(ring, model, power, detuning, times=(times * 1e9).tolist()),
        )
        rows = np.reshape(rows, (-1, 5))
        energy = (rows[:, 1] ** 2 + rows[:, 2] ** 2) * 1e-15
        for mine, theirs in ((run.energy, energy), (run.carriers, rows[:, 3] * 1e23), (run.delta_T, rows[:, 4])):
            worst = max(worst, float(np.max(np.abs(theirs - mine.values)) / np.max(np.abs(mine.values))))
    assert worst < SAME


def test_thermal_noise(js):
    """The fluctuation that the page prints, against the variance from the matrices of the same poles."""
    poles = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
    variance = th.thermal_noise(poles, [1e6], temperature=300.0).attrs["variance"]
    numbers = {"R": poles.R.tolist(), "tau": poles.tau.tolist()}
    rms = js("m => globalThis.ringPage.fluctuation(m, 300)", numbers)
    assert rms == pytest.approx(variance**0.5, rel=1e-12, abs=0)


def test_fixed_points(js):
    """Number, place, temperature and stability; one that is marginal to round-off may differ in its regime only."""
    for seed in range(CASES):
        ring, model, power, detuning = ring_and_model(seed)
        mine = coupled.steady_states(ring, model, power=power, detuning=detuning)
        found = js(f"r => {{ {READY} return p.steadyStates(drive, turn, system); }}", argument(ring, model, power, detuning))  # fmt: skip  # noqa: E501
        assert len(found) == mine.sizes["branch"]
        assert np.allclose([f["U"] * 1e-15 for f in found], mine.energy, rtol=1e-9, atol=0)
        assert np.allclose([f["dT"] for f in found], mine.delta_T, rtol=1e-9)
        rates = np.maximum(np.abs(mine.growth_rate.values), 1e-6 * ring.linear_rate)
        assert np.all(np.abs([f["growth"] * 1e9 for f in found] - mine.growth_rate.values) < SAME * rates)
        assert [f["regime"] for f in found] == mine.regime.values.tolist()


@pytest.mark.parametrize("n", [1, 2, 3, 8, 17])
def test_eigenvalues(js, n):
    """Those of LAPACK within round-off of the norm; cyclic matrices need another shift, squares of 1e-160 underflow."""
    dense = np.random.default_rng(n).normal(size=(n, n))
    graded = np.diag(10.0 ** -np.linspace(0, 200, n)) + 1e-160 * dense
    for matrix in (dense, dense - dense.T, np.roll(np.eye(n), 1, axis=0), graded):
        found = js(
            "r => { const { re, im } = globalThis.ringPage.eigenvalues(r.matrix, r.n); return [[...re], [...im]]; }",
            {"matrix": matrix.ravel().tolist(), "n": n},
        )
        gaps = np.abs(found[0] + 1j * np.array(found[1]) - np.linalg.eigvals(matrix)[:, None])
        assert gaps[linear_sum_assignment(gaps)].max() <= 1e-14 * np.linalg.norm(matrix)


def test_hopf_and_fold_curves_lie_on_the_borders(js):
    """The curves that are drawn: an eigenvalue pair on the imaginary axis, and two fixed points that meet."""
    ring = coupled.borghi2021()
    model = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
    window = {"powers": [1e-3, 1e-2], "detunings": [-40e9, 30e9]}
    hopf, folds = js(
        f"""r => {{ {READY} const nu = r.detunings.map(p.turnOf);
        return [p.hopfCurves(system, r.powers, nu).flat(), p.foldCurves(system, r.powers, nu).flat()]; }}""",
        argument(ring, model, 1e-3, 0.0, **window),
    )
    assert len(hopf) > 20
    assert len(folds) > 20
    inside = [h for h in hopf if 1e-3 < h["power"] < 1e-2 and h["leading"]]
    for point in inside[:: max(len(inside) // 8, 1)]:
        nu = point["detuning"] / (2 * np.pi) * 1e9
        states = coupled.steady_states(ring, model, power=point["power"], detuning=nu)
        nearest = int(np.argmin(np.abs(states.energy.values - point["U"] * 1e-15)))
        assert abs(float(states.growth_rate[nearest])) < 1e-5 * point["w"] * 1e9
    for point in [p for p in folds if 1e-3 < p["power"] < 1e-2][5::30]:
        nu = point["detuning"] / (2 * np.pi) * 1e9
        counts = {coupled.steady_states(ring, model, power=point["power"] * f, detuning=nu).sizes["branch"] for f in (0.999, 1.001)}  # fmt: skip  # noqa: E501
        assert counts == {1, 3}


def settled(js, ring, model, power, detuning):
    """The settled cycle that the page shows, or None."""
    return js(
        f"""r => {{ {READY}
        const c = p.engineOf().trace({{ ...r, duration: 20e-6, rtol: 1e-6, settled: true }}).cycle;
        if (!c) return null;
        return {{ period: c.period, duty: c.duty, swing: c.swing,
            multipliers: Array.from(c.multipliers.re, (re, k) => [re, c.multipliers.im[k]]) }}; }}""",
        argument(ring, model, power, detuning),
    )


def test_settled_cycle_of_slow_heat(js):
    """654.4757927 ns, from a 300 us trace at rtol 1e-8; multipliers from the variational equations elsewhere."""
    model = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
    cycle = settled(js, coupled.borghi2021(), model, 10**0.8 * 1e-3, 0.0)
    assert cycle["period"] == pytest.approx(654.4757930, rel=1e-8)
    sizes = sorted((re for re, _ in cycle["multipliers"]), reverse=True)
    assert sizes[:4] == pytest.approx([1, 0.93309, 0.58708, 0.02523], abs=1e-5)


def pulsing_case(seed):
    """A random ring and model where no fixed point is stable, so that it must move; None without such a place."""
    ring, model, power, _ = ring_and_model(seed)
    width = ring.linear_rate / np.pi
    powers, detunings = np.geomspace(power / 2, 16 * power, 10), np.linspace(-2 * width, width, 16)
    cells = np.argwhere(coupled.stability_map(ring, model, powers, detunings).stable_points.values == 0)
    if len(cells) == 0:
        return None
    i, j = cells[np.random.default_rng(seed).integers(len(cells))]
    return ring, model, float(powers[i]), float(detunings[j])


def reference_cycle(case):
    """The cycle by collocation; None where its trivial multiplier shows that it does not resolve the pulse."""
    ring, model, power, detuning = case
    try:
        cycle = coupled.limit_cycle(ring, model, power=power, detuning=detuning)
    except th.InputError:
        return None
    return cycle if np.abs(cycle["multipliers"].values - 1).min() < 1e-5 else None


@pytest.mark.parametrize("count", [6, pytest.param(40, marks=pytest.mark.slow)])
def test_settled_cycles(js, count):
    """Shooting in the page against collocation in Python, for random rings without a stable fixed point.

    Some of them do not settle within 20 us, or never: their pulses do not repeat. Then the page says so. Where pulses
    are shorter than some 1/400 of the period collocation may fail, and the last cycle of a long trace is compared.
    Measured on a hundred: periods within 1e-7, swings 5e-6 and duties 5e-5, which the page reads off its steps.
    """
    compared = without = traced = seed = 0
    while compared < count:
        seed += 1
        case = pulsing_case(seed)
        if case is None:
            continue
        page = settled(js, *case)
        if page is None:
            without += 1
            continue
        compared += 1
        cycle = reference_cycle(case)
        if cycle is None:
            ring, model, power, detuning = case
            run = coupled.simulate(ring, model, power=power, detuning=detuning, duration=200e-6, rtol=1e-8)
            assert page["period"] * 1e-9 == pytest.approx(coupled.pulsing(run).period, rel=SAME, abs=0), seed
            traced += 1
            continue
        assert page["period"] * 1e-9 == pytest.approx(cycle.attrs["period"], rel=SAME, abs=0), seed
        assert page["swing"] == pytest.approx(cycle.attrs["swing"], rel=2e-5), seed
        assert page["duty"] == pytest.approx(cycle.attrs["duty"], abs=1e-4), seed
        mine = np.sort(np.abs(cycle["multipliers"].values))[::-1][:4]
        theirs = np.sort([np.hypot(*pair) for pair in page["multipliers"]])[::-1][:4]
        assert theirs == pytest.approx(mine, abs=2e-3), seed
    assert without <= 2 + count // 5
    assert traced <= 1 + count // 20


def under_a_heater(seed):
    """A random ring, whose network gets a second input: residues of either sign, and a power that moves a width."""
    ring, model, power, detuning = ring_and_model(seed)
    network = model.linear if isinstance(model, th.OutputMap) else model
    tau, draw = np.asarray(network.tau), np.random.default_rng(seed)
    through = draw.uniform(-0.2, 1, tau.size) * 2e3
    through[0] += 1e3 - min(through.sum(), 0)
    B = np.column_stack([network.R, through])
    names = {"inputs": ("core", "heater"), "outputs": ("core",)}
    heated = th.StateSpace(np.diag(tau), -np.eye(tau.size), B, np.ones((1, tau.size)), **names)
    width = 2 * ring.linear_rate / (ring.thermal_shift * through.sum())
    return ring, heated, power, detuning, float(draw.uniform(0.2, 0.8) * width)


ENGINE = """
const request = { ring: r.ring, model: globalThis.ringPage.heatedBy(r.model, { heater: r.heater }), power: r.power,
    detuning: r.detuning, ...r.more };
const engine = globalThis.ringPage.engineOf();
"""


def test_heaters(js):
    """Traces, fixed points and regimes under a heater of constant power that is switched on with the laser.

    Both integrate at 1e-9 with different methods and step sizes; pulses magnify what that leaves, to 1e-9 here.
    """
    worst = 0.0
    for seed in (0, 25, 50, 75):
        ring, model, power, detuning, heater = under_a_heater(seed)
        about = argument(ring, model, power, detuning, heater=heater)
        light = {"power": power, "detuning": detuning, "heaters": {"heater": heater}}
        more = {"duration": 0.5e-6, "rtol": 1e-9, "settled": False}
        rows = js(f"r => {{ {ENGINE} return Array.from(engine.trace(request).rows); }}", about | {"more": more})
        rows = np.reshape(rows, (-1, 5))[::50]
        times = np.minimum(rows[:, 0] * 1e-9, 0.5e-6)
        run = coupled.simulate(ring, model, duration=0.5e-6, times=times, rtol=1e-9, **light)
        energy = (rows[:, 1] ** 2 + rows[:, 2] ** 2) * 1e-15
        first = run["delta_T"].values[0]
        assert first == pytest.approx(0, abs=1e-9)  # the heater was off before
        for mine, theirs in ((run.energy, energy), (run.carriers, rows[:, 3] * 1e23), (run.delta_T, rows[:, 4])):
            worst = max(worst, float(np.max(np.abs(theirs - mine.values)) / np.max(np.abs(mine.values))))
        width = ring.linear_rate / np.pi
        span = {"detunings": [detuning - width, detuning + width]}
        found = js(f"r => {{ {ENGINE} return engine.light(request); }}", about | {"more": span})
        states = coupled.steady_states(ring, model, **light)
        for name in ("energy", "carriers", "delta_T", "drop", "through"):
            assert np.allclose([p[name] for p in found["states"]], states[name], rtol=1e-8, atol=0)
        assert [p["regime"] for p in found["states"]] == states.regime.values.tolist()
        point = found["points"][len(found["points"]) // 2]
        there = coupled.steady_states(ring, model, **light | {"detuning": point["detuning"]})
        nearest = int(np.argmin(np.abs(there.energy.values / point["energy"] - 1)))
        for name in ("energy", "through"):
            assert float(there[name][nearest]) == pytest.approx(point[name], rel=1e-6, abs=0)
        plane = {"powers": [power / 2, 4 * power], **span, "sizes": [[3, 4]]}
        (part,) = js(f"r => {{ {ENGINE} return [...engine.plane(request)].filter(p => p && p.kind === 'map').map(p => [...p.stable]); }}", about | {"more": plane})  # fmt: skip  # noqa: E501
        powers = power / 2 * 8 ** ((np.arange(3) + 0.5) / 3)
        detunings = detuning - width + (np.arange(4) + 0.5) / 4 * 2 * width
        mine = coupled.stability_map(ring, model, powers, detunings, heaters=light["heaters"])
        assert part == mine.stable_points.values.ravel().tolist()
    assert worst < SAME


def test_a_cycle_is_followed_from_setting_to_setting(js):
    """As while a slider moves: the cycle of a run from cold within 1e-5 (5.6e-7 found), until the pulses end.

    At -10 dBm slow heat still moves the ring after 20 us.
    """
    ring = coupled.borghi2021()
    model = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
    powers = 1e-3 * 10 ** (np.array([8, 8.05, 8.3, 8.25, -10]) / 10)
    found = js(
        """r => { const p = globalThis.ringPage, moving = p.engineOf();
        return r.powers.map(power => {
            const at = { ring: r.ring, model: r.model, power, detuning: 0, duration: 20e-6, settled: true };
            const quick = moving.trace({ ...at, rtol: 1e-5, quick: true, follow: true });
            const full = p.engineOf().trace({ ...at, rtol: 1e-6, quick: false });
            const of = ({ followed, pulsing, cycle }) => [!!followed, pulsing.regime, cycle ? cycle.period : 0];
            return [of(quick), of(full)]; }); }""",
        argument(ring, model, 0.0, 0.0, powers=powers.tolist()),
    )
    assert [quick[0] for quick, _ in found] == [False, True, True, True, False]
    assert [quick[1] for quick, _ in found] == [*4 * ["self-pulsing"], "slow transient"]
    for quick, full in found:
        assert quick[1:] == [full[1], pytest.approx(full[2], rel=1e-5)]


ZIG = "0.17.1"  # that compiled the committed file; others order its functions differently


@pytest.mark.slow
def test_the_committed_module_is_that_of_the_sources(tmp_path):
    versions = [each.version for each in metadata.distributions(name="ziglang")]
    if versions != [ZIG]:
        pytest.skip(f"needs ziglang {ZIG}")
    bundle.compile_kernel(tmp_path / "kernel.wasm")
    assert (tmp_path / "kernel.wasm").read_bytes() == (bundle.HERE / "page/kernel.wasm").read_bytes()
