"""What limits a mode on each side, and what guides: slabs in closed form, one core drawn once, finite differences."""

import logging
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import brentq
from scipy.sparse.linalg import eigsh

import coupled
import thermofem as th
from thermofem.optics.surroundings import slab_index

K0 = 2 * math.pi / 1.55e-6
STACK = """{kind}
layer = [{{name = "substrate", material = "{wafer}", thickness = "20 um"}},
         {{name = "box", material = "{box}", thickness = "{depth} um", datum = true}},
         {{name = "cladding", material = "{box}", thickness = "{depth} um"}}]
"""
RING = 'outer_radius = "60 um"'
STRAIGHT = 'kind = "straight"\nlength = "100 um"\nhalf_width = "20 um"'
PART = """[[part]]
name = "{name}"
material = "{material}"
{place}
bottom = "{bottom} nm"
height = "{height} nm"
heated = true
"""
OWN = """[material.{name}]
conductivity = "130 W/m/K"
density = "2330 kg/m^3"
specific_heat = "700 J/kg/K"
index = {index}
"""


def stack(kind, *, wafer="Si", box="SiO2", depth=2):
    return STACK.format(kind=kind, wafer=wafer, box=box, depth=depth)


def part(place, name="core", material="Si", bottom=0, height=220):
    return PART.format(place=place, name=name, material=material, bottom=bottom, height=height)


def own(name, index, thermo_optic=None):
    slope = "" if thermo_optic is None else f'thermo_optic = "{thermo_optic} 1/K"\n'
    return OWN.format(name=name, index=index) + slope


def section(*texts):
    return th.CrossSection.from_toml_text("".join(texts))


def closed_form(core, clad, thickness):
    """TE0 of a symmetric slab: tan(k d/2) = gamma/k."""

    def mismatch(n):
        return math.tan(K0 * math.sqrt(core**2 - n**2) * thickness / 2) - math.sqrt((n**2 - clad**2) / (core**2 - n**2))

    low = math.sqrt(max(core**2 - (math.pi / (K0 * thickness)) ** 2, clad**2)) + 1e-9
    return brentq(mismatch, low, core - 1e-9, xtol=1e-14)


@pytest.mark.parametrize(
    ("core", "clad", "thickness"), [(3.478, 1.444, 220e-9), (1.996, 1.444, 1e-7), (1.455, 1.444, 6e-6)]
)
def test_a_slab_in_closed_form(core, clad, thickness):
    expected = closed_form(core, clad, thickness)
    # sixty halvings leave round-off of n^2 - n_s^2, some 1e-15/(n^2 - n_s^2)
    assert slab_index([1.0, thickness, 1.0], [clad, core, clad], K0) == pytest.approx(expected, abs=1e-9)
    halves = slab_index([1.0, thickness / 2, thickness / 2, 1.0], [clad, core, core, clad], K0)
    assert halves == pytest.approx(expected, abs=1e-9)


def test_a_stack_of_three_films_by_finite_differences():
    thickness, index = [0.1e-6, 0.4e-6, 0.2e-6], [2.0, 1.444, 3.0]
    h = 2e-9
    z = np.arange(-2e-6, 2.7e-6, h)
    n = np.full(z.size, 1.444)
    start = 0.0
    for d, layer in zip(thickness, index, strict=True):
        n[(z >= start) & (z < start + d)] = layer
        start += d
    main = -2 / h**2 + (K0 * n) ** 2
    matrix = sp.diags([np.full(z.size - 1, 1 / h**2), main, np.full(z.size - 1, 1 / h**2)], [-1, 0, 1])
    expected = math.sqrt(eigsh(matrix.tocsc(), k=1, sigma=(K0 * 3.0) ** 2)[0][0]) / K0
    found = slab_index([1.0, *thickness, 1.0], [1.444, *index, 1.444], K0)
    assert found == pytest.approx(expected, abs=5e-3)  # a wall lies within half a step of 2 nm, dn_s/dd is 1.5 per um


CORES = {
    "one": part('radius = "8 um"\nwidth = "500 nm"'),
    "halves": part('inner_radius = "7.75 um"\nouter_radius = "8 um"', material="p-Si")
    + part('inner_radius = "8 um"\nouter_radius = "8.25 um"', name="n", material="n-Si"),
    "layers": part('radius = "8 um"\nwidth = "500 nm"', material="p-Si", height=110)
    + part('radius = "8 um"\nwidth = "500 nm"', name="n", material="n-Si", bottom=110, height=110),
}
SILICON = '"Si, Salzberg 1957"'
DOPED = own("p-Si", SILICON, 1.86e-4) + own("n-Si", SILICON, 1.86e-4)


