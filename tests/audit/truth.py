"""The true error of a mesh: against cubic elements on triangles divided in four, and much finer at all corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import thermofem as th
from thermofem.algebra.krylov import Rounds, rates
from thermofem.fem.assembly import on_mesh, refined
from thermofem.fem.heat_problem import HeatProblem
from thermofem.fem.surfaces import resistances, split
from thermofem.mesh.triangles import Mesh

TIMES = np.geomspace(1e-9, 1e-2, 57)  # s, eight a decade
ROUNDS = 5  # through six shifts: two more change no error by more than a hundredth of it
AT_CORNERS = 6  # more divisions there: with r^(2/3) cubics leave 0.4 of the error at each of them


def finer(mesh: Mesh, geometry: th.CrossSection, times: int) -> Mesh:
    """Every triangle in four ``times`` times, and those at the corners of the geometry's faces `AT_CORNERS` more."""
    for _ in range(times):
        mesh = refined(mesh, np.ones(len(mesh.triangles), dtype=bool))
    corners = np.unique(np.concatenate([ring for face in geometry.subdivision.faces for ring in face.rings]), axis=0)
    for _ in range(AT_CORNERS):
        distance = np.abs(mesh.points[:, None] - corners).max(axis=-1).min(axis=1)
        mesh = refined(mesh, (distance < 1e-13)[mesh.triangles].any(axis=1))
    return mesh


def cubic(geometry: th.CrossSection, mesh: Mesh) -> HeatProblem:
    """The heat problem with cubic elements on a mesh without doubled nodes."""
    return on_mesh(geometry, split(mesh, resistances(geometry)), 1e-9, degree=3)


def step(heat: HeatProblem, names: tuple[str, ...]) -> NDArray[np.float64]:
    """R_th, then the step response at `TIMES`, of all pairs of names, in K/W, shape (1 + times, names, names).

    In closed form on a rational Krylov space of all functionals together: twice the digits of either of them alone.
    """
    d = heat.discretization
    system = d.state_space(names, names)
    slow, fast = rates(system, d.factors.keep(0.0, 1.0))
    shifts = np.append(0.0, np.geomspace(30 * slow, max(300 * fast, 3e9), 5))
    space = Rounds(system, shifts, [d.factors.keep(s, 1.0) for s in shifts])
    for _ in range(ROUNDS):
        space.grow()
    basis = space.basis()
    z = np.vstack([1 / basis.rate, (1 - np.exp(-basis.rate * TIMES[:, None])) / basis.rate])
    return np.asarray(np.einsum("tk,ki,kj->tij", z, basis.heating, basis.heating, optimize=True))


def errors(
    heat: HeatProblem, mesh: Mesh, channels: tuple[tuple[str, str], ...], times: int = 1
) -> dict[tuple[str, str], float]:
    """True errors of channels, in the measure of the estimate: of its own value, or of R_th where another part is read.

    ``mesh`` is that of the problem, before nodes were doubled.
    """
    exact = cubic(heat.geometry, finer(mesh, heat.geometry, times))
    names = tuple(dict.fromkeys(name for channel in channels for name in channel))
    ours, theirs = step(heat, names), step(exact, names)
    found = {}
    for heated, read in channels:
        i, j = names.index(heated), names.index(read)
        scale = theirs[:, j, i] if heated == read else theirs[0, j, i]
        found[heated, read] = float(np.abs((ours[:, j, i] - theirs[:, j, i]) / scale).max())
    return found
