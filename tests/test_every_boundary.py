"""A kind of boundary is one entry of `Boundary.KINDS`: files, derivatives, domains and families take it from there."""

import numpy as np
import pytest
from scipy.constants import Stefan_Boltzmann as sigma

import thermofem as th
from surrogate.family.parameter_box import Box
from thermofem.campaign import Variation
from thermofem.geometry import geometry_file
from thermofem.geometry.section_parts import BoundaryKind

AREA = np.pi * (10e-6) ** 2  # m^2


def exchanged(emissivity):
    """Radiation at 1000 K, linearised: h = 4 e sigma T^3/(1 - e/2), bent so that h' is not h/e."""
    return 4 * emissivity * sigma * 1000**3 / (1 - emissivity / 2)


@pytest.fixture(autouse=True)
def radiation(monkeypatch):
    monkeypatch.setitem(th.Boundary.KINDS, "radiation", BoundaryKind("", exchanged))
    monkeypatch.setitem(geometry_file._COEFFICIENT, "radiation", "")
    monkeypatch.setitem(geometry_file.UNITS, "radiation", "")


def disc(**sides):
    """A heated disc of silicon, as wide as the domain and as thick as its layer."""
    return th.CrossSection(
        "disc",
        10e-6,
        (th.Layer("base", "Si", 0.5e-6, True),),
        (th.Part("core", "Si", 0.0, 10e-6, -0.5e-6, 0.5e-6, heated=True),),
        **{"bottom": th.Boundary("insulated"), **sides},
    )


def test_a_file_holds_one_kind_a_side():
    geometry = disc(bottom=th.Boundary("radiation", 0.9), top=th.Boundary("convection", 1e4))
    text = geometry.to_toml()
    assert 'radiation = "0.9"' in text
    assert th.CrossSection.from_toml_text(text) == geometry
    for both in ('radiation = "0.9"\nconvection = "1 W/m^2/K"', ""):
        with pytest.raises(th.InputError, match="boundary bottom: give one of convection, radiation"):
            th.CrossSection.from_toml_text(text.replace('radiation = "0.9"', both))
    with pytest.raises(th.InputError, match=r"'boundary\.top' twice"):
        geometry.with_({"boundary.top.radiation": 0.5, "boundary.top.convection": 1e4})


def test_the_derivative_is_that_by_the_coefficient():
    """R_th = 1/(h A) + t/(3 k A), exact, so that dR/de = -h'/(h^2 A)."""
    e, k = 0.9, th.materials.find("Si").conductivity
    heat = th.assemble(disc(top=th.Boundary("radiation", e)))
    h, slope = exchanged(e), exchanged(e) / e / (1 - e / 2)
    # the coefficients of the matrix differ by 1e6: round-off of a side that holds so weakly
    assert heat.thermal_resistance() == pytest.approx((1 / h + 0.5e-6 / (3 * k)) / AREA, rel=1e-6)
    found = th.derivatives(heat, ["boundary.top.radiation"]).thermal_resistance.item()
    assert found == pytest.approx(-slope / h**2 / AREA, rel=1e-6)


def test_a_side_that_exchanges_heat_is_no_cut_of_the_domain():
    side = th.Boundary("radiation", 0.9)
    assert th.assemble(disc(bottom=side, outer=side)).wider is None


def test_members_of_a_family_have_the_exchange_of_their_coefficient():
    text = disc(top=th.Boundary("radiation", 0.9)).to_toml()
    box = Box.of(th.Campaign(text, (Variation("e", ("boundary.top.radiation",), "", low=0.5, high=1.0),), samples=1))
    rows = np.array([[0.5], [0.8]])
    expected = 1 / exchanged(rows[:, 0])
    np.testing.assert_allclose(box.properties(rows).resistance["boundary.top"], expected, rtol=1e-15)