def test_a_core_drawn_in_two_materials_is_one_core():
    """The same silicon drawn once, as two halves and as two layers: other meshes, within 2e-4 each."""
    rings = {}
    for name, core in CORES.items():
        geometry = section(stack(RING), core, DOPED if name != "one" else "")
        made = coupled.ring_from(geometry, wavelength=1.55e-6, loss=46.0, coupling=0.05, spread_carriers=True)
        rings[name] = made.ring
        assert made.mode.radius == pytest.approx(8e-6)
    for name in ("halves", "layers"):
        for field in ("index_confinement", "tpa_confinement", "tpa_volume", "fca_volume", "thermo_optic", "bus_rate"):
            assert getattr(rings[name], field) == pytest.approx(getattr(rings["one"], field), rel=5e-4, abs=0), (
                name,
                field,
            )


def test_a_wafer_of_less_index_than_the_core_is_no_cladding():
    """Over a wafer of silicon as over one of oxide, 2 um away; by full-vector differences TE0 is 2.465, TM0 1.797."""
    found = {}
    for wafer in ("Si", "SiO2"):
        geometry = section(
            stack(RING, wafer=wafer), part('radius = "8 um"\nwidth = "450 nm"', material="a-Si"), own("a-Si", 3.58)
        )
        found[wafer] = {mode.name: mode.n_eff for mode in th.light(geometry, wavelength=1.55e-6).modes}
    assert found["Si"]["TE0"] == pytest.approx(2.465, abs=2e-3)
    assert found["Si"]["TM0"] == pytest.approx(1.797, abs=2e-3)
    assert found["Si"]["TE0"] == pytest.approx(found["SiO2"]["TE0"], abs=2e-5)


def test_a_film_far_away_hides_no_mode():
    film = ', {name = "film", material = "Si3N4", thickness = "400 nm"}]\n'
    core = part('radius = "8 um"\nwidth = "450 nm"')
    without = th.light(section(stack(RING), core), wavelength=1.55e-6)
    under = th.light(section(stack(RING).rstrip()[:-1], film, core), wavelength=1.55e-6)
    for name in ("TE0", "TM0"):
        assert under.mode(name).n_eff == pytest.approx(without.mode(name).n_eff, abs=5e-4)
    assert under.surroundings.continuum == pytest.approx(1.712, abs=2e-3)  # the film on oxide under air, TE0


def test_two_rails_are_one_guide():
    """Two rails, and one core with a slot cut into it: one geometry drawn in two ways."""
    rails = part('x = "-0.15 um"\nwidth = "220 nm"') + part('x = "0.15 um"\nwidth = "220 nm"', name="right")
    cut = part('x = "0 um"\nwidth = "520 nm"') + part('x = "0 um"\nwidth = "80 nm"', name="slot", material="SiO2")
    found = []
    for core in (rails, cut):
        light = th.light(section(stack(STRAIGHT), core), wavelength=1.55e-6)
        found.append([mode.n_eff for mode in light.modes])
        assert light.names == ("TE0", "TM0")
    assert found[0] == pytest.approx(found[1], abs=2e-4)
    assert found[0][0] == pytest.approx(1.774, abs=3e-3)  # full-vector differences: 1.7789 and 1.7750 at 20 and 10 nm


def test_thin_nitride_guides():
    """A film of 100 nm has n_s = 1.490; a guide of 2.8 um has an index between that and the oxide's."""
    core = part('x = "0 um"\nwidth = "2.8 um"', material="Si3N4", height=100)
    mode = th.light(section(stack(STRAIGHT, depth=8), core), wavelength=1.55e-6).mode("TE0")
    film = closed_form(1.99628, 1.4440236, 1e-7)
    # effective index method: the film's index over the width, TM-like sideways, where the contrast is small
    assert mode.n_eff == pytest.approx(closed_form(film, 1.4440236, 2.8e-6), abs=3e-3)


