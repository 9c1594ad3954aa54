"""Rings as they are made: one bus, unequal buses, scattering, Kerr shift, constant lifetime, Q factors, TOML."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rings import RING, SECOND_ORDER
from scipy.integrate import solve_ivp

import coupled
import thermofem as th
from coupled import ConstantLifetime, RingResonator
from coupled.kernel import units as eq
from coupled.kernel.tableaus import Method

REAL = replace(
    RING,
    name="real",
    drop_rate=20e9,
    scattering_rate=3e9,
    kerr_coefficient=4.5e-18,
    carriers=ConstantLifetime(12e-9),
    fcd=((-2.2e-27, 1.0), (-8e-22, 0.77)),
)
UNIT = np.array([eq.FJ**0.5, eq.FJ**0.5, eq.DENSITY, 1, 1])
VARIANTS = {
    "all of it": REAL,
    "one bus": replace(RING, drop_rate=0.0),
    "rates": RING.with_rates(eta_fca=2e-13, eta_tpa=8e21, g_tpa=8e57, thermal_shift=5e10, kerr_shift=2e23),
}


def free_equations(ring, power, detuning):
    """The printed equations with every loss and shift by itself, in SI, for SciPy."""

    def f(t, y):
        a, N, x = y[0] + 1j * y[1], max(y[2], 0.0), y[3:]
        U = abs(a) ** 2
        index = sum(c * N**p for c, p in ring.fcd)
        D = -ring.thermal_shift * x.sum() - ring.omega / ring.refractive_index * index
        D -= ring.kerr_shift * U + 2 * np.pi * detuning
        own = ring.loss_rate + ring.eta_fca * N + ring.eta_tpa * U
        gamma = ring.bus_rate + ring.drop_bus_rate + ring.scattering_rate + own
        da = (1j * D - gamma) * a + 1j * math.sqrt(2 * ring.bus_rate * power)
        dN = -N / ring.carriers.lifetime(N) + ring.g_tpa * U**2
        return np.array([da.real, da.imag, dN, *((SECOND_ORDER.R * 2 * own * U - x) / SECOND_ORDER.tau)])

    return f


@pytest.mark.parametrize("name", VARIANTS)
def test_every_loss_and_shift_is_in_the_compiled_equations(name):
    ring, y = VARIANTS[name], np.array([-2.3, 2.85, 1.7, 3.0, 4.0])
    got, _ = eq.single_ring(ring, SECOND_ORDER, 2e-3, -4e9, 1e-9, Method.RODAS4).slopes(y)
    want = free_equations(ring, 2e-3, -4e9)(0.0, y * UNIT) / UNIT * eq.NS
    assert got == pytest.approx(want, rel=1e-12)  # round-off


@pytest.mark.parametrize("name", VARIANTS)
def test_light_is_neither_made_nor_lost(name):
    """P = through + drop + absorbed + scattered + dU/dt at every power, integrated over a run."""
    ring = VARIANTS[name]
    for power in (1e-6, 1e-3, 8e-3):
        times = np.linspace(0, 40e-9, 40_001)  # 1 ps apart; the field decays in 11
        run = coupled.simulate(ring, SECOND_ORDER, power=power, duration=40e-9, times=times, rtol=1e-9)
        out = run["drop"] + run["through"] + run["absorbed"] + run.get("scattered", 0)
        energy = np.trapezoid(out.values, times) + float(run.energy[-1])
        # trapezoids of the first picoseconds, through = P there: (dt/tau)^2/12 = 1e-3 of P tau, 3e-7 of the whole
        assert energy == pytest.approx(power * 40e-9, rel=2e-6, abs=0)
    assert ("scattered" in run) == (ring.scattering_rate > 0)
    assert np.all(run["drop"].values == 0) == (ring.drop_bus_rate == 0)


@pytest.mark.slow
def test_random_rings_agree_with_radau():
    draw = np.random.default_rng(5)
    for _ in range(4):
        ring = replace(
            REAL,
            bus_rate=draw.uniform(10e9, 60e9),
            drop_rate=draw.uniform(0, 60e9),
            loss_rate=draw.uniform(1e9, 20e9),
            scattering_rate=draw.uniform(0, 10e9),
            tpa_volume=draw.uniform(3e-18, 9e-18),
            fca_volume=draw.uniform(3e-18, 9e-18),
            kerr_coefficient=draw.uniform(0, 5e-18),
            carriers=ConstantLifetime(draw.uniform(3e-9, 60e-9)),
        )
        power, detuning, stop = draw.uniform(0.5e-3, 8e-3), draw.uniform(-10e9, 20e9), 25e-9
        f = free_equations(ring, power, detuning)
        other = solve_ivp(
            lambda t, z, f=f: f(t, z * UNIT) / UNIT, (0, stop), np.zeros(5), method="Radau", rtol=1e-10, atol=1e-12
        )
        run = coupled.simulate(ring, SECOND_ORDER, power=power, detuning=detuning, duration=stop, rtol=1e-9)
        got = run.attrs["final_state"] / UNIT
        # a tolerance of 1e-9 a step over a hundred steps, and eps = 1e15 per m^3 in N^0.77
        assert got == pytest.approx(other.y[:, -1], rel=1e-6, abs=1e-7)


def test_linear_absorption_alone_gives_the_cubic_of_thermal_bistability():
    ring = replace(RING, tpa_coefficient=0.0)
    R, per_kelvin = SECOND_ORDER.thermal_resistance, ring.thermal_shift
    power, nu = 3e-3, -4e9
    run = coupled.simulate(ring, SECOND_ORDER, power=power, detuning=nu, duration=40e-6)
    U = float(run.energy[-1])
    k = per_kelvin * R * 2 * ring.loss_rate  # U [gamma^2 + (2 pi nu + k U)^2] = 2 gamma_e P, a cubic in U
    gamma, w = ring.linear_rate, 2 * np.pi * nu
    roots = np.roots([k * k, 2 * w * k, gamma**2 + w**2, -2 * ring.bus_rate * power])
    real = roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real
    assert np.abs(real / U - 1).min() < 1e-6  # e^(-40) of the start is left, and 1e-6 of a step


def test_quality_factors_come_back():
    ring = RingResonator.from_quality_factors(
        RING, name="rib", frequency=193e12, loaded_q=12e3, intrinsic_q=110e3, buses=1, absorbed_fraction=0.4,
        perimeter=50e-6, mode_area=1e-13,
    )  # fmt: skip
    assert (ring.loaded_q, ring.intrinsic_q) == pytest.approx((12e3, 110e3), rel=1e-12)
    assert ring.loss_rate == pytest.approx(0.4 * math.pi * 193e12 / 110e3, rel=1e-12)
    assert ring.drop_bus_rate == 0
    assert ring.tpa_volume == pytest.approx(5e-18, rel=1e-12, abs=0)
    two = RingResonator.from_quality_factors(RING, name="rib", frequency=193e12, loaded_q=12e3, intrinsic_q=110e3)
    assert two.drop_bus_rate == two.bus_rate == pytest.approx(ring.bus_rate / 2, rel=1e-12)
    assert (two.tpa_volume, two.scattering_rate) == (RING.tpa_volume, 0)
    with pytest.raises(th.InputError, match="is below intrinsic_q"):
        RingResonator.from_quality_factors(RING, name="x", frequency=193e12, loaded_q=1e5, intrinsic_q=1e4)


FULL = """
name = "rib ring 3"
wavelength = "1551.2 nm"
loaded_q = 12000
intrinsic_q = 110000
buses = 2
absorbed_fraction = 0.4
perimeter = "50 um"
mode_area = "0.1 um^2"
refractive_index = 3.485
group_index = 4.2
thermo_optic = "1.86e-4 1/K"
fca_cross_section = "1.45e-17 cm^2"
tpa_coefficient = "0.81 cm/GW"
kerr_coefficient = "4.5e-18 m^2/W"
tpa_confinement = 0.99
fca_confinement = 0.99
[[dispersion]]
coefficient = -1.07e-27
exponent = 1
[[dispersion]]
coefficient = -1.63e-22
exponent = 0.8
[carriers]
lifetime = "10 ns"
[rates]
eta_fca = "1e-13 m^3/s"
"""


def test_a_ring_file():
    ring = RingResonator.from_text(FULL)
    assert ring.frequency == pytest.approx(299792458 / 1551.2e-9, rel=1e-14)
    assert ring.loaded_q == pytest.approx(12e3, rel=1e-12)
    assert ring.loss_rate == pytest.approx(0.4 * math.pi * ring.frequency / 110e3, rel=1e-12)
    assert ring.tpa_coefficient == 8.1e-12
    assert ring.fca_cross_section == 1.45e-21
    assert ring.fcd == RING.fcd
    assert ring.carriers == ConstantLifetime(10e-9)
    assert ring.eta_fca == 1e-13
    assert ring.tpa_volume == pytest.approx(5e-18, rel=1e-14, abs=0)


def test_a_ring_file_with_a_base(tmp_path):
    path = tmp_path / "ring.toml"
    path.write_text('base = "borghi2021"\n')
    assert RingResonator.from_toml(path) == RING
    path.write_text(
        'name = "one bus"\nbase = "borghi2021"\nbuses = 1\nscattering_rate = "1e9 1/s"\n[carriers]\ntau_n = "35 ns"\n'
        'tau_p = "22.5 ns"\nintrinsic_density = "5e17 1/m^3"\nhole_density = "1e15 1/cm^3"\ntrap_energy = "100 meV"\n'
        'temperature = "293.15 K"\n'
    )
    ring = RingResonator.from_toml(path)
    assert ring.drop_bus_rate == 0
    assert ring.scattering_rate == 1e9
    assert ring.carriers.tau0 == pytest.approx(RING.carriers.tau0, rel=3e-3, abs=0)  # k_B rounded in the paper
    with pytest.raises(th.InputError, match="does not exist"):
        RingResonator.from_toml(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("loaded_q = 12000\n", ""), "loaded_q and intrinsic_q belong together"),
        (("buses = 2", "buses = 3"), "known: 1, 2"),
        (("buses = 2", 'bus_rate = "43e9 1/s"'), "bus_rate are both given"),
        (('wavelength = "1551.2 nm"', 'wavelength = "1551.2"'), "has no unit"),
        (('wavelength = "1551.2 nm"', 'wavelenght = "1551.2 nm"'), "did you mean 'wavelength'"),
        (('wavelength = "1551.2 nm"', 'wavelength = "1551.2 um"'), "wavelength"),
        (("refractive_index = 3.485\n", ""), "refractive_index missing"),
        (('lifetime = "10 ns"', 'lifetime = "10 nm"'), "wrong dimension"),
        (('lifetime = "10 ns"', 'lifetime = "10 ns"\ntau_n = "3 ns"'), "constant lifetime: key"),
        (('lifetime = "10 ns"', 'tau_n = "3 ns"'), "tau_p is missing"),
        (("exponent = 0.8", ""), "exponent is missing"),
        (("coefficient = -1.07e-27", "coefficient = 1.07e-27"), "index change"),
        (('eta_fca = "1e-13 m^3/s"', 'eta_fac = "1e-13 m^3/s"'), "did you mean 'eta_fca'"),
        (('name = "rib ring 3"', "name = 3"), "must be text"),
        (('name = "rib ring 3"', 'base = "borghi2020"'), "did you mean 'borghi2021'"),
        (("[carriers]", "[carriers"), "TOML"),
    ],
)
def test_slips_in_a_ring_file_are_named(change, message):
    with pytest.raises(th.InputError, match=message):
        RingResonator.from_text(FULL.replace(*change))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("absorbed_fraction = 0.4", "absorbed_fraction goes with"),
        ('drop_rate = "40e9 1/s"', "a ring on one bus has none"),
    ],
)
def test_what_one_bus_leaves_no_room_for_is_not_dropped_silently(line, message):
    with pytest.raises(th.InputError, match=message):
        RingResonator.from_text(f'base = "borghi2021"\nbuses = 1\n{line}\n')


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"drop_rate": -1.0}, "drop_rate"),
        ({"scattering_rate": float("nan")}, "not finite"),
        ({"kerr_coefficient": 4.5e-14}, "4.5e-18"),
        ({"rates": (("eta_tpaa", 1.0),)}, "did you mean 'eta_tpa'"),
        ({"rates": (("eta_tpa", -1.0),)}, "rates eta_tpa = -1 must"),
    ],
)
def test_slips_in_a_ring_are_named(change, message):
    with pytest.raises(th.InputError, match=message):
        replace(RING, **change)
    with pytest.raises(th.InputError, match="tau"):
        ConstantLifetime(10.0)


def test_rates_that_would_not_follow_a_new_volume_are_named():
    fixed = RING.with_rates(eta_tpa=1e22, eta_fca=1e-13)
    common = {"name": "ring", "frequency": 193e12, "loaded_q": 6e3, "intrinsic_q": 1e5}
    assert RingResonator.from_quality_factors(fixed, **common).eta_tpa == 1e22
    with pytest.raises(th.InputError, match="base has eta_tpa set"):
        RingResonator.from_quality_factors(fixed, **common, perimeter=50e-6, mode_area=0.1e-12)
