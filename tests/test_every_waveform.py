"""Every waveform drives every thermal model: a product, not examples.

The reference takes nothing from the code under test: the convolution of the power with the impulse response of each
pole by Gauss quadrature on cells of 20 ns, and for a quadratic model SciPy's LSODA with steps of 20 ns at most.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from models import MODELS
from scipy.integrate import solve_ivp

import coupled
import surrogate
import thermofem as th
from thermofem.models import NonlinearSystem, foster
from thermofem.waveforms import KINDS

P = 1e-3
GAUSS = th.Function(lambda t: P * np.exp(-(((t - 4e-6) / 50e-9) ** 2)))
WAVES = {
    "Constant": th.Constant(P),
    "Pulse": th.Pulse(P, width=1.5e-6, start=0.4e-6),
    "SquareWave": th.SquareWave(P, period=0.7e-6, duty=1 / 3),
    "Sampled": th.Sampled([0, 1e-6, 1e-6, 9e-6], [0, P, P / 2, 0]),
    "Symbols": th.Symbols([0.2, 1, 0, 0.7], rate=1e6, power=P, bias=1e-4, mask=(0.5, 1), noise=0.05, seed=1),
    "Telegraph": th.Telegraph(P, 0.5e-6, 5e-6, seed=3),
    "Chirp": th.Chirp(P, 0.3e-6, 2e-6, 7e-6),
    "PiecewiseCubic": th.waveforms.PiecewiseCubic([0, 2e-6, 9e-6], [[0, 300.0, 1e8, -5e13], [0.9e-3, -100.0, 0, 0]]),
    "Function, arrays": th.Function(lambda t: P * (0.5 + 0.4 * np.sin(2 * np.pi * 0.8e6 * t))),
    "Function, one time": th.Function(lambda t: P * math.exp(-t / 1e-6) if t < 3e-6 else P / 2, breakpoints=(3e-6,)),
    "Function, narrow": GAUSS,
    "Function, periodic": th.Function(lambda t: P * (t / 1e-6) ** 2, period=1e-6),
}
TIMES = np.array([0.0, 0.3e-6, 1e-6, 2.2e-6, 3.95e-6, 4e-6, 4.05e-6, 5.7e-6, 8e-6])


def test_no_waveform_is_missing():
    ours = {name for name, kind in KINDS.items() if kind.__module__ == "thermofem.waveforms"}
    assert ours <= {name.split(",")[0] for name in WAVES}


@pytest.fixture(params=MODELS, scope="module")
def model(request):
    return MODELS[request.param]()


CELL = 20e-9  # s: less than half of the narrowest feature; 16 Gauss points integrate it times exp(-u/3 ns) to 1e-9
BEFORE = np.geomspace(1e-13, CELL, 30)  # finer cells just before a wanted time, for the fast poles of a FEM
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
FOUND: dict[tuple[object, ...], np.ndarray] = {}  # references: several models of the list share their equations


def once(reference):
    """A reference that is computed once for the same arrays of a model and the same waveform and times."""

    def kept(equations, wave, times, **options):
        given = options.values()
        arrays = [v for v in (*vars(equations).values(), times, *given) if isinstance(v, np.ndarray)]
        key = (reference, id(wave), *(a.tobytes() for a in arrays), *(v for v in given if isinstance(v, bool)))
        if key not in FOUND:
            FOUND[key] = reference(equations, wave, times, **options)
        return FOUND[key]

    return kept


@once
def convolved(
    poles: th.Foster, wave: th.waveforms.Waveform, times: np.ndarray, *, periodic: bool = False
) -> np.ndarray:
    """sum_i R_i/tau_i integral of exp(-(t - u)/tau_i) P(u) du, cell by cell; ``times`` from 0, of one period or all.

    Poles that carry less than 1e-10 of the thermal resistance each are left out: 900 of a FEM make 1e-7 at most.
    """
    seen = np.abs(poles.R) > 1e-10 * poles.thermal_resistance
    R, tau = poles.R[seen], poles.tau[seen]
    stop = float(times[-1])
    finer = (times[1:, None] - BEFORE).ravel()
    cells = np.concatenate([np.arange(0, stop, CELL), finer[finer > 0], times, wave.breakpoints(0.0, stop)])
    edges = np.unique(cells)
    x, states = np.zeros(R.size), {0.0: np.zeros(R.size)}
    for a, b in itertools.pairwise(edges.tolist()):
        u = a + (b - a) * (NODES + 1) / 2
        energy = wave(u) * (b - a) * WEIGHTS / 2
        x = x * np.exp((a - b) / tau) + energy @ np.exp((u[:, None] - b) / tau) / tau
        states[b] = x
    found = np.array([states[t] for t in times.tolist()])
    if periodic:
        found += np.exp(-times[:, None] / tau) * (x / -np.expm1(-stop / tau))
    return found @ R


@once
def integrated(model: th.Quadratic, wave: th.waveforms.Waveform, times: np.ndarray, *, initial=None) -> np.ndarray:
    """Steps that end on every breakpoint; what they leave is below 1e-6."""
    x = np.zeros(model.order) if initial is None else initial
    rise = [float(model.C @ x)]
    marks = np.unique(np.concatenate([times, wave.breakpoints(0.0, float(times[-1]))]))
    for a, b in itertools.pairwise(marks):
        end = b - 1e-9 * (b - a)  # the power to the left of an edge

        def rate(t, y, end=end):
            return model.rate(y, float(wave(min(t, end))))

        def slope(t, y, end=end):
            return model.jacobian(y, float(wave(min(t, end))))

        x = solve_ivp(rate, (a, b), x, method="LSODA", jac=slope, rtol=1e-8, atol=1e-12, max_step=CELL).y[:, -1]
        if b in times:
            rise.append(float(model.C @ x))
    return np.array(rise)


@pytest.fixture(scope="module")
def poles(model) -> th.Foster | None:
    """The linear model's poles, or those at small power; none for a quadratic one, which has its own reference."""
    small = canonical(model)
    linear = small.linear if isinstance(small, NonlinearSystem | th.OutputMap) else small
    return foster(linear) if isinstance(linear, th.StateSpace) else None if isinstance(linear, th.Quadratic) else linear


