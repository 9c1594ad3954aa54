"""Campaigns: what their files may say and what is computed.

Most geometries here differ in materials only: their outline is the reference strip's, whose mesh is committed.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray as xr
from campaigns import FILE, STEP, TIMES, make, write
from paths import ROOT
from sections import HEATER

import thermofem as th
from thermofem.campaign import Drive, Variation


def test_results_are_what_solve_computes(tmp_path, threads):
    campaign = make(3, read=("core", "box"))
    summary = campaign.run(tmp_path, threads)
    assert (summary.total, summary.finished, summary.failed) == (3, 3, 0)
    with th.campaign.open_campaign(tmp_path) as data:
        assert data.oxide.values.tolist() == [1.0, 1.2, 1.4]
        assert data.oxide.attrs["units"] == "W/m/K"
        assert data.status.values.tolist() == ["finished"] * 3
        assert np.all((data.discretization_error > 0) & (data.discretization_error < 1e-3))
        for case, key in enumerate(data.key.values):
            attrs = th.load(tmp_path / "results" / f"{key}.nc").attrs
            assert (attrs["campaign_case"], attrs["campaign_values"]) == (key, f'{{"oxide": {data.oxide.item(case)}}}')
            heat = th.assemble(th.CrossSection.from_toml_text(attrs["geometry"]))
            assert heat.geometry.material_of("box").conductivity == data.oxide[case]
            expected = th.solve(heat, th.Constant(1e-3), TIMES, read=("core", "box"))
            # a member may use the moved mesh of its neighbour: two meshes, each within 1e-3
            largest = float(expected.delta_T.max())
            assert data.delta_T_step[case].values == pytest.approx(expected.delta_T.values, rel=0, abs=2e-3 * largest)
            resistances = [heat.thermal_resistance("core", name) for name in ("core", "box")]
            assert data.thermal_resistance[case].values.tolist() == pytest.approx(resistances, rel=2e-3)
    with xr.open_dataset(tmp_path / "training.nc", engine="h5netcdf") as training:
        assert training.features.dims == ("case", "feature")
        assert training.features.values[:, 0].tolist() == [1.0, 1.2, 1.4]
        assert training.feature_unit.item() == "W/m/K"
        assert not training.delta_T_step.isnull().any()


def test_every_drive_is_kept_and_the_file_trains(tmp_path, threads):
    square = Drive("square", th.SquareWave(2e-3, 1e-6, 1 / 3), samples=31)
    geometry = th.strip_ring().to_toml()
    th.Campaign(geometry, (), (square, STEP)).run(tmp_path, threads)
    (path,) = (tmp_path / "results").glob("*.nc")
    heat = th.assemble(th.strip_ring())
    first = th.load(path)
    assert np.array_equal(first.delta_T, th.solve_periodic(heat, square.wave, 31).delta_T)
    assert th.dataset.response_of(first).wave == square.wave
    with xr.open_dataset(path, engine="h5netcdf", group="step") as second:
        assert np.array_equal(second.delta_T, th.solve(heat, STEP.wave, TIMES).delta_T)
    with th.campaign.open_campaign(tmp_path) as data:
        assert data.delta_T_square.shape == (1, 31, 1)
        assert np.array_equal(data.delta_T_step[0, :, 0], th.solve(heat, STEP.wave, TIMES).delta_T)


def test_the_index_is_made_anew_where_it_is_lost(tmp_path, threads):
    two = (STEP, Drive("unknowns", th.SquareWave(2e-3, 1e-6, 1 / 3), samples=31))  # a drive may be called like this
    bad = make(3, bad=1)
    th.Campaign(bad.geometry, bad.variations, two, read=("core", "box")).run(tmp_path, threads)
    kept, training = th.load(tmp_path / "index.nc"), th.load(tmp_path / "training.nc")
    shared = [name for name in kept.variables if name in training.variables]
    assert training[shared].equals(kept.isel(case=[0, 2])[shared])
    (tmp_path / "index.nc").unlink()
    with th.campaign.open_campaign(tmp_path) as made_anew:
        assert kept.identical(made_anew.load())


def test_lists_are_crossed_and_ranges_fill_a_latin_hypercube():
    listed = Variation("material", ("layer.cladding.material",), values=("SiO2", "Si3N4"))
    radius = Variation("radius", ("part.core.radius",), "m", low=5e-6, high=10e-6)
    box = Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=4e-6, logarithmic=True)
    campaign = th.Campaign(th.strip_ring().to_toml(), (radius, listed, box), (STEP,), samples=10, seed=3)
    cases = campaign.cases()
    assert len(cases) == len(campaign) == 20
    for material in ("SiO2", "Si3N4"):
        chosen = [case.values for case in cases if case.values[1] == material]
        # a Latin hypercube has one point in each tenth of every axis
        shares = np.array([[(r - 5e-6) / 5e-6, np.log(b / 1e-6) / np.log(4)] for r, _, b in chosen])
        assert np.sort(np.floor(shares * 10), axis=0).T.tolist() == [list(range(10))] * 2
    section = th.CrossSection.from_toml_text(campaign.geometry_of(cases[-1].values))
    core = section.parts[0]
    assert (core.inner_radius + core.outer_radius) / 2 == pytest.approx(cases[-1].values[0], rel=1e-12, abs=0)
    assert section.layers[1].thickness == cases[-1].values[2]
    assert section.layers[2].material == "Si3N4"
    assert [c.key for c in campaign.cases()] == [c.key for c in cases]


def test_a_campaign_file(tmp_path):
    campaign = th.Campaign.from_toml(write(tmp_path, 5))
    assert [case.values[0] for case in campaign.cases()] == [1.0, 1.1, 1.2, 1.3, 1.4]
    np.testing.assert_allclose(campaign.drives[0].kept, [0, 1e-8, 1e-7], rtol=1e-14)
    inline = FILE.format(count=5).replace('geometry = "ring.toml"', "") + "[geometry]\n"
    inline += re.sub(r"^(\[+)", r"\1geometry.", (tmp_path / "ring.toml").read_text(), flags=re.MULTILINE)
    (tmp_path / "inline.toml").write_text(inline)
    again = th.Campaign.from_toml(tmp_path / "inline.toml")
    assert [case.key for case in again.cases()] == [case.key for case in campaign.cases()]


def test_a_campaign_without_a_drive_is_a_plan_for_a_family(tmp_path, threads):
    path = write(tmp_path, 3)
    path.write_text(path.read_text().split("[[drive]]")[0])
    plan = th.Campaign.from_toml(path)
    assert plan.drives == ()
    with pytest.raises(th.InputError, match=r"'campaign' has 0 drives; .*add a \[\[drive\]\] table"):
        plan.run(tmp_path / "out", threads)
    assert not (tmp_path / "out").exists()


def test_paths_reach_every_table():
    base = HEATER.replace('name = "core"', 'name = "a.b"').replace('part = "core"', 'part = "a.b"')
    paths = {
        "part.a.b.radius": (6e-6, "m"),
        "interface.a.b.resistance": (2e-8, "m^2*K/W"),
        "boundary.top.convection": (1e4, "W/m^2/K"),
        "material.SiO2.conductivity": (1.0, "W/m/K"),
        "material.SiO2.density": (2300.0, "kg/m^3"),
        "material.SiO2.conductivity.exponent": (-1.0, ""),
        "outer_radius": (50e-6, "m"),
        "ambient": (310.0, "K"),
    }
    variations = tuple(Variation(path, (path,), unit, (value,)) for path, (value, unit) in paths.items())
    campaign = th.Campaign(base, variations, (STEP,))
    section = th.CrossSection.from_toml_text(campaign.geometry_of(campaign.cases()[0].values))
    assert section.parts[0].outer_radius == pytest.approx(6.225e-6, rel=1e-12, abs=0)
    assert section.interfaces[0].resistance == 2e-8
    assert section.top == th.Boundary("convection", 1e4)
    oxide = section.material_of("box")
    assert (oxide.conductivity, oxide.density, oxide.conductivity_law.exponent) == (1.0, 2300.0, -1.0)
    assert (section.outer_radius, section.ambient) == (50e-6, 310.0)
    twice = [Variation(name, ("outer_radius",), "m", (5e-5,)) for name in "ab"]
    with pytest.raises(th.InputError, match="outer_radius"):  # the last one would win
        th.Campaign(base, tuple(twice), (STEP,))


def test_the_hash_covers_the_base_geometry():
    """Its mesh is moved to fit the geometries: of two bases the numbers of one geometry differ by 6e-5."""
    vary = (Variation("radius", ("part.core.radius",), "m", (7e-6,)),)
    base = th.strip_ring().to_toml()
    one, other, same = (
        th.Campaign(text, vary, (STEP,))
        for text in (base, th.strip_ring().with_({"part.core.radius": 6e-6}).to_toml(), f"# as it was\n{base}")
    )
    assert one.geometry_of((7e-6,)) == other.geometry_of((7e-6,))
    assert one.cases()[0].key != other.cases()[0].key
    assert one.cases() == same.cases()


@pytest.mark.parametrize(
    ("change", "argument"),
    [
        (('geometry = "ring.toml"', ""), "geometry"),
        (("ring.toml", "rung.toml"), "rung.toml"),
        (("count", "cuont"), "count"),
        (("count = 4", ""), "samples"),
        (("1.0 W/m/K", "2 W/m/K"), "from = 2"),
        (("1.0 W/m/K", "1.0 W/m"), "SiO2.conductivity"),
        (('"oxide"', '"status"'), "status"),
        (('"oxide"', '"field"'), "field"),
        (('"oxide"', '"a/b"'), "a/b"),
        (('power = "1 mW"', 'power = "1 mW"\nperiodic = true'), "period"),
        (('first = "10 ns"', 'first = "10 us"'), "first"),
        (("[[drive]]", 'values = ["1 W/m/K"]\n[[drive]]'), "values"),
    ],
)
def test_campaign_files_that_cannot_be_meant(change, argument, tmp_path):
    path = write(tmp_path, 4)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(th.InputError, match=argument) as error:
        th.Campaign.from_toml(path)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_what_the_docs_and_the_example_describe_can_be_read(tmp_path):
    (tmp_path / "heater.toml").write_text(HEATER)
    text = (ROOT / "docs" / "campaigns.md").read_text()
    (tmp_path / "campaign.toml").write_text(re.findall(r"```toml[^\n]*\n(.*?)```", text, flags=re.DOTALL)[0])
    campaign = th.Campaign.from_toml(tmp_path / "campaign.toml")
    assert len(campaign) == 100 * 5 * 2
    section = th.CrossSection.from_toml_text(campaign.geometry_of(campaign.cases()[-1].values))
    assert [p.outer_radius - p.inner_radius for p in section.parts[:2]] == pytest.approx([500e-9] * 2, rel=1e-9, abs=0)
    assert len(th.Campaign.from_toml(ROOT / "examples" / "campaign_200.toml").cases()) == 200
