"""Thermal noise: closed forms, published digits, full-order solves, ngspice, and what is refused."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest
import skfem
from scipy.constants import Boltzmann
from scipy.special import exp1

import coupled
import surrogate
import thermofem as th

FIBRE_WAIST = 4.8e-6  # m, of the intensity
RADIUS = 62.5e-6  # m, of Wanser's fibre
SLICE = 2e-6  # m of fibre


@pytest.fixture(scope="module")
def strip():
    """The reference strip with its mode; the chip goes on beyond its bottom and side."""
    heat = th.assemble(th.strip_ring().opened())
    return heat.with_light(th.light(heat, wavelength=1.555e-6).mode("TE0"))


@pytest.fixture(scope="module")
def gaussian():
    """A slice of a fibre of glass, heated and read with a Gaussian weight, as a StateSpace of one port."""
    section = th.CrossSection(
        name="fibre",
        outer_radius=RADIUS,
        layers=(th.Layer("low", "SiO2", SLICE / 2, datum=True), th.Layer("high", "SiO2", SLICE / 2)),
        parts=(th.Part("core", "SiO2", 0.0, 1.2 * FIBRE_WAIST, bottom=-SLICE / 2, height=SLICE, heated=True),),
        bottom=th.Boundary("insulated"),
        top=th.Boundary("insulated"),
        outer=th.Boundary("isothermal"),
    )
    heat = th.assemble(section, accuracy=1e-4)

    @skfem.LinearForm
    def weight(v, w):
        r = w.x[0]
        intensity = 2 / (np.pi * FIBRE_WAIST**2) * np.exp(-2 * r**2 / FIBRE_WAIST**2)
        return 2 * np.pi * r * intensity / SLICE * v

    c = weight.assemble(heat.discretization.basis)[heat.discretization.free]
    return th.StateSpace(heat.system.E, heat.system.A, c[:, None], c[None])


def glass():
    """Conductivity and heat capacity of a volume of the fibre's glass."""
    silica = th.materials.find("SiO2")
    return silica.conductivity, silica.density * silica.specific_heat


def test_a_gaussian_in_a_homogeneous_medium_is_the_closed_form(gaussian, validated):
    """Z = e^x E1(x)/(4 pi k) per length, x = s w^2/4 D. At 10 kHz and above the fibre's surface is not felt."""
    k, capacity = glass()
    f = np.array([1e4, 2.5e4, 1e5])
    noise = th.thermal_noise(gaussian, f, temperature=298.0)
    x = 2j * np.pi * f * FIBRE_WAIST**2 * capacity / (4 * k)
    exact = 4 * Boltzmann * 298.0**2 * (np.exp(x) * exp1(x) / (4 * np.pi * k)).real / SLICE
    for frequency, ours, expected in zip(f, noise["S_T"].values, exact, strict=True):
        what = f"density of a Gaussian mode in glass at {frequency:g} Hz"
        source = {"unit": "K^2/Hz", "source": "closed form: 4 k T^2 Re e^x E1(x)/(4 pi k)"}
        validated("Thermal noise", what, ours, expected, rel=2e-4, **source)  # 1e-4 of mesh, and of the reduction
    # equipartition: the Gaussian's own heat capacity, pi w^2 rho c per length, to the integration of its square
    variance = Boltzmann * 298.0**2 / (np.pi * FIBRE_WAIST**2 * capacity * SLICE)
    assert noise.attrs["variance"] == pytest.approx(variance, rel=1e-8, abs=0)