def canonical(model):
    """The FEM itself, or the form in which any other model drives the optics."""
    return model if isinstance(model, NonlinearSystem | th.StateSpace) else model.dynamics


@pytest.mark.parametrize("name", WAVES)
def test_response_of_every_model_to_every_waveform(model, poles, name):
    """2e-5 of the largest rise: models that step promise 1e-5; a k(T) FEM is asked for 1e-3, which takes a tenth."""
    wave = WAVES[name]
    if isinstance(canonical(model), th.Quadratic):
        rise, expected, within = model.response(wave, TIMES), integrated(canonical(model), wave, TIMES), 2e-5
    elif isinstance(model, NonlinearSystem):  # so little power that k(T) is constant: the rise is below 1e-3 K
        rise = model.response(scaled(wave), TIMES, rtol=1e-3)
        expected, within = 1e-4 * convolved(poles, wave, TIMES), 1e-3
    else:
        rise, expected, within = model.response(wave, TIMES), convolved(poles, wave, TIMES), 2e-5
    if isinstance(canonical(model), th.OutputMap):
        expected = canonical(model).of(expected)
    assert rise == pytest.approx(expected, abs=within * np.max(np.abs(expected)), rel=0)


def scaled(wave: th.waveforms.Waveform) -> th.waveforms.Waveform:
    """1e-4 of a waveform: samples where it is straight, else a function of time."""
    edges = wave.breakpoints(0.0, float(TIMES[-1]))
    if not wave.piecewise_linear:
        return th.Function(lambda t: 1e-4 * wave(t), breakpoints=edges)
    lines = wave.pieces(0.0, float(TIMES[-1]))
    values = np.stack([lines.coefficients[:, 0], lines.ends], axis=1).ravel()
    return th.Sampled(np.repeat(lines.edges, 2)[1:-1], 1e-4 * values)


@pytest.mark.parametrize("name", [name for name, wave in WAVES.items() if wave.period])
def test_periodic_state_of_every_model(model, poles, name):
    wave = WAVES[name]
    if isinstance(model, NonlinearSystem):
        pytest.skip("a minute; its steps are those of a transient, and test_transient has its period map")
    rise = model.periodic_response(wave, 41)
    times = th.waveforms.period_times(wave, 41)
    if isinstance(canonical(model), th.Quadratic):  # a fixed point of the integration over one period
        states = canonical(model).periodic_states(wave, 41)
        again = integrated(canonical(model), wave, times, initial=states[0])
        assert again == pytest.approx(rise, abs=3e-6 * rise.max(), rel=0)  # 1e-6 ends the passes
        return
    expected = convolved(poles, wave, times, periodic=True)
    if isinstance(canonical(model), th.OutputMap):
        expected = canonical(model).of(expected)
    assert rise == pytest.approx(expected, abs=3e-5 * np.max(expected), rel=0)