def test_a_weakly_guided_core():
    """Claddings within 1 % of the core: a scalar mode by finite differences on 24 by 19 um with zero walls."""
    core = part('x = "0 um"\nwidth = "3 um"', material="Alloy", height=2000)
    geometry = section(stack(STRAIGHT, box="Under", depth=12), core, own("Under", 3.30), own("Alloy", 3.325))
    light = th.light(geometry, wavelength=1.55e-6)
    assert min(mode.n_eff for mode in light.modes) > 3.30
    h = 0.125
    x = np.arange(-12 + h, 12, h)
    y = np.arange(-9.5 + h, 9.5, h)
    inside = np.clip((1.5 + h / 2 - abs(x)) / h, 0, 1)[:, None] * np.clip((1 + h / 2 - abs(y)) / h, 0, 1)[None]
    second = [sp.diags([1.0, -2.0, 1.0], [-1, 0, 1], shape=(k, k)) / h**2 for k in (x.size, y.size)]
    k0 = K0 * 1e-6
    matrix = sp.kronsum(second[1], second[0]) + sp.diags(k0**2 * (3.3**2 + (3.325**2 - 3.3**2) * inside).ravel())
    expected = math.sqrt(eigsh(matrix.tocsc(), k=1, sigma=(k0 * 3.32) ** 2)[0][0]) / k0
    # scalar: the contrast squared, 6e-5; the step of the differences: less
    assert light.mode("TE0").n_eff == pytest.approx(expected, abs=2e-4)


def test_a_bend_of_weak_contrast_is_refused():
    """Marcuse's bent slab radiates with Q of some 1e2 here; nothing holds the mode."""
    core = part('radius = "300 um"\nwidth = "6 um"', material="Ge", height=6000)
    geometry = section(
        stack('outer_radius = "400 um"', box="Under", depth=15), core, own("Under", 1.444), own("Ge", 1.4549)
    )
    with pytest.raises(th.InputError, match="radius"):
        coupled.ring_from(replace(geometry), wavelength=1.55e-6, loss=2.3, coupling=0.05, buses=1)


def test_the_leak_into_the_substrate_is_a_loss():
    """TM0 over 1 um of oxide: 20.1 dB/cm are 463 1/m of power, an amplitude rate of 463 v_g/2."""
    geometry = th.strip_ring(radius=8e-6, box=1e-6)
    made = coupled.ring_from(geometry, wavelength=1.55e-6, loss=46.0, coupling=0.05, buses=1, mode="TM0")
    alpha = made.mode.substrate_loss * 100 * math.log(10) / 10
    assert made.mode.substrate_loss == pytest.approx(20.1, rel=0.03)
    expected = made.mode.radiation_rate + alpha * 299792458 / made.mode.n_g / 2
    assert made.ring.scattering_rate == pytest.approx(expected, rel=1e-9)
    assert "leak" in made.origins["scattering_rate"].origin


def test_a_missing_thermo_optic_is_asked_for(caplog):
    core = part('radius = "20 um"\nwidth = "1.2 um"', material="LN", height=500)
    given = {"wavelength": 1.55e-6, "loss": 11.5, "coupling": 0.05}
    with pytest.raises(th.InputError, match=r"thermo_optic.*LN"):
        coupled.ring_from(section(stack(RING), core, own("LN", 2.138)), **given)
    made = coupled.ring_from(section(stack(RING), core, own("LN", 2.138, 3.3e-5)), **given)
    mode = made.mode
    # sum over materials: G_i (dn/dT)_i/n_g
    K = (mode.confinement["LN"] * 3.3e-5 + mode.confinement["SiO2"] * 0.95e-5) / mode.n_g
    assert made.ring.shift_per_kelvin == pytest.approx(K * 299792458 / made.ring.frequency, rel=1e-9, abs=0)
    caplog.clear()
    glass = own("glass", 1.444)
    coupled.ring_from(section(stack(RING, box="glass"), core, own("LN", 2.138, 3.3e-5), glass), **given)
    assert any("dn/dT of glass is missing" in line for line in caplog.messages)


def test_zero_thermo_optic_survives_a_file():
    geometry = section(
        stack(RING), part('radius = "20 um"\nwidth = "1.2 um"', material="LN", height=500), own("LN", 2.138, 0.0)
    )
    again = th.CrossSection.from_toml_text(geometry.to_toml())
    assert again == geometry
    assert again.material_of("core").thermo_optic == 0.0


