"""Sweeps as instruments write them: decibels, baselines, fringes, doublets, and through ports with two answers.

The truth of every sweep is the closed form of a linear ring, |1 - 2 b/(w + i d)|^2 and 4 b d/|w + i d|^2, with noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy.constants import c

import coupled
import thermofem as th
from coupled.identification.held_numbers import leaning, summary
from coupled.sweeps.slow_sweeps import with_seen_resonance
from coupled.sweeps.sweep_doubts import correlation_of, widening_by
from coupled.unknowns import varied

BOTH = coupled.borghi2021()
ONE = replace(BOTH, drop_rate=0.0, scattering_rate=0.0)
BUS, LOSS = 3e9, 8e9  # 1/s
START = replace(ONE, bus_rate=4e9, loss_rate=6e9)
NU = np.linspace(-20e9, 20e9, 161)
XI = NU / NU.max()
RATES = ["bus_rate", "loss_rate", "frequency"]
POWER = 1e-6  # W: no heat to speak of, 1e-6 W x .4 x 8 K/mW is 3 uK


def dip(bus=BUS, loss=LOSS):
    return np.abs(1 - 2 * bus / (bus + loss + 2j * np.pi * NU)) ** 2


def peak(bus=BUS, drop=BUS, loss=LOSS):
    return np.abs(2 * np.sqrt(bus * drop) / (bus + drop + loss + 2j * np.pi * NU)) ** 2


def sweep(port, y, unit, *, noise=0.0, seed=0, power=POWER):
    y = y + noise * np.random.default_rng(seed).standard_normal(y.size)
    attributes = {} if unit is None else {"units": unit}
    wavelength = ("step", c / (BOTH.frequency + NU))
    return xr.Dataset({port: ("step", y, attributes), "wavelength": wavelength}, attrs={"power": power})


def off(found, name, true):
    """Distance from the truth in deviations."""
    return abs(found.parameters[name] - true) / found.standard_deviations[name]


@pytest.mark.parametrize(("bus", "loss"), [(8e9, 3e9), (3e9, 8e9)])
def test_a_through_port_alone_names_both_answers(bus, loss):
    """The power is the same with bus and loss exchanged; five deviations are one in a million."""
    found = coupled.fit_transmission(START, sweep("through", dip(bus, loss), "1", noise=2e-3), free=RATES)
    both = [found.parameters, found.alternative]
    right = min(both, key=lambda one: abs(one["bus_rate"] - bus))
    wrong = max(both, key=lambda one: abs(one["bus_rate"] - bus))
    deviation = max(found.standard_deviations["bus_rate"], found.standard_deviations["loss_rate"])
    assert abs(right["bus_rate"] - bus) < 5 * deviation
    assert abs(right["loss_rate"] - loss) < 5 * deviation
    assert abs(wrong["bus_rate"] - loss) < 5 * deviation
    (note,) = found.notes
    assert f"bus_rate = {found.alternative['bus_rate']:.4g}" in note
    assert found.parameters["bus_rate"] < found.parameters["loss_rate"]  # the side of the initial ring


@pytest.mark.parametrize("unit", ["W", "dBm"])
def test_two_equal_buses_of_a_file_move_together(unit):
    """A drop port behind a fibre of 4.7 dB in dBm; five deviations are one in a million."""
    start = replace(BOTH, bus_rate=4e9, drop_rate=4e9, loss_rate=LOSS)
    watts = POWER * peak()
    level = watts if unit == "W" else 10 * np.log10(watts / 1e-3) - 4.7
    noise = 1e-3 * POWER if unit == "W" else 0.05
    found = coupled.fit_transmission(start, sweep("drop", level, unit, noise=noise), free=["bus_rate", "frequency"])
    assert off(found, "bus_rate", BUS) < 5
    assert found.standard_deviations["bus_rate"] < 0.02 * BUS
    assert found.ring.drop_bus_rate == found.parameters["bus_rate"]
    assert found.misfit < 1.5


def test_bounds_of_the_user_exclude_the_other_answer():
    over = coupled.fit_transmission(
        START, sweep("through", dip(8e9, 3e9), "1", noise=2e-3), free=RATES, bounds={"bus_rate": (6e9, 2e10)}
    )
    assert off(over, "bus_rate", 8e9) < 5
    assert over.alternative is None
    assert over.notes == ()


@pytest.mark.parametrize(("unit", "shift"), [("dB", 0.0), ("dBm", -20.0), ("dbm", -37.5)])
def test_decibels_are_read_by_their_unit(unit, shift):
    """The depth of a dip does not depend on the loss of a fibre, 7.5 dB in the last case."""
    y = 10 * np.log10(dip()) + shift
    found = coupled.fit_transmission(START, sweep("through", y, unit, noise=0.02), free=RATES)
    assert off(found, "bus_rate", BUS) < 5
    assert off(found, "loss_rate", LOSS) < 5
    assert found.standard_deviations["bus_rate"] < 0.02 * BUS
    assert found.misfit == pytest.approx(1, abs=0.3)  # 161 samples: their rms is 1 within 5 %, the steps lower it


def test_decibels_of_a_drop_port_have_one_scale_and_a_tilt():
    y = 10 * np.log10(peak()) - 4.2 + 1.5 * XI
    found = coupled.fit_transmission(
        replace(BOTH, bus_rate=4e9, loss_rate=6e9), sweep("drop", y, "dB", noise=0.02), free=["loaded_q", "frequency"]
    )
    assert off(found, "loaded_q", np.pi * BOTH.frequency / (2 * BUS + LOSS)) < 5
    (sample,) = found.samples
    assert sample.attrs["slope"] == pytest.approx(3.0, abs=0.05)  # from one end to the other; noise .02 dB/sqrt(161)


@pytest.mark.parametrize("unit", [None, "W", "V"])
def test_negative_powers_are_asked_for(unit):
    with pytest.raises(th.InputError, match=r"negative on average.*dBm"):
        coupled.fit_transmission(START, sweep("through", 10 * np.log10(dip()), unit), free=RATES)


def test_fractions_without_a_unit_are_asked_for():
    with pytest.raises(th.InputError, match=r"states no unit, and .* more than the 1e-06 W in the bus"):
        coupled.fit_transmission(START, sweep("through", dip(), None), free=RATES)


@pytest.mark.parametrize(("slope", "dark"), [(0.0, 0.0), (0.1, 0.0), (-0.1, 0.03)])
def test_slope_and_dark_level_are_no_part_of_the_ring(slope, dark):
    """Put into the rates they give pulls of 19 deviations."""
    y = POWER * (peak() * (1 + slope * XI) + dark)
    ring = replace(BOTH, bus_rate=4e9, loss_rate=6e9)
    found = coupled.fit_transmission(ring, sweep("drop", y, "W", noise=2e-3 * y.max()), free=RATES)
    assert off(found, "bus_rate", BUS) < 5
    assert off(found, "loss_rate", LOSS) < 5
    assert found.notes == ()
    (sample,) = found.samples
    noise = 2e-3 * y.max()
    assert sample.attrs["offset"] == pytest.approx(dark * POWER, abs=noise)  # the mean of 161 samples, with the tails
    # five deviations of linear least squares in the level, the slope, the place, the height and the width of the peak
    T = peak()
    by_width = peak(loss=LOSS + 1e7) - T
    columns = np.column_stack([np.ones(NU.size), T * XI, np.gradient(T), T, by_width / np.abs(by_width).max()])
    deviation = 2e-3 * T.max() * np.sqrt(np.linalg.inv(columns.T @ columns)[1, 1])
    assert sample.attrs["slope"] == pytest.approx(2 * slope, abs=2 * 5 * deviation)
    # the curve with its baseline runs through the samples
    (curve,) = found.curves
    order = np.argsort(curve["detuning"].values)
    drawn = np.interp(
        sample["detuning"].values, curve["detuning"].values[order], curve["signal"].values[order]
    )  # fmt: skip
    assert np.sqrt(np.mean((drawn - sample["signal"].values) ** 2)) < 1.3 * noise


@pytest.mark.parametrize(("unit", "gain", "dark"), [("1", 1.0, 0.03), ("1", 0.95, 0.0), ("V", 0.95, 0.0)])
def test_a_through_port_off_its_level_is_noted(unit, gain, dark):
    """In fractions a difference from 1 is a dark level, in words, too; in an arbitrary unit it is the scale."""
    y = gain * dip() + dark
    found = coupled.fit_transmission(START, sweep("through", y, unit, noise=2e-3), free=RATES)
    assert any("dark level" in note for note in found.notes) == (unit == "1")
    right = off(found, "bus_rate", BUS) < 5 and off(found, "loss_rate", LOSS) < 5
    assert right == (gain == 1.0 or unit == "V")


@pytest.mark.parametrize("kind", ["fringes", "doublet"])
def test_what_the_model_misses_is_noted(kind):
    """Fringes of 4 %, and a resonance split by 3 GHz at a linewidth of 3.5 GHz: residuals follow each other."""
    y = dip() + 0.04 * np.sin(2 * np.pi * NU / 7e9)
    if kind == "doublet":
        halves = (1 / (BUS + LOSS + 2j * np.pi * (NU + shift)) for shift in (-1.5e9, 1.5e9))
        y = np.abs(1 - BUS * sum(halves)) ** 2
    found = coupled.fit_transmission(START, sweep("through", y, "1", noise=4e-3), free=RATES)
    assert any("correlated" in note and "doublet" in note and "fringes" in note for note in found.notes)


def test_the_correlation_of_a_first_order_process_is_that_of_its_samples():
    """r_k = .6 r_(k-1) + e_k: correlation .6, and the deviation of a mean grows by sqrt(1.6/.4) = 2."""
    rng = np.random.default_rng(4)
    r = np.zeros(4000)
    for k in range(1, r.size):
        r[k] = 0.6 * r[k - 1] + rng.standard_normal()
    found = correlation_of(r)
    assert found == pytest.approx(0.6, abs=5 * 0.8 / np.sqrt(r.size))  # sqrt(1 - .36)/sqrt(n) is its deviation
    assert widening_by(found) == pytest.approx(2, rel=0.1)
    assert correlation_of(rng.standard_normal(4000)) == 0.0
    assert correlation_of(1e-3 * r) == 0.0  # far below the noise: nothing that matters


def test_deviations_contain_those_of_held_numbers():
    """A shift R_th thermo_optic P is all that shows R_th without carriers: R_th goes as 1/thermo_optic."""
    ring = replace(BOTH, tpa_coefficient=0.0, fcd=((0.0, 1.0),))
    heat = th.Foster(R=[9e3], tau=[1e-6])
    seen = coupled.transmission(ring, heat, power=3e-3, detuning=(-60e9, 40e9)).drop_vars("through")
    free = ["thermal_resistance", "frequency"]
    plain = coupled.fit_transmission(ring, seen, free=free, model=heat)
    assert plain.sensitivities["thermal_resistance"]["thermo_optic"] == pytest.approx(-1, abs=0.02)  # steps of .5 %
    assert any("thermo_optic" in line for line in leaning(plain.sensitivities, most=20))
    held = coupled.fit_transmission(ring, seen, free=free, model=heat, held={"thermo_optic": 0.05 * ring.thermo_optic})
    own = plain.standard_deviations["thermal_resistance"] / 9e3
    assert held.standard_deviations["thermal_resistance"] / 9e3 == pytest.approx(np.hypot(own, 0.05), rel=0.02)
    with pytest.raises(th.InputError, match="'frequency', which is free"):
        coupled.fit_transmission(ring, seen, free=free, held={"frequency": 1e9})


def test_known_noise_sets_the_deviations():
    """Twice the noise said, twice the deviation, where it is more than the slope of the dip times half a step, .04."""
    one = sweep("through", dip(), "1", noise=2e-3)
    known = [coupled.fit_transmission(START, one, free=RATES, noise=size) for size in (0.2, 0.4)]
    first, second = (found.standard_deviations["loss_rate"] for found in known)
    assert second / first == pytest.approx(2, rel=0.05)  # sqrt((.4^2 + .04^2)/(.2^2 + .04^2)) is 1.97
    with pytest.raises(th.InputError, match="noise holds 2 numbers for 1 records"):
        coupled.fit_transmission(START, one, free=["loss_rate"], noise=[0.01, 0.02])


def test_qualities_are_free_numbers():
    """1/Q_l = 2 (b + o)/omega and 1/Q_i = 2 o/omega, with the same fit by rates as the witness."""
    one = sweep("through", dip(), "1", noise=2e-3)
    by_rates = coupled.fit_transmission(START, one, free=RATES)
    found = coupled.fit_transmission(START, one, free=["loaded_q", "intrinsic_q", "frequency"])
    omega = 2 * np.pi * found.parameters["frequency"]
    for name, rate in (("loaded_q", BUS + LOSS), ("intrinsic_q", LOSS)):
        assert off(found, name, omega / (2 * rate)) < 5
        assert found.parameters[name] == pytest.approx(by_rates.parameters[name], rel=1e-3)
        assert found.standard_deviations[name] == pytest.approx(by_rates.standard_deviations[name], rel=0.1)
    assert found.alternative["intrinsic_q"] == pytest.approx(omega / (2 * BUS), rel=0.02)


def test_numbers_that_are_computed_set_their_fields():
    ring = replace(BOTH, scattering_rate=2e9, drop_rate=20e9)
    changed = varied(ring, {"loaded_q": 2e4, "intrinsic_q": 1e5, "lifetime": 7e-9})
    assert changed.loaded_q == pytest.approx(2e4, rel=1e-12)
    assert changed.intrinsic_q == pytest.approx(1e5, rel=1e-12)
    assert changed.carriers.tau0 == pytest.approx(7e-9, rel=1e-12, abs=0)
    assert changed.bus_rate / changed.drop_rate == pytest.approx(ring.bus_rate / 20e9, rel=1e-12)
    assert changed.loss_rate / changed.scattering_rate == pytest.approx(ring.loss_rate / 2e9, rel=1e-12)
    with pytest.raises(th.InputError, match="below the intrinsic Q"):
        varied(ring, {"loaded_q": 10 * ring.intrinsic_q})
    for free in (["loaded_q", "bus_rate"], ["lifetime", "tau0"]):
        with pytest.raises(th.InputError, match="the one sets the other"):
            coupled.fit_transmission(START, sweep("through", dip(), "1"), free=free)


def test_a_fit_prints_in_a_dozen_lines():
    found = coupled.fit_transmission(START, sweep("through", dip(), "1", noise=2e-3), free=RATES)
    lines = str(found).splitlines()
    assert len(lines) <= 12
    assert max(map(len, lines)) <= 100
    assert any(line.split()[:2] == ["bus_rate", f"{found.parameters['bus_rate']:.5g}"] for line in lines)


def test_a_summary_of_many_notes_has_twelve_lines_and_counts_the_rest():
    """Five parameters and a title leave six lines: three held numbers, two notes, and what is left of nine notes."""
    numbers = dict.fromkeys("abcde", 1.0)
    leaning = {"a": {"x": 3.0, "y": 2.0, "z": 1.0}}
    lines = summary("A fit", numbers, {}, leaning, [f"doubt {k} " + "word " * 40 for k in range(9)]).splitlines()
    assert len(lines) == 12
    assert max(map(len, lines)) <= 100
    assert lines[6].strip() == "held: a moves by +3 % for 1 % of x"
    assert lines[-1].strip() == "and 7 more lines, in .sensitivities and .notes"


@pytest.mark.parametrize(("port", "y"), [("through", dip(8e9, 3e9)), ("drop", peak())])
def test_the_start_of_a_search_is_seen_in_the_weakest_sweep(port, y):
    """Width and place to the step of .2 GHz of 3.5 and 4.5 GHz; the depth of the dip gives its under-coupled answer."""
    ring = replace(ONE if port == "through" else BOTH, frequency=BOTH.frequency - 50e9)
    seen = with_seen_resonance(ring, [sweep(port, y, "1")])
    true = 11e9 if port == "through" else 2 * BUS + LOSS
    assert seen.frequency == pytest.approx(BOTH.frequency, abs=0.2e9)
    assert seen.linear_rate == pytest.approx(true, rel=0.15)
    if port == "through":
        assert seen.bus_rate == pytest.approx(3e9, rel=0.2)