@pytest.mark.parametrize("name", WAVES)
def test_light_of_every_waveform(name):
    """The laser's power as it is, and as 4001 samples with straight lines between: they differ by (h/w)^2/4 = 2e-4."""
    model = th.Foster(R=[2000.0, 5800], tau=[56e-9, 1.2e-6])
    wave = WAVES[name]
    edges = np.unique(np.concatenate([np.linspace(0, 8e-6, 4001), wave.breakpoints(0.0, 8e-6)]))
    dense = th.Sampled(np.repeat(edges, 2)[1:-1], np.stack([wave(edges[:-1]), wave.before(edges[1:])], axis=1).ravel())
    ring, times = coupled.borghi2021(), TIMES
    run = coupled.simulate(ring, model, power=[1e-4, wave], duration=8e-6, times=times)
    other = coupled.simulate(ring, model, power=[1e-4, dense], duration=8e-6, times=times)
    assert run.delta_T.values == pytest.approx(other.delta_T.values, rel=0, abs=1e-3 * float(other.delta_T.max()))
    shifted = th.Function(lambda t: 5e9 * np.cos(1e6 * t))
    swept = coupled.Sweep(edges, 5e9 * np.cos(1e6 * edges))
    run = coupled.simulate(ring, model, power=2e-3, detuning=shifted, duration=8e-6, times=times)
    other = coupled.simulate(ring, model, power=2e-3, detuning=swept, duration=8e-6, times=times)
    assert run.delta_T.values == pytest.approx(other.delta_T.values, rel=0, abs=1e-5 * float(other.delta_T.max()))


@pytest.mark.parametrize("name", WAVES)
def test_a_heater_of_every_waveform_in_a_circuit(name):
    """Two dark rings, whose heat by the heater is the convolution; and a lit one against `simulate`."""
    rate, ring, wave = 1 / np.array([40e-9, 0.9e-6, 7e-6]), coupled.borghi2021(), WAVES[name]
    B = np.array([[1.0, 0.1, 0.3], [0.5, 0.6, 0.5], [0.3, 0.4, 0.4]]) * np.sqrt(3000 * rate)[:, None]
    names = ("ring 1", "ring 2", "heater")
    model = th.StateSpace(np.eye(3), -np.diag(rate), B, B[:, :2].T, inputs=names, outputs=names[:2])
    run = {"heaters": {"heater": wave}, "duration": 8e-6, "times": TIMES, "rtol": 1e-7}
    dark = coupled.simulate(coupled.bus([ring, ring]), model, power={}, **run)
    for k in range(2):
        expected = convolved(th.Foster(B[:, k] * B[:, 2] / rate, 1 / rate), wave, TIMES)
        # 0.01 rtol of the cubics of the rise, 1e-8 of those of the power, and 1e-9 of the reference
        assert dark.delta_T.values[k] == pytest.approx(expected, rel=0, abs=2e-8 * expected.max() + 1e-10)
    alone = th.StateSpace(np.eye(3), -np.diag(rate), B[:, [0, 2]], B[:, :1].T, names[::2], names[:1])
    lit = coupled.simulate(coupled.bus(ring), alone, power={"in": 1e-3}, detuning=-15e9, **run)
    one = coupled.simulate(ring, alone, power=1e-3, detuning=-15e9, heated="ring 1", **run)
    # 1e-7 a step, of some hundred steps that both take
    assert lit.delta_T.values[0] == pytest.approx(one.delta_T.values, rel=0, abs=1e-5 * float(one.delta_T.max()))


def test_a_heater_that_follows_a_function_in_the_cosimulation():
    """At no light worth mentioning the ring's temperature is the heater's alone: the FEM stepped by itself."""
    heat = th.assemble(th.heated_ring(), accuracy=1e-2)
    wave = th.Function(lambda t: 1e-3 * np.exp(-(((t - 0.5e-6) / 40e-9) ** 2)))
    run = coupled.cosimulate(coupled.borghi2021(), heat, power=1e-9, duration=1e-6, heaters={"heater": wave})
    alone = th.solve(heat, wave, [0.4e-6, 0.5e-6, 0.6e-6, 1e-6], heated="heater", read="core")
    seen = np.interp(alone.time, run.time, run.delta_T)
    # 1e-3 K of the co-simulation, and its rows are dense enough for straight lines to 2e-3 of the largest
    assert seen == pytest.approx(alone.delta_T.values, rel=0, abs=1e-3 + 5e-3 * float(alone.delta_T.max()))


@pytest.mark.parametrize("name", WAVES)
def test_a_dataset_of_every_waveform_trains_after_a_round_trip(tmp_path, name):
    wave, model = WAVES[name], th.Foster(R=[3000.0, 4000], tau=[100e-9, 2e-6])
    times = np.linspace(0, 8e-6, 161)
    data = th.dataset.build(times, model.response(wave, times), wave)
    th.save(data, tmp_path / "data.nc")
    fit = surrogate.fit_foster(th.load(tmp_path / "data.nc"), order=2)
    assert pytest.approx(model.R, rel=1e-5) == fit.model.R  # 1e-7 of the power's peak, times the conditioning
    assert fit.model.tau == pytest.approx(model.tau, rel=1e-5)
