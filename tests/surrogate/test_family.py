"""Families: members against their own meshes, passivity, derivatives, files, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import surrogate
import thermofem as th
from surrogate.family.members import MemberModes, difference
from surrogate.family.parameter_box import Box
from thermofem.campaign import Variation

TIMES = np.geomspace(1e-9, 1e-4, 26)

RADIUS = Variation("radius", ("part.core.radius",), "m", low=5e-6, high=9e-6)
WIDTH = Variation("width", ("part.core.width",), "m", low=400e-9, high=600e-9)
BOX = Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=3e-6)


def campaign(*variations: Variation, geometry: th.CrossSection | None = None, **options) -> th.Campaign:
    text = (geometry or th.strip_ring()).to_toml()
    samples = 1 if any(not v.values for v in variations) else 0
    return th.Campaign(text, variations, samples=samples, **options)


@cache
def rings() -> surrogate.family.Family:
    """Strips of three parameters; trained once for the tests of its members and of its uses."""
    return surrogate.train_family(campaign(RADIUS, WIDTH, BOX), tolerance=1e-3)


@pytest.fixture(scope="module")
def family() -> surrogate.family.Family:
    return rings()


@pytest.mark.parametrize("most", [6, 8])
def test_corners_of_a_box_are_different_ones(most):
    """6 corners of a box of three parameters."""
    corners = Box.of(campaign(RADIUS, WIDTH, BOX)).corners(most)
    assert len(np.unique(corners, axis=0)) == len(corners) == most


def test_the_noise_of_a_member_is_that_of_its_own_mesh(family):
    values = {"radius": 6e-6, "width": 500e-9, "box": 1.5e-6}
    frequencies = np.geomspace(1e3, 1e8, 11)
    member = th.thermal_noise(family.model(**values), frequencies, temperature=300.0)
    own = th.thermal_noise(th.assemble(th.strip_ring(**values)), frequencies, read="core", temperature=300.0)
    # 1e-3 of R_th is the error of the family, 1e-3 that of either mesh
    assert np.abs(member["S_T"] - own["S_T"]).max() < 3e-3 * own["S_T"].max()
    assert float(own["S_T"].min()) > 0


def test_members_agree_with_their_own_meshes(family):
    assert family.engine == "affine"
    assert family.error.worst <= 1e-3
    assert family.error == family.error.worst >= family.error.median > 0
    for radius, width, box in ((5e-6, 400e-9, 3e-6), (6.3e-6, 431e-9, 1.1e-6), (8.9e-6, 590e-9, 2.2e-6)):
        heat = th.assemble(th.strip_ring(radius=radius, width=width, box=box), accuracy=1e-4)
        model = family.model(radius=radius, width=width, box=box)
        expected = heat.system.step_response(TIMES, rtol=1e-6)
        np.testing.assert_allclose(model.step_response(TIMES), expected, rtol=1e-3)
        resistance = heat.thermal_resistance()
        assert model.thermal_resistance == pytest.approx(resistance, rel=1e-3)
        assert model.thermal_resistance < resistance  # a lower bound, as is that of the finer mesh
        off = family.certify(radius=radius, width=width, box=box).error
        assert off <= family.predicted_error(radius=radius, width=width, box=box) < 2e-3


@pytest.mark.slow
def test_random_members_are_passive_and_rise_monotonically(family):
    rows = family.box.draw(500, seed=11)
    for row in rows:
        model = family.model(**dict(zip(family.names, row, strict=True)))
        assert np.all(np.asarray(model.R) >= 0)
        assert np.all(np.diff(model.step_response(TIMES)) > 0)


def test_arrays_broadcast_and_agree_with_single_members(family):
    radius, width = np.array([5e-6, 7e-6, 9e-6]), np.array([[450e-9], [500e-9]])
    R = family.thermal_resistance(radius=radius, width=width, box=2e-6)
    step = family.step_response(TIMES, radius=radius, width=width, box=2e-6)
    assert R.shape == (2, 3)
    assert step.shape == (2, 3, TIMES.size)
    model = family.model(radius=7e-6, width=500e-9, box=2e-6)
    np.testing.assert_allclose(step[1, 1], model.step_response(TIMES), rtol=1e-10)
    assert model.thermal_resistance == pytest.approx(R[1, 1], rel=1e-9)


def test_the_resistance_alone_is_that_of_the_model(family):
    for row in family.box.corners():
        values = dict(zip(family.names, row, strict=True))
        expected = family.model(**values).thermal_resistance
        assert family.thermal_resistance(**values) == pytest.approx(expected, rel=1e-9)


def test_reduced_has_few_poles(family):
    values = {"radius": 7e-6, "width": 500e-9, "box": 2e-6}
    small, model = family.reduced(1e-2, **values), family.model(**values)
    assert small.passive
    assert small.order < 0.6 * model.order
    f = np.geomspace(1e3, 1e9, 40)
    assert np.abs(small.impedance(f) - model.impedance(f)).max() <= 1e-2 * model.thermal_resistance


def test_derivatives_are_those_of_the_members(family):
    values = {"radius": 7e-6, "width": 500e-9, "box": 2e-6}
    f = np.array([1e5, 1e8])
    d = family.derivatives(times=TIMES, frequencies=f, **values)
    for k, (name, value) in enumerate(values.items()):
        h = 1e-4 * value
        up, down = (family.model(**{**values, name: value + sign * h}) for sign in (1, -1))
        slope = (up.step_response(TIMES) - down.step_response(TIMES)) / (2 * h)
        size = np.abs(slope).max()
        # the difference errs by h^2 f'''/6, some 1e-8
        np.testing.assert_allclose(d.step_response[k], slope, atol=1e-6 * size)
        assert d.thermal_resistance[k].item() == pytest.approx(
            (up.thermal_resistance - down.thermal_resistance) / (2 * h), rel=1e-6
        )
        slope = (up.impedance(f) - down.impedance(f)) / (2 * h)
        np.testing.assert_allclose(d.impedance[k], slope, atol=1e-6 * np.abs(slope).max())
    geometry = th.strip_ring(radius=7e-6, width=500e-9, box=2e-6)
    paths = ["part.core.radius", "part.core.width", "layer.box.thickness"]
    fem = th.derivatives(th.assemble(geometry, accuracy=1e-4), paths)
    # errors of the members, below 1e-3, vary over the box by less than themselves
    np.testing.assert_allclose(d.thermal_resistance, fem.thermal_resistance, rtol=3e-3)


def test_a_family_is_one_file(family, tmp_path):
    path = family.save(tmp_path / "rings.npz")
    again = surrogate.load_family(path)
    values = {"radius": 7e-6, "width": 500e-9, "box": 2e-6}
    np.testing.assert_array_equal(again.model(**values).R, family.model(**values).R)
    assert again.predicted_error(**values) == family.predicted_error(**values)
    assert (again.error.worst, again.error.median) == (family.error.worst, family.error.median)
    assert again.provenance == family.provenance
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(th.InputError, match="is not a family"):
        surrogate.load_family(path)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(th.InputError, match="is not a family"):
        surrogate.load_family(tmp_path / "other.json")
    with pytest.raises(th.InputError, match="does not exist"):
        surrogate.load_family(tmp_path / "none.json")


def test_members_outside_the_box_and_wrong_names_are_refused(family):
    with pytest.raises(th.InputError, match="radius = 1e-05 must lie between 5e-06 and 9e-06"):
        family.model(radius=10e-6, width=500e-9, box=2e-6)
    with pytest.raises(th.InputError, match="did you mean 'width'"):
        family.model(radius=7e-6, widht=500e-9, box=2e-6)
    with pytest.raises(th.InputError, match="box missing"):
        family.model(radius=7e-6, width=500e-9)
    with pytest.raises(th.InputError, match="not finite"):
        family.model(radius=np.nan, width=500e-9, box=2e-6)
    with pytest.raises(th.InputError, match=r"one member has shape \(2, 3\)"):
        family.model(radius=[6e-6, 7e-6], width=500e-9, box=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [th.Boundary("isothermal"), th.Boundary("convection", 1e6)])
def test_a_contact_on_a_side_of_the_domain_is_in_series(kind):
    """R_th = (R + 1/h + thickness/(3 k))/area of a disc on this side, exact."""
    area, h = np.pi * (10e-6) ** 2, kind.coefficient
    geometry = th.CrossSection(
        "disc on a side",
        10e-6,
        (th.Layer("base", "SiO2", 1e-6, True), th.Layer("clad", "SiO2", 1e-6)),
        (th.Part("core", "Si", 0.0, 10e-6, -1e-6, 0.5e-6, heated=True),),
        (th.Interface("core", 1e-7),),
        bottom=kind,
    )
    each = [Variation("contact", ("interface.core.resistance",), "m^2*K/W", low=1e-8, high=1e-7)]
    if h:
        each.append(Variation("h", ("boundary.bottom.convection",), "W/m^2/K", low=5e5, high=1e6))
    family = surrogate.train_family(campaign(*each, geometry=geometry), tolerance=5e-3, held_out=3)
    assert family.engine == "affine"
    values = {"contact": 3e-8, **({"h": 7e5} if h else {})}
    exact = (3e-8 + (1 / 7e5 if h else 0.0) + 0.5e-6 / 390) / area
    assert family.thermal_resistance(**values) == pytest.approx(exact, rel=5e-3)


@pytest.mark.slow
def test_a_contact_may_begin_at_zero(tmp_path):
    """Below 1e-14 m^2 K/W the core of a member is held, not free."""
    contact = "interface.core.resistance"

    def ring(resistance: float) -> th.CrossSection:
        return replace(th.strip_ring(), interfaces=(th.Interface("core", resistance),))

    found = surrogate.design(ring(1e-8), {contact: (0.0, 1e-7)}, target={"thermal_resistance": 8e3}, tolerance=2e-3)
    assert found.reached
    family = surrogate.load_family(found.family.save(tmp_path / "family.npz"))
    assert family.engine == "affine"
    for resistance in (0.0, 1e-15, 1e-11, 1e-7):
        values = {contact: resistance}
        assert family.certify(**values).error <= 2e-3
        exact = th.derivatives(th.assemble(ring(resistance), 1e-3), [contact], times=[1e-8, 1e-6])
        slopes = family.derivatives(times=[1e-8, 1e-6], **values)
        # the flux is steep at the corners: meshes of 1e-3 differ by some per cent in its square
        assert slopes.thermal_resistance.values == pytest.approx(exact.thermal_resistance.values, rel=0.05)
        assert slopes.step_response.values == pytest.approx(exact.step_response.values, rel=0.05)
    heat = th.assemble(ring(2e-8), 1e-4)
    data = th.solve(heat, th.Constant(1e-3), np.geomspace(1e-9, 1e-4, 60))
    assert surrogate.calibrate(family, data).values[contact] == pytest.approx(2e-8, rel=5e-3)


@pytest.mark.slow
def test_open_sides_contacts_convection_and_two_heated_parts():
    base = th.heated_ring(cladding=1.5e-6)
    geometry = th.CrossSection(
        "heater on an open chip",
        40e-6,
        base.layers,
        base.parts,
        interfaces=(th.Interface("core", 1e-8),),
        bottom=th.Boundary("open"),
        outer=th.Boundary("open"),
        top=th.Boundary("convection", 1e5),
    )
    plan = campaign(
        Variation("radius", ("part.core.radius", "part.heater.radius"), "m", low=7e-6, high=9e-6),
        Variation("contact", ("interface.core.resistance",), "m^2*K/W", low=1e-8, high=4e-8),
        Variation("convection", ("boundary.top.convection",), "W/m^2/K", low=1e4, high=1e6),
        geometry=geometry,
    )
    family = surrogate.train_family(plan, tolerance=5e-3, held_out=3)
    assert (family.engine, family.inputs) == ("affine", ("core", "heater"))
    assert family.error <= 5e-3
    values = {"radius": 8.3e-6, "contact": 3e-8, "convection": 1e5}
    heat = th.assemble(family.box.geometry(family.box.row(values)), accuracy=1e-3)
    for heated in ("core", "heater"):
        for read in ("core", "heater"):
            expected = heat.thermal_resistance(heated, read)
            assert family.thermal_resistance(heated=heated, read=read, **values) == pytest.approx(expected, rel=5e-3)
    step = heat.channels("heater", "core").step_response(TIMES)
    ours = family.model(heated="heater", read="core", **values).step_response(TIMES)
    np.testing.assert_allclose(ours, step, atol=5e-3 * step.max())
    assert family.system(**values).outputs == ("core", "heater")


@pytest.mark.slow
def test_leaning_walls_and_shells_move_the_mesh(tmp_path):
    geometry = th.CrossSection(
        "trapezoid",
        30e-6,
        th.strip_ring(substrate=10e-6).layers,
        th.strip_ring().parts,
        probes=(th.Probe("near", "core", shell=300e-9),),
    )
    plan = campaign(
        RADIUS,
        Variation("angle", ("part.core.sidewall_angle",), "rad", low=np.radians(75), high=np.radians(90)),
        geometry=geometry,
        read=("core", "near"),
    )
    family = surrogate.train_family(plan, tolerance=5e-3, held_out=2)
    assert family.engine == "moved mesh"
    assert family.error <= 5e-3
    values = {"radius": 6.6e-6, "angle": np.radians(80.0)}
    heat = th.assemble(family.box.geometry(family.box.row(values)), accuracy=1e-3)
    assert family.model(**values).thermal_resistance == pytest.approx(heat.thermal_resistance(), rel=5e-3)
    near = heat.thermal_resistance("core", "near")
    assert family.model(read="near", **values).thermal_resistance == pytest.approx(near, rel=5e-3)
    again = surrogate.load_family(family.save(tmp_path / "family.npz"))
    np.testing.assert_allclose(again.model(**values).R, family.model(**values).R, rtol=1e-9)


@pytest.mark.parametrize(
    ("variations", "message"),
    [
        ((), "has 0 parameters"),
        (
            (Variation("oxide", ("layer.box.material",), "", values=("SiO2", "Si3N4")),),
            "lists SiO2, Si3N4; a family needs a range",
        ),
        ((Variation("width", ("part.core.width",), "m", values=(450e-9,)),), "lists 4.5e-07; a family needs a range"),
        ((Variation("width", ("part.core.bottom",), "m", low=-1e-6, high=2.5e-6),), "contradict each other"),
    ],
)
def test_a_campaign_without_a_family_is_refused(variations, message):
    with pytest.raises(th.InputError, match=message):
        surrogate.train_family(campaign(*variations))


def test_outlines_that_meet_inside_the_box_and_a_tolerance_beyond_the_meshes_are_refused():
    # the core passes the top of the buried oxide: another face appears, no mesh follows
    plan = campaign(Variation("bottom", ("part.core.bottom",), "m", low=-1e-6, high=1e-6))
    with pytest.raises(th.InputError, match="no family over this box"):
        surrogate.train_family(plan, tolerance=1e-2)
    with pytest.raises(th.InputError, match="tolerance"):
        surrogate.train_family(plan, tolerance=1e-9)


def test_the_difference_sees_early_times():
    box = Box.of(campaign(WIDTH))
    truth = surrogate.reduce(th.assemble(box.base).system, 1e-5).model
    modes = MemberModes(np.asarray(truth.tau), np.sqrt(truth.R)[None])
    fast = MemberModes(modes.tau, modes.ports * np.where(modes.tau < 1e-8, 1.02, 1.0))
    # the fastest poles carry the first nanosecond and little of R_th
    assert difference(fast, modes) > 1e-2 > 5 * abs(fast.R().sum() / modes.R().sum() - 1)
