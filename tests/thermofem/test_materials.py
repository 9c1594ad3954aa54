import re

import pytest
from scipy.integrate import quad

from thermofem.checks import InputError
from thermofem.materials import Polynomial, PowerLaw, Table
from thermofem.materials.material_library import LIBRARY, Material, find, silicon_film


def test_the_library_holds_the_reference_stack():
    silicon, oxide = find("Si"), find("SiO2")
    assert (silicon.conductivity, silicon.density, silicon.specific_heat) == (130, 2330, 700)
    assert (oxide.conductivity, oxide.density, oxide.specific_heat) == (1.38, 2203, 703)
    assert {"air", "void", "TiN", "Al", "Si3N4"} <= LIBRARY.keys()
    assert silicon.diffusivity == pytest.approx(7.9706e-5, rel=1e-4)  # 130 / (2330 * 700), by hand


@pytest.mark.parametrize("name", LIBRARY)
def test_every_material_says_where_its_numbers_come_from(name):
    material = LIBRARY[name]
    assert material.name == name
    assert len(material.source) > 20
    # a publication with the value in it, or plainly a typical value with its range
    published = re.search(r"\(\d{4}\)|Incropera|COMSOL", material.source)
    assert name == "void" or published or re.search(r"typical values.* (range|to) ", material.source)
    if name not in ("air", "void"):  # solids: Dulong and Petit, 3 R per mole of atoms, caps rho c_p near 4e6 J/m^3/K
        assert 1e6 < material.heat_capacity < 4e6


def test_an_unknown_material_suggests_the_nearest():
    with pytest.raises(InputError, match=r"layer 'box': material = 'Si02' is unknown; did you mean 'SiO2'"):
        find("Si02", what="layer 'box': material")


@pytest.mark.parametrize(
    "change",
    [
        {"conductivity": 0.0},
        {"conductivity": float("nan")},
        {"density": 2.33e6},
        {"specific_heat": 0.7},
        {"conductivity_z": 0.0},
    ],
)
def test_values_no_material_has_are_refused(change):
    good = {"conductivity": 130.0, "density": 2330.0, "specific_heat": 700.0}
    with pytest.raises(InputError, match=f"material 'x': {next(iter(change))} = "):
        Material("x", **(good | change))


def test_thin_films_conduct_less():
    # published: 22 W/m/K at 20 nm (Liu and Asheghi 2004); about half of bulk at 100 nm (Ju and Goodson 1999)
    assert silicon_film(20e-9).conductivity == pytest.approx(22, rel=0.05)
    assert silicon_film(100e-9).conductivity == pytest.approx(148 / 2, rel=0.1)
    assert silicon_film(1e-3).conductivity == pytest.approx(148, rel=1e-3)
    assert find("Si 220 nm") == silicon_film(220e-9)
    # k = k_bulk/(1 + 3 L/(8 d)) at every T, with the mean free path L proportional to k_bulk ~ T^-1.3
    for thickness in (20e-9, 220e-9, 1e-3):
        film, bulk = silicon_film(thickness), 1.0001**-1.3
        warmer = 148 * bulk / (1 + 3 * 300e-9 * bulk / (8 * thickness))
        change = float(film.conductivity_law.factor(300.03)) - 1
        assert change == pytest.approx(warmer / film.conductivity - 1, rel=2e-4)  # 1e-4 in T, and its square


def test_laws_of_temperature_are_those_of_the_tables():
    """Rows of Incropera's tables A.1 (silicon) and A.2 (silicon dioxide, fused silica), typed a second time."""
    printed = {
        "Si(T)": [(200, 264, 556), (300, 148, 712), (400, 98.9, 790), (600, 61.9, 867), (800, 42.2, 913)],
        "SiO2(T)": [(300, 1.38, 745), (400, 1.51, 905), (600, 1.75, 1040), (800, 2.17, 1105)],
    }
    for name, rows in printed.items():
        material = find(name)
        for T, k, c in rows:
            assert material.conductivity * float(material.conductivity_law.factor(T)) == pytest.approx(k, rel=1e-12)
            assert material.specific_heat * float(material.specific_heat_law.factor(T)) == pytest.approx(c, rel=1e-12)


@pytest.mark.parametrize(
    "law",
    [
        PowerLaw(-1.3),
        PowerLaw(-1.0, 350.0),
        Polynomial((1e-3, -2e-6, 1e-9)),
        Table((250, 300, 350, 500), (3.0, 2.0, 1.5, 1.2)),
    ],
    ids=lambda law: type(law).__name__,
)
def test_a_law_is_one_at_its_reference_and_its_integral_is_its_integral(law):
    assert law.factor(law.reference) == pytest.approx(1, rel=1e-14)
    for start, rise in ((293.15, 150.0), (293.15, -30.0), (400.0, 200.0)):
        expected = quad(law.factor, start, start + rise, points=[300, 350, 500] if rise > 0 else None, epsabs=1e-12)[0]
        assert law.integral(start, rise) == pytest.approx(expected, rel=1e-9)  # quad's own error
    # small rises do not cancel away: integral -> factor * rise, next term 1e-6 K * |f'|/2 < 1e-8
    tiny = 1e-6 if isinstance(law, PowerLaw) else 1e-3
    assert law.integral(310.0, tiny) == pytest.approx(float(law.factor(310.0)) * tiny, rel=2e-5)


def test_a_table_is_held_beyond_its_ends():
    law = Table((250, 300, 350), (3.0, 2.0, 1.5))
    assert law.factor([100, 250, 350, 900]) == pytest.approx([1.5, 1.5, 0.75, 0.75], rel=1e-14)


@pytest.mark.parametrize("law", [PowerLaw(0.5, 4.0), Table((1, 2, 4), (1.0, 2.0, 3.0), 4.0)])
def test_a_law_is_held_below_1_k(law):
    """An iteration may ask there; no integral of a power law ends at 1 K, and no table goes on as a parabola."""
    assert law.factor([0.2, 0.7]) == pytest.approx(float(law.factor(1.0)), rel=1e-14)
    slope = (law.integral(4.0, -3.2) - law.integral(4.0, -3.4)) / 0.2
    assert slope == pytest.approx(float(law.factor(1.0)), rel=1e-12)


def test_laws_no_material_has():
    for bad in (lambda: PowerLaw(1000.0), lambda: PowerLaw(-1.3, 0.0), lambda: Table((300, 300), (1, 1))):
        with pytest.raises(InputError):
            bad()
