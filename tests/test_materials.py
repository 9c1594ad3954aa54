import pytest

from thermofem.checks import InputError
from thermofem.materials import LIBRARY, Material, find


def test_the_library_holds_the_reference_stack():
    silicon, oxide = find("Si"), find("SiO2")
    assert (silicon.conductivity, silicon.density, silicon.specific_heat) == (130, 2330, 700)
    assert (oxide.conductivity, oxide.density, oxide.specific_heat) == (1.38, 2203, 703)
    assert {"air", "void", "TiN", "Al", "Si3N4"} <= LIBRARY.keys()


@pytest.mark.parametrize("name", LIBRARY)
def test_every_material_says_where_its_numbers_come_from(name):
    material = LIBRARY[name]
    assert material.name == name
    assert len(material.source) > 20
    if name not in ("air", "void"):  # solids: Dulong and Petit, 3 R per mole of atoms, caps rho c_p near 4e6 J/m^3/K
        assert 1e6 < material.heat_capacity < 4e6


def test_diffusivity():
    # 130 / (2330 * 700), by hand
    assert find("Si").diffusivity == pytest.approx(7.9706e-5, rel=1e-4)


def test_overrides_come_first():
    mine = Material("Si", conductivity=60.0, density=2330.0, specific_heat=700.0)
    assert find("Si", [mine]) is mine
    assert find("SiO2", [mine]) is LIBRARY["SiO2"]


def test_an_unknown_material_suggests_the_nearest():
    with pytest.raises(InputError, match=r"layer 'box': material = 'Si02' is unknown; did you mean 'SiO2'"):
        find("Si02", what="layer 'box': material")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"conductivity": 0.0}, "conductivity = 0"),
        ({"conductivity": float("nan")}, "conductivity = nan is not finite"),
        ({"density": 2.33}, None),
        ({"density": -2330.0}, "density = -2330"),
        ({"density": 2.33e6}, "density"),
        ({"specific_heat": 0.7}, "specific_heat = 0.7"),
        ({"exponent": 1000.0}, "exponent"),
        ({"reference": 0.0}, "reference"),
    ],
)
def test_values_no_material_has_are_refused(change, words):
    good = {"conductivity": 130.0, "density": 2330.0, "specific_heat": 700.0}
    if words is None:  # 2.33 kg/m^3 is a gas: a legal value
        assert Material("x", **(good | change)).density == 2.33
        return
    with pytest.raises(InputError, match="material 'x'") as error:
        Material("x", **(good | change))
    assert words in str(error.value)


def test_void_has_no_properties():
    with pytest.raises(InputError, match="void"):
        Material("void", conductivity=1.0, density=1.0, specific_heat=1.0)
