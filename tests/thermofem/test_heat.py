"""The weak forms against exact solutions and published benchmarks, none of them of our making."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem
from grids import facets_where, graded, tensor_mesh
from models import linear_ledger

import thermofem as th
from thermofem.algebra.factor import factorize
from thermofem.materials import Material
from thermofem.transient import integrate

# Converged reference of the strip (independent high-order code, 7 digits): R_th in K/W, rise in K/W at times in s,
# peak-to-peak rise in K of the periodic state under 2 mW, duty 0.33.
STRIP_RESISTANCE = 7867.156077
STRIP_STEP = {
    1.0e-9: 95.25475359712683,
    3.257020655902e-9: 256.10066542191705,
    10.608183551394e-9: 615.7793043981231,
    34.55107294592e-9: 1281.4196202653092,
    112.53355826008e-9: 2273.2144103383865,
    366.52412370796e-9: 3489.0412882955046,
    1.1937766417144e-6: 4807.102068670903,
    3.888155180308e-6: 6176.297398081418,
    12.663801734674e-6: 7415.615024510806,
    100.0e-6: 7867.14205186074,
}
STRIP_SWING = {
    0.1e-6: 2.1834738,
    0.2e-6: 3.2160334,
    0.5e-6: 4.8984730,
    1e-6: 6.3354375,
    2e-6: 7.8521717,
    5e-6: 9.9150667,
    10e-6: 11.5372250,
}


@pytest.fixture(scope="module", params=[1e-3, 1e-4], ids=["1e-3", "1e-4"])
def strip(request):
    return th.assemble(th.strip_ring(), accuracy=request.param)


REFERENCE = "independent high-order code"


def test_strip_resistance_within_the_promised_accuracy(strip, validated):
    what = f"R_th of the reference strip, accuracy {strip.accuracy:g}"
    ours = strip.thermal_resistance("core")
    validated("Ring", what, ours, STRIP_RESISTANCE, rel=strip.accuracy, unit="K/W", source=REFERENCE)


def test_strip_step_within_the_promised_accuracy_from_1_ns_on(strip, validated):
    # pointwise; a tenth of the accuracy is left to the time integration
    times = list(STRIP_STEP)
    data = th.solve(strip, th.Constant(1e-3), times, rtol=strip.accuracy / 10)
    for time, rise in zip(times, data.delta_T.values * 1e3, strict=True):
        what = f"its step response at {time * 1e9:.3g} ns, accuracy {strip.accuracy:g}"
        validated("Ring", what, rise, STRIP_STEP[time], rel=strip.accuracy, unit="K/W", source=REFERENCE)


@pytest.mark.parametrize("period", STRIP_SWING)
def test_strip_swing_within_the_promised_accuracy(strip, period, validated):
    data = th.solve_periodic(strip, th.SquareWave(2e-3, period, 0.33), rtol=strip.accuracy / 5)
    what = f"its swing under 2 mW, duty .33, period {period * 1e6:g} us, accuracy {strip.accuracy:g}"
    swing = np.ptp(data.delta_T.values)
    validated("Ring", what, swing, STRIP_SWING[period], rel=strip.accuracy, unit="K", source=REFERENCE)


# Exact ring in layered media: a core with the oxide's own properties under an adiabatic surface, one oxide layer on a
# semi-infinite silicon substrate; Hankel-Laplace transform, trusted to 1e-6. Rise in K/W.
LAYERED = {
    "R = 7, w = 0.45 um": (
        7e-6,
        0.45e-6,
        9669.310,
        [125.621, 857.583, 1714.767, 3004.346, 4349.758, 5897.089, 7346.707, 8885.878],
    ),
    "R = 5, w = 0.50 um": (
        5e-6,
        0.50e-6,
        13395.873,
        [159.097, 1099.384, 2228.376, 3977.900, 5839.837, 8002.453, 10047.186, 12279.202],
    ),
}
LAYERED_TIMES = [1e-9, 10e-9, 30e-9, 100e-9, 300e-9, 1e-6, 3e-6, 10e-6]
# A domain that ends at 2 mm instead of nowhere moves R_th by 4.9e-5 (converged, R = 7 um); the step up to 10 us, whose
# heat has come 30 um far, by nothing.
TRUNCATION = 5e-5


@pytest.mark.parametrize("case", LAYERED)
def test_ring_in_layered_media_against_the_exact_solution(case, layered_ring, validated):
    radius, width, resistance, step = LAYERED[case]
    problem = layered_ring(radius, width)
    ours, rel = problem.thermal_resistance(), problem.accuracy + TRUNCATION
    exact = "exact, Hankel–Laplace transform"
    validated("Ring", f"R_th of a ring in layered media, {case}", ours, resistance, rel=rel, unit="K/W", source=exact)
    data = th.solve(problem, th.Constant(1e-3), LAYERED_TIMES, rtol=problem.accuracy / 10)
    for time, rise, value in zip(LAYERED_TIMES, data.delta_T.values * 1e3, step, strict=True):
        what = f"its step response at {time * 1e9:g} ns, {case}"
        validated("Ring", what, rise, value, rel=problem.accuracy, unit="K/W", source=exact)


@pytest.fixture
def layered_ring(needs_mesher):
    def build(radius, width):
        geometry = th.strip_ring(radius=radius, width=width, substrate=2e-3, outer_radius=2e-3)
        oxide = Material("SiO2", 1.38, 2203, 709, source="verification problem")
        silicon = Material("Si", 148, 2330, 711, source="verification problem")
        core = replace(geometry.parts[0], material="SiO2")
        return th.assemble(replace(geometry, parts=(core,), materials=(oxide, silicon)), accuracy=1e-3)

    return build


RATE = th.Function(lambda t: 100 * np.pi / 40 * np.cos(np.pi * t / 40))  # K/s: of the hot end of NAFEMS T3


def probe(d, r, z):
    """Row that reads the temperature at a point from the free unknowns."""
    return np.asarray(d.basis.probes(np.array([[r], [z]])).todense())[:, d.free]


def test_nafems_t3_transient_with_a_moving_end_temperature(validated):
    """NAFEMS T3: L = 0.1 m, T(0) = 0, T(L) = 100 sin(pi t/40) C, x = 0.08 m at 32 s: 36.60 C; series: 36.603116 C."""
    L = 0.1
    mesh = tensor_mesh(np.linspace(0.05, 0.055, 3), np.linspace(0, L, 81))  # any ring: the solution depends on z only
    d = th.fem.discretize(
        mesh, 35.0, 7200 * 440.5, th.fem.Surfaces(held=facets_where(mesh, lambda r, z: np.isclose(z % L, 0)))
    )
    lift = d.basis.doflocs[1] / L  # T = w + g(t) z/L: the static shape of the moving end; M dw/dt = -K w - g' M lift
    moving = th.StateSpace(
        E=d.mass[d.free][:, d.free],
        A=-d.stiffness[d.free][:, d.free],
        B=-(d.mass @ lift)[d.free][:, None],
        C=probe(d, 0.05, 0.08),
        inputs=("hot end",),
        outputs=("x 0.08 m",),
    )
    w = integrate(moving, RATE, [32.0], rtol=1e-6).outputs[0, 0]
    # 4e-6 with these 80 quadratic elements, 28e-6 with 40 (order 3); backward Euler at 1 s would give 36.109
    ours, source = w + 0.8 * 100 * np.sin(np.pi * 32 / 40), "exact series; NAFEMS publishes 36.60"
    validated("Heat equation", "NAFEMS T3, 0.08 m, 32 s", ours, 36.603116, rel=1e-5, unit="°C", source=source)


def test_nafems_annulus_with_a_heat_flux(validated):
    """Annulus r 0.02..0.1, z 0..0.14 m, k = 52, 5e5 W/m^2 on r = 0.02 for z 0.04..0.10; other sides at 273.15 K."""
    mesh = tensor_mesh(graded(0.02, 0.1, finest=2e-4, growth=1.3), graded(0, 0.04, 0.1, 0.14, finest=2e-4, growth=1.3))
    sides = facets_where(mesh, lambda r, z: np.isclose(r, 0.1) | np.isclose(z, 0) | np.isclose(z, 0.14))
    d = th.fem.discretize(mesh, 52.0, 1.0, th.fem.Surfaces(held=sides))
    flux = facets_where(mesh, lambda r, z: np.isclose(r, 0.02) & (z > 0.04) & (z < 0.10))

    @skfem.LinearForm
    def heating(v, w):
        return 2 * np.pi * w.x[0] * 5e5 * v

    T = np.zeros(d.mass.shape[0])
    T[d.free] = factorize(d.stiffness[d.free][:, d.free])(heating.assemble(d.basis.boundary(flux))[d.free])
    rise = (probe(d, 0.04, 0.04) @ T[d.free]).item()
    source = "exact series; NAFEMS publishes 332.97 K"
    validated(
        "Heat equation", "NAFEMS annulus, rise at (0.04, 0.04) m", rise, 59.820514, rel=1e-4, unit="K", source=source
    )


def test_nafems_axisymmetric_transient(validated):
    """Cylinder R = 0.3, H = 0.4 m, all faces at 1000 C from t = 0: 186.485279 C at (0.1, 0.3) after 190 s."""
    mesh = tensor_mesh(np.linspace(0, 0.3, 25), np.linspace(0, 0.4, 33))
    faces = facets_where(mesh, lambda r, z: np.isclose(r, 0.3) | np.isclose(z % 0.4, 0))
    d = th.fem.discretize(mesh, 52.0, 7850 * 460.0, th.fem.Surfaces(held=faces))
    n = d.free.size
    cooling = th.StateSpace(
        d.mass[d.free][:, d.free], -d.stiffness[d.free][:, d.free], np.zeros((n, 1)), probe(d, 0.1, 0.3)
    )
    deficit = integrate(cooling, th.Constant(0.0), [190.0], rtol=1e-6, initial=np.full(n, -1000.0)).outputs[0, 0]
    what = "NAFEMS axisymmetric transient, (0.1, 0.3) m, 190 s"
    validated("Heat equation", what, 1000 + deficit, 186.485279, rel=1e-4, unit="°C", source="exact series")


def test_cylinder_shell_with_convection(validated):
    """Rod heated inside, convection outside: R_th = 1/(2 pi a L h) + ln(a/b)/(2 pi k L) + 1/(8 pi k L), exact."""
    b, a, L, k, h = 1e-3, 5e-3, 2e-3, 20.0, 400.0
    mesh = tensor_mesh(
        np.append(np.linspace(0, b, 9), np.linspace(b, a, 33)[1:]), [0, L], lambda r, z: r > b, ("core", "shell")
    )
    outside = facets_where(mesh, lambda r, z: np.isclose(r, a))
    d = th.fem.discretize(mesh, k, 1e6, th.fem.Surfaces(convection={h: outside}))
    system = d.state_space(("core",), ("core",))
    exact = 1 / (2 * np.pi * a * L * h) + np.log(a / b) / (2 * np.pi * k * L) + 1 / (8 * np.pi * k * L)
    what, ours = "rod in a convecting shell, R_th", system.thermal_resistance
    validated("Heat equation", what, ours, exact, rel=1e-6, unit="K/W", source="closed form")
    # all heat leaves by convection: at the steady state the ledger's outflow is the power
    state = factorize(-system.A)(system.B[:, 0])
    assert linear_ledger(d).drain(state) == pytest.approx(1.0, rel=1e-9, abs=0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda p: p.thermal_resistance("cor"), "heated = 'cor' is unknown; did you mean 'core'"),
        (lambda p: p.thermal_resistance("core", "bx"), "read = 'bx' is unknown; did you mean 'box'"),
        (lambda p: th.solve(p, th.Constant, [1e-6]), "a waveform is needed"),
        (lambda p: th.solve(p, th.Constant(1e-3), [float("nan")]), r"times\[0\] = nan is not finite"),
        (lambda p: th.solve_periodic(p, th.Constant(1e-3)), "Constant has no period"),
        (lambda p: p.channels("core", ("core", "box")).thermal_resistance, "pick one of each"),
    ],
)
def test_bad_input(call, words):
    with pytest.raises(th.InputError, match=words):
        call(th.assemble(th.strip_ring()))
