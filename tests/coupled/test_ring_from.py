"""A ring from its cross-section, against the paper's table and the rates that follow by hand."""

import math
from dataclasses import replace

import pytest
from scipy.constants import c

import coupled
import surrogate
import thermofem as th
from coupled.cycles.derivatives import cycle_derivatives
from coupled.ring_from import chain
from coupled.thermal import check_geometry
from surrogate.reduction.reduce import pole_derivatives
from thermofem.fem.assembly import on_mesh
from thermofem.mesh.mesh_motion import Motion


def nitride():
    geometry = th.strip_ring(radius=20e-6, width=1e-6, height=0.4e-6, box=4e-6, cladding=4e-6)
    return replace(geometry, parts=(replace(geometry.parts[0], material="Si3N4"),))


@pytest.fixture(scope="module")
def made():
    """The racetrack of Borghi et al. 2021: bends of 7 um, straights of 3 um, gaps of 250 nm, 7 dB/cm."""
    return coupled.ring_from(th.strip_ring(), wavelength=1.555e-6, loss=161.0, gap=250e-9, straight=3e-6, buses=2)


def test_the_fem_column_of_the_paper(made):
    assert made.ring.tpa_volume == pytest.approx(5.35e-18, rel=0.01, abs=0)
    assert made.ring.fca_volume == pytest.approx(4.87e-18, rel=0.002, abs=0)
    assert made.ring.tpa_confinement == pytest.approx(0.992, abs=1e-3)
    assert made.ring.fca_confinement == pytest.approx(0.999, abs=5e-4)


def test_rates_of_the_guide_and_of_the_bus(made):
    speed = c / made.mode.n_g
    assert made.ring.loss_rate == pytest.approx(161 * speed / 2, rel=1e-12)
    kappa = 1 - math.exp(-made.ring.bus_rate * 2 * 49.982e-6 / speed)
    assert kappa == pytest.approx(0.0523, rel=0.02)  # an independent code, 1 %
    assert made.ring.drop_rate == made.ring.bus_rate
    assert "gap" in made.origins["bus_rate"].origin


def test_the_resonance_is_whole_and_nearest(made):
    nu = made.mode.order + (made.ring.frequency - c / 1.555e-6) * made.mode.n_g * made.mode.radius * 2 * math.pi / c
    assert nu == pytest.approx(round(nu), abs=1e-6)
    assert abs(c / made.ring.frequency - 1.555e-6) < 11.3e-9 / 2  # half a free spectral range of n_g 4.29 and 49.98 um


def test_the_shifts_have_the_weight_of_the_mode(made):
    ring = made.ring
    # 4.69443e-5 1/K: NGSolve's integrals for the straight guide; the printed rule has 5.337e-5
    assert ring.thermal_shift / ring.omega == pytest.approx(4.69443e-5, rel=2e-3)
    printed = replace(ring, index_confinement=None)
    assert ring.index_rate / printed.index_rate == pytest.approx(0.2488 / 0.2869 * 3.4773 / 3.485, rel=3e-3)
    assert ring.eta_fca / printed.eta_fca == pytest.approx(1.0677, rel=2e-3)
    assert ring.kerr_shift == printed.kerr_shift


def test_the_energy_closes_under_the_new_rules(made):
    model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    run = coupled.simulate(made.ring, model, power=2e-4, detuning=0.0, duration=50e-6, rtol=1e-8)
    end = run.isel(time=-1)  # at rest: ten time constants have passed, and nothing more is stored
    assert float(end["carriers"]) > 1e19
    assert float(end["drop"] + end["through"] + end["absorbed"]) == pytest.approx(2e-4, rel=1e-5)


def test_a_file_of_it_is_the_same_ring(made):
    again = coupled.RingResonator.from_text(made.to_toml())
    for name in ("frequency", "bus_rate", "index_confinement", "thermo_optic", "tpa_volume", "fcd"):
        assert getattr(again, name) == getattr(made.ring, name)
    assert again.carriers.tau0 == pytest.approx(made.ring.carriers.tau0, rel=1e-9, abs=0)
    assert made.to_toml().count("# computed") >= 9
    assert made.to_toml().count("# base borghi2021") >= 8


def test_every_field_has_an_origin(made):
    fields = set(vars(made.ring)) - {"name", "rates"}
    assert set(made.origins) == fields
    assert all(made.origins[name].value == getattr(made.ring, name) for name in fields)


def test_nitride_has_no_carriers():
    made = coupled.ring_from(nitride(), wavelength=1.55e-6, loss="0.5 dB/cm", coupling=0.01, buses=1)
    assert made.ring.g_tpa == 0.0
    assert made.ring.kerr_shift > 0
    assert made.ring.drop_bus_rate == 0.0
    assert made.ring.bus_rate == pytest.approx(-c / made.mode.n_g / (4 * math.pi * 20e-6) * math.log(0.99))
    again = coupled.RingResonator.from_text(made.to_toml())
    assert again.carriers == made.ring.carriers
    quality = made.ring.omega / (2 * made.ring.scattering_rate)
    assert quality == pytest.approx(4.8e5, rel=0.03)  # an independent code, two digits