def test_the_ambient_moves_the_resonance():
    """60 K at K = (sum of G_i (dn/dT)_i)/n_g, of the mode between both temperatures; second order is below 1 %."""
    cold = th.light(th.strip_ring(), wavelength=1.55e-6).mode("TE0")
    hot = th.light(replace(th.strip_ring(), ambient=353.15), wavelength=1.55e-6).mode("TE0")
    slope = (cold.thermo_optic * cold.n_g + hot.thermo_optic * hot.n_g) / 2
    assert hot.n_eff - cold.n_eff == pytest.approx(60 * slope, rel=1e-3)


def test_carriers_of_another_temperature_are_said(caplog):
    made = coupled.ring_from(replace(th.strip_ring(), ambient=353.15), wavelength=1.55e-6, loss=46.0, coupling=0.05)
    assert "353.15 K" in made.origins["carriers"].origin
    assert any("room temperature" in line for line in caplog.messages)


@pytest.mark.parametrize(("ambient", "power", "said"), [(300.0, 1e-3, False), (77.0, 1e-3, True), (300.0, 0.3, True)])
def test_laws_beyond_their_tables_are_said(ambient, power, said, caplog):
    caplog.set_level(logging.WARNING)
    text = th.strip_ring().to_toml().replace('"SiO2"', '"SiO2(T)"').replace('"Si"', '"Si(T)"')
    heat = th.assemble(replace(th.CrossSection.from_toml_text(text), ambient=ambient))
    data = th.solve(heat, th.Constant(power), times=[0.0, 5e-6])
    assert ("warning" in data.attrs) == said
    assert any("tables" in line for line in caplog.messages) == said


def test_hybrid_modes_are_said(caplog):
    """A square core over oxide, under oxide: by symmetry both polarisations are one; walls of 84 deg mix them."""
    square = part('x = "0 um"\nwidth = "340 nm"', height=340)
    light = th.light(section(stack(STRAIGHT), square), wavelength=1.55e-6)
    pair = [light.mode(name) for name in light.names[:2]]
    assert pair[0].n_eff == pytest.approx(pair[1].n_eff, abs=2e-4)
    mixed = replace(pair[0], x=(pair[0].x + pair[1].x) / math.sqrt(2))
    assert mixed.hybrid
    caplog.clear()
    mixed.derivatives(["part.core.width"])
    assert any("hybrid" in line for line in caplog.messages)


def test_a_tight_bend_has_no_modes():
    core = part('radius = "2.5 um"\nwidth = "800 nm"', material="Si3N4", height=300)
    light = th.light(section(stack(RING, depth=3), core), wavelength=1.55e-6)
    assert light.modes == ()
    with pytest.raises(th.InputError, match="leaves the core"):
        light.mode("TE0")


def test_a_disc_begins_at_its_first_radial_order():
    """A full disc and one of rim and inside are one disc; n_eff by an independent code."""
    full = part('inner_radius = "0 um"\nouter_radius = "5 um"')
    mode = th.light(section(stack(RING), full), wavelength=1.55e-6).mode("TE0")
    assert mode.n_eff == pytest.approx(2.50522, abs=3e-4)
    assert mode.order == pytest.approx(50.777, abs=5e-3)


def test_silicon_in_the_o_band_asks_for_a_table():
    """The law of silicon begins at 1.36 um. A table that holds one index is that index: two readers of one number."""
    guide = th.strip_ring()
    with pytest.raises(th.InputError, match=r"'Si', the material of 'core'.* give a table for this band: index = \{"):
        th.light(guide, wavelength=1.31e-6)
    text = guide.to_toml().replace('material = "Si"', 'material = "silicon"')
    properties = 'conductivity = "148 W/m/K"\ndensity = "2330 kg/m^3"\nspecific_heat = "700 J/kg/K"\n'
    bands = ('{ wavelength = ["1.26 um", "1.3 um", "1.33 um", "1.36 um"], values = [3.51, 3.51, 3.51, 3.51] }', "3.51")
    found = []
    for index in bands:
        section = th.CrossSection.from_toml_text(f"{text}\n[material.silicon]\n{properties}index = {index}\n")
        found.append(th.light(section, wavelength=1.31e-6).mode("TE0").n_eff)
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    assert 2.4 < found[0] < 3.51
