"""Rings as they are made: one bus, unequal buses, scattering, Kerr shift, constant lifetime, Q factors, TOML."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from rings import RING, SECOND_ORDER
from scipy.integrate import solve_ivp
from support import ring_ode

import coupled
import thermofem as th
from coupled import ConstantLifetime, RingResonator, ring_toml
from coupled.kernel import units as eq
from coupled.kernel.tableaus import Method
from thermofem.data import quantity

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


@pytest.mark.parametrize("name", VARIANTS)
def test_every_loss_and_shift_is_in_the_compiled_equations(name):
    ring, y = VARIANTS[name], np.array([-2.3, 2.85, 1.7, 3.0, 4.0])
    got, _ = eq.single_ring(ring, SECOND_ORDER, 2e-3, -4e9, 1e-9, Method.RODAS4).slopes(y)
    want = ring_ode.right_hand_side(y * UNIT, ring, SECOND_ORDER, 2e-3, -4e9) / UNIT * eq.NS
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

        def slopes(t, z, ring=ring, power=power, detuning=detuning):
            return ring_ode.right_hand_side(z * UNIT, ring, SECOND_ORDER, power, detuning) / UNIT

        other = solve_ivp(slopes, (0, stop), np.zeros(5), method="Radau", rtol=1e-10, atol=1e-12)
        run = coupled.simulate(ring, SECOND_ORDER, power=power, detuning=detuning, duration=stop, rtol=1e-9)
        got = run.attrs["final_state"] / UNIT
        # a tolerance of 1e-9 a step over a hundred steps, and eps = 1e15 per m^3 in N^0.77
        assert got == pytest.approx(other.y[:, -1], rel=1e-6, abs=1e-7)


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


@pytest.mark.parametrize("carriers", [RING.carriers, ConstantLifetime(10e-9)], ids=lambda law: type(law).__name__)
def test_every_number_of_a_ring_survives_its_file(carriers):
    """Every field is known to the file and to the reader."""
    assert {*ring_toml.UNITS.values(), *ring_toml.RATES.values()} <= quantity.SI
    numbers = {name: known.high for name, known in ring_toml.FIELDS.items() if name != "lumped_fcd"}
    fields = {name: (1e-10 if name.startswith("tau") else 1e-3) + 1.01 * x for name, x in vars(carriers).items()}
    ring = replace(RING, **numbers, lumped_fcd=-1e-26, carriers=replace(carriers, **fields))
    assert vars(ring).keys() == {"name", "fcd", "carriers", "rates", "read", "mode"} | ring_toml.FIELDS.keys()
    again = RingResonator.from_text(ring_toml.write_text(ring, {}))
    # k_B T is written as a temperature: two roundings
    assert vars(again.carriers) == pytest.approx(vars(ring.carriers), rel=1e-15, abs=0)
    assert replace(again, carriers=ring.carriers) == ring


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