def test_a_measured_shift_in_a_ring_file():
    text = 'base = "borghi2021"\nresonance_shift = "75 pm/K"\n'
    ring = coupled.RingResonator.from_text(text)
    wavelength = c / ring.frequency
    assert ring.thermal_shift * wavelength / ring.omega == pytest.approx(75e-12, rel=1e-12, abs=0)
    same = coupled.RingResonator.from_text(text.replace("75 pm/K", "9.3 GHz/K"))
    assert same.thermal_shift == pytest.approx(2 * math.pi * 9.3e9, rel=1e-12)


def test_an_effective_index_is_asked_about():
    with pytest.raises(th.InputError, match="refractive_index"):
        coupled.RingResonator.from_text('base = "borghi2021"\nrefractive_index = 2.35\n')


def test_a_file_takes_the_rest_from_its_base_in_one_line(caplog):
    coupled.RingResonator.from_text('base = "borghi2021"\nwavelength = "1551 nm"\n')
    (line,) = caplog.messages
    assert "tpa_volume" in line
    assert "frequency" not in line


LIGHT = {"power": 1e-3, "detuning": 0.0}
AXES = {"powers": [1e-3, 2e-3], "detunings": [-1e9, 1e9]}
RESTING = th.Foster(R=[2e3, 2e3], tau=[1e-7, 15e-6])  # has no folds of cycles, which a page takes seconds for
ROUTES = {
    "simulate": lambda ring, model, heat: coupled.simulate(ring, model, **LIGHT, duration=1e-7),
    "simulate a circuit": lambda ring, model, heat: coupled.simulate(
        coupled.bus([ring]), model, power={"in": 1e-3}, duration=1e-8
    ),
    "steady_states": lambda ring, model, heat: coupled.steady_states(ring, model, **LIGHT),
    "transmission": lambda ring, model, heat: coupled.transmission(ring, model, power=1e-3, detuning=(-1e9, 1e9)),
    "stability_map": lambda ring, model, heat: coupled.stability_map(ring, model, **AXES),
    "pulsing_map": lambda ring, model, heat: coupled.pulsing_map(ring, model, **AXES),
    "limit_cycle": lambda ring, model, heat: coupled.limit_cycle(ring, model, power=6.31e-3, detuning=0.0),
    "cosimulate": lambda ring, model, heat: coupled.cosimulate(ring, heat, **LIGHT, duration=1e-8),
    "explore": lambda ring, model, heat: coupled.explore(ring, replace(RESTING, origin=model.origin)),
}


@pytest.fixture(scope="module")
def small():
    """A strip of a fifth of the paper's perimeter, with the paper's heat."""
    heat = th.assemble(th.strip_ring(radius=1.591e-6, outer_radius=20e-6))
    law = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31, heat_capacity=7.63e-12)
    return heat, replace(law, origin={"geometry": heat.geometry.to_toml()})


@pytest.mark.parametrize("route", ROUTES)
def test_a_ring_that_contradicts_its_geometry(route, small, caplog):
    """5.35 um^3 of the paper over 2 pi 1.591 um x 450 nm x 220 nm = 0.9897 um^3."""
    heat, model = small
    found = ROUTES[route](coupled.borghi2021(), model, heat)
    (said,) = (line for line in caplog.messages if "tpa_volume" in line)
    assert "5.41 times" in said
    if route not in ("simulate a circuit", "explore"):
        assert found.attrs["warning"] == said


@pytest.mark.parametrize("route", ROUTES)
def test_a_silicon_ring_over_another_core(route, small):
    heat, model = small
    section = nitride()
    other = replace(model, origin={"geometry": section.to_toml()})
    with pytest.raises(th.InputError, match="silicon"):
        ROUTES[route](coupled.borghi2021(), other, replace(heat, geometry=section))


def test_the_papers_ring_agrees_with_the_papers_strip(caplog):
    model = th.Foster(R=[1e4], tau=[1e-6], origin={"geometry": th.strip_ring().to_toml()})
    assert check_geometry(coupled.borghi2021(), model) == {}
    assert not caplog.messages


def test_python_lists_what_a_base_gives_too(caplog):
    coupled.RingResonator.from_quality_factors(
        coupled.borghi2021(), name="rib", frequency=193e12, loaded_q=1e4, intrinsic_q=1e5
    )
    (line,) = caplog.messages
    assert "carriers" in line
    assert "bus_rate" not in line