def test_a_fibre_has_the_phase_noise_that_wanser_published(gaussian, validated):
    """5.1e-7 and 1.3e-7 rad/sqrt(Hz) at 0 and 25 kHz: 20 + 20 m at 1300 nm; waist and dn/dT + n alpha are assumed."""
    noise = th.thermal_noise(gaussian, [1.0, 2.5e4], temperature=298.0)
    phase = (2 * np.pi / 1.3e-6) * 1.27e-5 * np.sqrt(40.0 * SLICE * noise["S_T"].values)
    for hertz, ours, published in ((0, phase[0], 5.1e-7), (25_000, phase[1], 1.3e-7)):
        what = f"phase noise of 20 + 20 m of fibre at {hertz} Hz"
        source = {"unit": "rad/rtHz", "source": "Wanser, Electron. Lett. 28, 53 (1992)"}
        validated("Thermal noise", what, ours, published, rel=0.1, **source)
    assert phase[1] / phase[0] == pytest.approx(1.3 / 5.1, rel=0.06, abs=0)  # the waist alone


def test_the_bound_holds_against_full_order_solves(strip):
    f = np.array([0.0, 1e3, 3e4, 1e6, 3e7, 1e8])
    noise = th.thermal_noise(strip, f)
    system = strip.channels("core", "light")
    port = th.StateSpace(system.E, system.A, system.C.T, system.C)
    exact = 4 * Boltzmann * noise.attrs["temperature"] ** 2 * port.impedance(f).real
    assert np.all(np.abs(noise["S_T"].values - exact) <= noise["bound"].values)
    assert np.all(noise["bound"] < 1e-4 * noise["S_T"])
    assert noise.attrs["temperature"] == strip.geometry.ambient


def test_the_reference_strip_at_room_temperature(strip):
    """The prototypes' numbers, by sparse solves of other scripts: 412 uK, 3.7 MHz, 3.2e6 Hz^2/Hz at 1 kHz."""
    noise = th.thermal_noise(strip, [1e3], temperature=300.0)
    assert noise.attrs["rms_temperature"] == pytest.approx(412e-6, abs=0.5e-6)
    assert noise.attrs["rms_frequency"] == pytest.approx(3.7e6, abs=0.05e6)
    assert noise["S_nu"].values == pytest.approx([3.2e6], abs=0.05e6)
    core = th.thermal_noise(strip, [1e3], read="core", temperature=300.0)
    assert "S_nu" not in core
    assert core.attrs["variance"] != noise.attrs["variance"]


def test_the_exported_deck_has_the_same_noise_in_ngspice(tmp_path, validated):
    """A resistor's noise voltage at 26.85 C, 4 k T Re Z, times sqrt(T): the deck's R and C hold 17 digits."""
    program = shutil.which("ngspice") or pytest.skip("ngspice is not installed")
    rom = surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3)
    surrogate.export_model(rom, tmp_path / "heat.cir")
    deck = """* bench
.include heat.cir
X1 pin 0 heat
I1 0 pin DC 0 AC 1
.temp 26.85
.control
set numdgt=12
set wr_singlescale
noise v(pin) I1 dec 1 100 1e8
setplot noise1
wrdata out.txt onoise_spectrum
quit
.endc
.end
"""
    (tmp_path / "bench.cir").write_text(deck)
    subprocess.run([program, "-b", "bench.cir"], cwd=tmp_path, capture_output=True, check=True, timeout=60)
    f, density = np.loadtxt(tmp_path / "out.txt").T
    noise = th.thermal_noise(rom, f, temperature=300.0)
    # ngspice has the constant of Boltzmann of 2014 and 273.15 K: 1e-6 in all
    assert np.sqrt(noise["S_T"].values) == pytest.approx(density * np.sqrt(300.0), rel=2e-6, abs=0)
    # a printed run of ngspice 39, without ngspice at hand
    printed = [1.141471e-8, 1.106579e-8, 8.588419e-9, 5.780017e-9, 2.709290e-9, 7.945778e-10]
    found = th.thermal_noise(rom, [1e2, 1e4, 1e5, 1e6, 1e7, 1e8], temperature=300.0)
    for f, ours, theirs in zip(found["frequency"].values, np.sqrt(found["S_T"].values), printed, strict=True):
        spice = {"unit": "K/rtHz", "source": "independent: ngspice .noise of the exported deck"}
        validated("Thermal noise", f"reference strip at {f:g} Hz", ours, theirs * np.sqrt(300.0), rel=2e-6, **spice)


