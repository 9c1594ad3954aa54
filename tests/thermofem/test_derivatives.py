"""Derivatives of the FEM: against differences of moved meshes, and laws of scaling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import thermofem as th
from thermofem.data.files import to_toml
from thermofem.fem.assembly import on_mesh
from thermofem.geometry.parameter_paths import change, place
from thermofem.mesh.mesh_motion import vertex_velocities
from thermofem.models import foster

STRIP = th.assemble(th.strip_ring())
TIMES = np.array([1e-9, 1e-7, 1e-5, 1e-3])

OPEN_STACK = """
name = "everything at once"
outer_radius = "30 um"
ambient = "320 K"
[[layer]]
name = "substrate"
material = "Si"
thickness = "12 um"
[[layer]]
name = "box"
material = "SiO2"
thickness = "2 um"
datum = true
[[layer]]
name = "cladding"
material = "polymer"
thickness = "2.5 um"
[[part]]
name = "core"
material = "Si"
radius = "6 um"
width = "500 nm"
bottom = "300 nm"
height = "250 nm"
sidewall_angle = "80 deg"
heated = true
[[part]]
name = "trench"
material = "void"
inner_radius = "9 um"
outer_radius = "10 um"
bottom = "1 um"
height = "700 nm"
[[interface]]
part = "core"
resistance = "2e-8 m^2*K/W"
[[probe]]
name = "near"
part = "core"
shell = "400 nm"
[boundary]
bottom = "open"
outer = "open"
top = { convection = "2e4 W/m^2/K" }
[material.polymer]
conductivity = { r = "0.9 W/m/K", z = "0.4 W/m/K", exponent = 0.4, reference = "300 K" }
density = "1200 kg/m^3"
specific_heat = "1400 J/kg/K"
"""
PATHS = {
    "part.core.radius": "m",
    "part.core.width": "m",
    "part.core.bottom": "m",
    "part.core.height": "m",
    "part.core.sidewall_angle": "rad",
    "part.trench.inner_radius": "m",
    "part.trench.height": "m",
    "layer.box.thickness": "m",
    "layer.cladding.thickness": "m",
    "layer.substrate.thickness": "m",
    "outer_radius": "m",
    "material.SiO2.conductivity": "W/m/K",
    "material.polymer.conductivity.r": "W/m/K",
    "material.polymer.conductivity.z": "W/m/K",
    "material.polymer.conductivity.exponent": "",
    "material.polymer.density": "kg/m^3",
    "material.Si.specific_heat": "J/kg/K",
    "interface.core.resistance": "m^2*K/W",
    "boundary.top.convection": "W/m^2/K",
    "probe.near.shell": "m",
    "ambient": "K",
}


def varied(text: str, path: str, unit: str, value: float) -> th.CrossSection:
    """The geometry with one value set as a campaign sets it."""
    import tomllib

    table = tomllib.loads(text)
    place(table, path, value if not unit else f"{value!r} {unit}")
    return th.CrossSection.from_toml_text(to_toml(table))


def moved(heat: th.fem.HeatProblem, geometry: th.CrossSection, velocity: np.ndarray, step: float) -> th.fem.HeatProblem:
    """The problem of another geometry on the mesh whose vertices have moved."""
    mesh = replace(heat.mesh, points=heat.mesh.points + step * velocity)
    return on_mesh(geometry, mesh, heat.accuracy)


@pytest.fixture(scope="module")
def everything() -> th.fem.HeatProblem:
    return th.assemble(th.CrossSection.from_toml_text(OPEN_STACK), accuracy=1e-2)


FREQUENCIES = np.array([1e5, 1e8])


@pytest.fixture(scope="module")
def slopes(everything):
    """The derivatives along all paths, read in the core and in the shell."""
    core = th.derivatives(everything, list(PATHS), frequencies=FREQUENCIES)
    return core, th.derivatives(everything, list(PATHS), read="near")


@pytest.mark.parametrize(("path", "unit"), PATHS.items())
def test_every_path_agrees_with_a_difference_on_the_moved_mesh(everything, slopes, path, unit):
    heat = everything
    what = change(heat.geometry, path)
    roles = ("core", "near")
    velocity = vertex_velocities(heat.geometry, heat.mesh, [what], roles=roles)[0]
    scale = heat.thermal_resistance("core", "near") / abs(what.value)

    def difference(read: str, share: float) -> tuple[np.ndarray, ...]:
        step = share * abs(what.value)
        pair = [moved(heat, varied(OPEN_STACK, path, unit, what.value + x), velocity, x) for x in (step, -step)]
        systems = [one.channels("core", read) for one in pair]
        values = [[one.thermal_resistance for one in systems]]
        if read == "core":
            values.append([one.impedance(FREQUENCIES) for one in systems])
        return tuple(np.subtract(*each) / (2 * step) for each in values)

    ours, shell = (found.sel(parameter=path) for found in slopes)
    static, impedance = difference("core", 1e-4)
    # a central difference errs by step^2 f'''/6, 1e-8 times some tens near thin layers, and by round-off, 1e-12/1e-4
    assert ours.thermal_resistance.item() == pytest.approx(static, rel=1e-6, abs=3e-8 * scale)
    np.testing.assert_allclose(ours.impedance.values, impedance, rtol=1e-6, atol=3e-8 * scale)
    # the edge of a shell passes over small triangles: only small steps are smooth, and round-off is 1e-11 over 1e-6
    assert shell.thermal_resistance.item() == pytest.approx(difference("near", 1e-6)[0], rel=1e-6, abs=5e-5 * scale)
    assert ours.value.item() == pytest.approx(what.value, rel=1e-6, abs=0)


@pytest.mark.parametrize("path", ["part.core.radius", "part.core.height", "layer.box.thickness"])
def test_step_responses_move_as_those_of_all_poles_of_a_moved_mesh(path):
    geometry = th.strip_ring(outer_radius=20e-6, substrate=5e-6)
    heat, what = th.assemble(geometry, accuracy=5e-2), change(geometry, path)
    velocity, step = vertex_velocities(geometry, heat.mesh, [what], roles=("core",))[0], 1e-4 * what.value
    pair = [moved(heat, geometry.with_({path: what.value + x}), velocity, x) for x in (step, -step)]
    slope = np.subtract(*(foster(one.system).step_response(TIMES) for one in pair)) / (2 * step)
    # the square of the step, 1e-8, times some tens
    assert th.derivatives(heat, path, times=TIMES).step_response.values[0] == pytest.approx(
        slope, rel=1e-6, abs=3e-8 * np.abs(slope).max()
    )


def test_conductivities_scale_the_resistance():
    # R_th is homogeneous of degree -1 in all conductivities together: Euler's theorem
    d = th.derivatives(STRIP, ["material.Si.conductivity", "material.SiO2.conductivity"])
    assert (d.thermal_resistance * d.value).sum().item() == pytest.approx(-STRIP.thermal_resistance(), rel=1e-11)


def test_lengths_scale_the_resistance():
    # R_th is homogeneous of degree -1 in all lengths together; the meshed value moves by its error, below 1e-3, besides
    lengths = ["radius", "width", "height"]
    paths = [f"part.core.{x}" for x in lengths] + [f"layer.{x}.thickness" for x in ("box", "cladding", "substrate")]
    d = th.derivatives(STRIP, [*paths, "outer_radius"])
    assert (d.thermal_resistance * d.value).sum().item() == pytest.approx(-STRIP.thermal_resistance(), rel=1e-3)


def test_the_step_response_ends_at_the_resistance_and_times_scale():
    d = th.derivatives(STRIP, ["material.Si.density", "material.SiO2.density", "layer.box.thickness"], times=[1.0])
    last, tiny = d.step_response.values[:, 0], 1e-8 * STRIP.thermal_resistance()
    np.testing.assert_allclose(last, d.thermal_resistance, rtol=1e-8, atol=tiny)
    t = 1e-7  # the step depends on t over all heat capacities: sum of c d/dc = -t d/dt
    d = th.derivatives(STRIP, ["material.Si.density", "material.SiO2.density"], times=[t])
    rise = STRIP.system.step_response([t * 0.999, t * 1.001], rtol=1e-9)
    assert (d.step_response[:, 0] * d.value).sum().item() == pytest.approx(-(rise[1] - rise[0]) / 0.002, rel=1e-5)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("part.core.colour", "did you mean|known"),
        ("layer.box.material", "has no derivative"),
        ("boundary.top.convection", "top is insulated"),
        ("material.air.conductivity", "no layer or part is made of it"),
        ("width", "leads nowhere"),
        (["part.core.width", "part.core.width"], "twice"),
        ([("part.core.width", "material.Si.density")], "different units"),
    ],
)
def test_a_path_without_a_derivative_is_refused(path, message):
    with pytest.raises(th.InputError, match=message):
        th.derivatives(STRIP, path)


def test_a_motion_that_opens_a_gap_is_refused_and_joint_motion_is_not():
    heat = th.assemble(th.heated_ring())
    with pytest.raises(th.InputError, match="'cladding' and 'heater' lie on each other"):
        th.derivatives(heat, "layer.cladding.thickness", read="heater")
    joint = ("layer.cladding.thickness", "part.heater.bottom")
    d = th.derivatives(heat, [joint], read="heater")
    assert d.parameter.item() == "layer.cladding.thickness + part.heater.bottom"
    pair = [th.assemble(th.heated_ring(cladding=2e-6 + x), accuracy=3e-4) for x in (5e-8, -5e-8)]
    slope = np.subtract(*[one.thermal_resistance("core", "heater") for one in pair]) / 1e-7
    assert d.thermal_resistance.item() == pytest.approx(slope, rel=2e-2)  # 1e-3 of R_th over 5 % of the length


def test_poles_of_a_reduction_move_as_those_of_a_moved_mesh():
    import surrogate

    path = "layer.box.thickness"
    found = surrogate.reduce(STRIP.system, 1e-4)
    d = surrogate.reduction.reduce.pole_derivatives(STRIP, found, [path])
    velocity = vertex_velocities(STRIP.geometry, STRIP.mesh, [change(STRIP.geometry, path)], roles=("core",))[0]
    step = 1e-4 * 2e-6
    pair = []
    for sign in (1, -1):  # the same basis on the moved mesh
        heat = moved(STRIP, th.strip_ring(box=2e-6 + sign * step), velocity, sign * step)
        E, A = (found.basis.T @ (x @ found.basis) for x in (heat.system.E, heat.system.A))
        port = heat.system.B[:, 0] @ found.basis
        pair.append(th.StateSpace((E + E.T) / 2, (A + A.T) / 2, port[:, None], port[None]))
    up, down = (foster(one) for one in pair)
    # a central difference errs by 1e-8 of the second derivative; fast poles are relative to their own size
    slope = (np.asarray(up.tau) - np.asarray(down.tau)) / (2 * step)
    np.testing.assert_allclose(d.tau[0], slope, rtol=1e-4, atol=1e-6 * np.abs(slope).max())
    slope = (np.asarray(up.R) - np.asarray(down.R)) / (2 * step)
    np.testing.assert_allclose(d.R[0], slope, rtol=1e-4, atol=1e-6 * np.abs(slope).max())
    assert d.thermal_resistance.item() == pytest.approx(d.R.sum().item(), rel=1e-9)


def test_a_reduction_of_another_mesh_of_equal_size_is_refused():
    """Its poles are not those of the matrices; the slope of R_th would be that of neither ring."""
    import surrogate

    other = th.assemble(th.strip_ring(radius=5e-6))
    assert other.unknowns == STRIP.unknowns
    with pytest.raises(th.InputError, match="of another heat problem"):
        surrogate.reduction.reduce.pole_derivatives(other, surrogate.reduce(STRIP.system, 1e-3), "layer.box.thickness")