def neighbour(heat, path, value):
    """The same mesh with its vertices moved to another geometry."""
    other = heat.geometry.with_({path: value})
    return on_mesh(other, replace(heat.mesh, points=Motion(heat.mesh, heat.geometry).moved(other)), 1e-3)


@pytest.mark.parametrize(
    ("path", "value", "step"), [("part.core.width", 450e-9, 5e-11), ("part.core.radius", 8.0e-6, 1e-9)]
)
def test_derivatives_of_the_ring(path, value, step):
    """Against rings of modes solved anew on meshes whose vertices moved, at the order of the resonance."""
    heat, given = th.assemble(th.strip_ring(radius=8e-6)), {"wavelength": 1.555e-6, "loss": 161.0, "coupling": 0.05}
    d = coupled.ring_from(heat, **given).derivatives([path])
    ends = [coupled.ring_from(neighbour(heat, path, value + sign * step), **given).ring for sign in (1, -1)]
    for name in d.data_vars:
        if name.startswith("kappa"):
            continue
        slope = (getattr(ends[0], name) - getattr(ends[1], name)) / (2 * step)
        # a step's square, and round-off of a number over what it changes by
        size = abs(getattr(ends[0], name)) * 1e-12 / step
        assert float(d[name][0]) == pytest.approx(slope, rel=3e-6, abs=size), name


def test_the_period_by_the_width_with_the_optics_moving():
    """d(period)/d(width) through mode, rates, heat and cycle, against the cycles of two moved meshes."""
    heat, given = th.assemble(th.strip_ring(radius=8e-6)), {"wavelength": 1.555e-6, "loss": 161.0, "coupling": 0.063}

    def made_of(problem):
        lit = problem.with_light(th.light(problem, wavelength=1.555e-6).mode())
        return lit, coupled.ring_from(lit, **given), surrogate.reduce(lit.channels("core", "light"), tolerance=1e-4)

    def cycle(problem):
        _, made, rom = made_of(problem)
        return coupled.limit_cycle(made.ring, rom.model, power=6.31e-3).attrs["period"]

    lit, made, rom = made_of(heat)
    of_ring = made.derivatives(["part.core.width"]).isel(parameter=0)
    poles = pole_derivatives(lit, rom, ["part.core.width"]).isel(parameter=0)
    slopes = {name: float(of_ring[name]) for name in of_ring.data_vars}
    slopes |= {f"R{k + 1}": float(poles.R[k]) for k in range(poles.sizes["pole"])}
    slopes |= {f"tau{k + 1}": float(poles.tau[k]) for k in range(poles.sizes["pole"])}
    names = [name for name in slopes if not name.startswith("kappa") and slopes[name]]
    of_cycle = cycle_derivatives(made.ring, rom.model, names, power=6.31e-3)
    step = 2e-10
    ends = [cycle(neighbour(heat, "part.core.width", 450e-9 + sign * step)) for sign in (1, -1)]
    slope = (ends[0] - ends[1]) / (2 * step)
    # poles of two reductions, each within 1e-4 of its mesh, leave some 1e-4
    assert chain(of_cycle, slopes)["period"] == pytest.approx(slope, rel=1e-3)


FILE = """
[light]
wavelength = "1555 nm"
loss = "7 dB/cm"
[[bus]]
gap = "250 nm"
straight = "3 um"
"""


def test_a_geometry_with_light_and_buses_needs_no_arguments(made):
    section = th.CrossSection.from_toml_text(th.strip_ring().to_toml() + FILE)
    own = coupled.ring_from(section)
    assert own.ring.bus_rate == pytest.approx(made.ring.bus_rate, rel=1e-9)
    assert own.ring.drop_rate == 0.0  # one [[bus]]
    assert own.ring.loss_rate == pytest.approx(made.ring.loss_rate, rel=2e-3)  # 7 dB/cm are 161.2 1/m
    wider = coupled.ring_from(section.with_({"bus.bus.gap": 300e-9}))
    d = own.derivatives(["bus.bus.gap", "light.loss"])
    assert float(d.kappa_0[0]) / 0.0524 == pytest.approx(-1.6e7, rel=0.02)  # an independent code: -1.6 % per nm
    assert wider.ring.bus_rate / own.ring.bus_rate == pytest.approx(math.exp(-1.6e7 * 5e-8), rel=0.05)
    assert float(d.loss_rate[1]) == pytest.approx(c / own.mode.n_g / 2, rel=1e-9)


def test_two_buses_have_rates_of_their_own():
    text = th.strip_ring().to_toml() + FILE + '[[bus]]\ngap = "300 nm"\nstraight = "3 um"\n'
    ring = coupled.ring_from(th.CrossSection.from_toml_text(text)).ring
    assert 0.4 < ring.drop_rate / ring.bus_rate < 0.5  # exp(-1.6 % nm 50) = 0.45