NETWORK = th.Foster(R=[100.0, 2000.0, 5000.0], tau=[5e-9, 60e-9, 1e-6])
RING = coupled.borghi2021()


def integral(model):
    """The integral of S_T over all frequencies at 300 K, in log f, in which the trapezoidal rule converges fast."""
    f = np.geomspace(1e-1, 1e15, 8001)
    return np.trapezoid(f * th.thermal_noise(model, f, temperature=300.0)["S_T"].values, np.log(f))


def test_equipartition_of_a_network():
    """The tails beyond .1 Hz and 1e15 Hz hold 1e-6 and 1e-7 of the variance."""
    noise = th.thermal_noise(NETWORK, [0.0], temperature=300.0)
    assert noise.attrs["variance"] == pytest.approx(Boltzmann * 9e4 * NETWORK.gain.sum(), rel=1e-14, abs=0)
    assert integral(NETWORK) == pytest.approx(noise.attrs["variance"], rel=3e-6, abs=0)


def test_light_changes_the_noise_by_its_feedback():
    """One slow pole and fast light: S = 4 k T^2 R/|1 + s tau - R b|^2 with b = dP_abs/dT; the variance /(1 - R b)."""
    tau = 1e-3
    model = th.Foster(R=[1000.0], tau=[tau])
    linear = coupled.linearize(RING, model, power=1e-3, detuning=-5e9)
    loop = 1000.0 / linear.thermal_resistance
    f = np.array([0.0, 100.0, 1000.0])
    noise = th.thermal_noise(linear, f, temperature=300.0)
    exact = 4 * Boltzmann * 9e4 * 1000.0 / np.abs(loop + 2j * np.pi * f * tau) ** 2
    assert noise["S_T"].values == pytest.approx(exact, rel=1e-4, abs=0)
    assert noise.attrs["variance"] == pytest.approx(Boltzmann * 9e4 * 1000.0 / tau / loop, rel=1e-4, abs=0)
    assert noise["S_nu"].values == pytest.approx(
        noise["S_T"].values * (RING.thermal_shift / (2 * np.pi)) ** 2, rel=1e-14, abs=0
    )


def test_equipartition_holds_for_the_integral_of_the_linear_ring():
    linear = coupled.linearize(RING, NETWORK, power=1e-3, detuning=-5e9)
    noise = th.thermal_noise(linear, [0.0], temperature=300.0)
    assert integral(linear) == pytest.approx(noise.attrs["variance"], rel=3e-6, abs=0)


@pytest.mark.parametrize("circuit", [RING, coupled.bus([RING, RING])], ids=["ring", "circuit"])
def test_without_light_the_linear_ring_has_the_noise_of_its_heat(circuit):
    """At 1 nW the feedback is 1e-6 of the heat."""
    power = 1e-9 if circuit is RING else {"in": 1e-9}
    linear = coupled.linearize(circuit, NETWORK, power=power, detuning=-5e9)
    f = np.array([0.0, 1e4, 1e6, 1e8])
    noise = th.thermal_noise(linear, f)
    assert noise["S_T"].values == pytest.approx(th.thermal_noise(NETWORK, f)["S_T"].values, rel=3e-6, abs=0)
    assert noise.attrs["variance"] == pytest.approx(th.thermal_noise(NETWORK, f).attrs["variance"], rel=3e-6, abs=0)


def test_systems_and_reductions_agree_with_the_network():
    f = np.array([0.0, 1e5, 1e7])
    expected = th.thermal_noise(NETWORK, f)
    root = np.sqrt(NETWORK.gain)
    rate = 1 / np.asarray(NETWORK.tau)
    several = np.column_stack([root, 0.1 * root])
    system = th.StateSpace(np.eye(3), -np.diag(rate), several, several.T, ("core", "heater"), ("core", "heater"))
    noise = th.thermal_noise(system, f, read="core")
    assert noise["S_T"].values == pytest.approx(expected["S_T"].values, rel=1e-12, abs=0)
    linear = coupled.linearize(RING, system, power=1e-9, heated="core")
    heater = th.thermal_noise(linear, f, read="heater")
    assert heater["S_T"].values == pytest.approx(0.01 * expected["S_T"].values, rel=3e-6, abs=0)


def test_the_bound_of_a_reduction_is_its_own(strip):
    rom = surrogate.reduce(strip.system, tolerance=1e-3)
    noise = th.thermal_noise(rom, [0.0, 1e6], read="core")
    bound = rom.channel_bounds[0, 0] * float(noise["S_T"][0])
    assert noise["bound"].values == pytest.approx([bound, bound], rel=1e-9, abs=0)
    full = th.thermal_noise(strip, [0.0, 1e6], read="core", temperature=300.0)
    assert np.all(np.abs(noise["S_T"] - full["S_T"]) <= noise["bound"] + full["bound"])


def test_a_reduction_reads_its_light_with_the_same_weight_for_the_heat(strip):
    """Its ports are core and light, so its space holds both; the bound of light to light is not known."""
    rom = surrogate.reduce(strip.channels("core", ("core", "light")), tolerance=1e-5)
    f = np.array([0.0, 1e5, 1e7])
    noise = th.thermal_noise(rom, f, temperature=300.0)
    full = th.thermal_noise(strip, f, temperature=300.0)
    assert noise["S_T"].values == pytest.approx(full["S_T"].values, rel=1e-4, abs=0)  # of the full one's space
    assert np.all(np.isnan(noise["bound"]))
    # the made ring reads "light", and its linear answer without light has that noise
    ring = coupled.ring_from(strip.geometry, wavelength=1.555e-6, loss=161.0, gap=250e-9).ring
    assert ring.read == "light"
    linear = coupled.linearize(ring, rom, power=1e-9, detuning=-5e9)
    assert th.thermal_noise(linear, f, temperature=300.0)["S_T"].values == pytest.approx(
        noise["S_T"].values, rel=1e-5, abs=0
    )


UNSTABLE = {"power": 5e-3, "detuning": -32e9, "branch": 1}


@pytest.mark.parametrize(
    ("heat", "change", "said"),
    [
        (NETWORK, {"frequencies": [-1.0, 1.0]}, "frequencies"),
        (NETWORK, {"frequencies": [np.nan]}, "frequencies"),
        (NETWORK, {"frequencies": [2.0, 1.0]}, "frequencies"),
        (NETWORK, {"read": "heater"}, "read"),
        (NETWORK, {"temperature": 0.0}, "absolute"),
        (th.Foster(R=[1.0], tau=[1e-6], outputs=("heater",)), {}, "one port"),
        (th.Foster(R=[2.0, -1.0], tau=[1e-6, 1e-7]), {}, "one port"),
        (th.OutputMap(NETWORK, 1e-3), {}, "HeatProblem"),
        ("strip", {}, "HeatProblem"),
    ],
)
def test_bad_input_is_named(heat, change, said):
    with pytest.raises(th.InputError, match=said):
        th.thermal_noise(heat, **{"frequencies": [1e3]} | change)


def test_a_heat_problem_without_light_says_how_to_get_it(strip):
    with pytest.raises(th.InputError, match="with_light"):
        th.thermal_noise(th.assemble(th.strip_ring()), [1e3])
    with pytest.raises(th.InputError, match="read"):
        th.thermal_noise(strip, [1e3], read="lamp")


def test_an_unstable_ring_and_one_of_unknown_forces_are_refused():
    second = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
    with pytest.raises(th.InputError, match="unstable"):
        th.thermal_noise(coupled.linearize(RING, second, **UNSTABLE), [1e3])
    transfer = th.Foster(R=[7000.0], tau=[1e-6], outputs=("light",))
    with pytest.raises(th.InputError, match="not known"):
        th.thermal_noise(coupled.linearize(RING, transfer, power=1e-4), [1e3])
