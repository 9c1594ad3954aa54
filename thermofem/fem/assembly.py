"""From a geometry to its heat problem or its modes: mesh, matrices, error estimate, refinement.

The mesh is the moved one of a similar geometry where that keeps the accuracy, else its own.

A `Leader` holds the mesh of one geometry. For another geometry with the same faces its vertices move with the outlines
(`mesh_motion`). The moved mesh is taken where its estimated error keeps the promise, or after triangles were divided
where it nearly does. The committed meshes of the reference strip lead all strips at about their accuracy; the base
geometry of a campaign leads its members, with a smaller error than promised (`LEADER_MARGIN`). What a geometry gets
does not depend on those before it. Moved meshes share the sparsity pattern of their matrices, so that orderings and
symbolic factorizations are made once, too (`Pencil.inherit`).

At every shift whose error is above `AIM` of the target the triangles with the largest shares are divided: as few of
them as bring the sum down to `AIM` if dividing leaves `LEFT` of a share, or those with `BULK` of the sum where even all
would not do (W. Doerfler, SIAM J. Numer. Anal. 33, 1106 (1996)).

Marked triangles are divided into four, their neighbours into two to four, without hanging nodes. A triangle with a
divided edge has its longest edge divided too, so that angles stay above half of the smallest one (M. C. Rivara, Int. J.
Numer. Methods Eng. 20, 745 (1984)).
"""

import logging
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import checks
from ..arrays import Array, Mask
from ..checks import InputError
from ..geometry.cross_section import CrossSection
from ..geometry.ring_sections import strip_ring
from ..mesh import Mesh, committed_mesh, mesh_for
from ..mesh.element_sizes import sizes
from ..mesh.mesh_motion import Motion, quality
from ..mesh.triangles import sides
from ..optics.modes import Light
from .error_estimate import Estimate
from .heat_problem import HeatProblem
from .own_mesh import own_mesh
from .surfaces import resistances, split, surfaces_of
from .weak_forms import Discretization, discretize, properties

ROUNDS = 12  # meshes tried until the estimated error is below the accuracy
MOST_UNKNOWNS = 400_000  # unknowns; a mesh with more is not refined
LEADER_MARGIN = 0.9  # of the accuracy, for the mesh that is moved
FLATTEST = 0.05  # of `mesh_motion.quality`; flatter triangles are not worth an estimate
DIVIDED = 0.2, 2.0  # flattest triangle, and estimate over accuracy, with which a moved mesh is worth dividing

COMMITTED, COARSER = (1e-3, 1e-4), 2.0  # accuracies of committed meshes, and up to which factor above they serve

AIM = 0.8  # of the error allowed, at which refinement aims
LEFT = 0.15  # of the share of a triangle after it was divided in four: 1/16 where the field is smooth, 0.4 at a corner
BULK = 0.8  # of the sum of the errors, by which triangles are refined
FINEST = 1e-8  # of the largest coordinate: ten times `mesh_motion.NEAR`, within which a vertex is at a corner

log = logging.getLogger("thermofem")
_thread = threading.local()  # one thread works on one geometry at a time


def adapted(geometry: CrossSection, mesh: Mesh, accuracy: float, rounds: int = ROUNDS) -> tuple[HeatProblem, Mesh]:
    """The heat problem on a mesh that is divided until its estimated error is below the accuracy; and that mesh.

    The log says so where ``rounds``, `MOST_UNKNOWNS` or `FINEST` end that before.
    """
    resistance = resistances(geometry)
    finer = mesh
    for _ in range(rounds):
        mesh = finer
        heat = on_mesh(geometry, split(mesh, resistance), accuracy)
        estimate = heat.estimate()
        if estimate.largest <= accuracy or heat.unknowns > MOST_UNKNOWNS:
            break
        smaller = divided(mesh, estimate, accuracy)
        if smaller is None:
            break
        finer = smaller
    if estimate.largest > accuracy:
        log.warning(
            "%s: the mesh of %d unknowns leaves an estimated error of %.1e, more than accuracy = %g%s",
            geometry.name,
            heat.unknowns,
            estimate.largest,
            accuracy,
            _corner(estimate),
        )
    return heat, mesh


def _corner(estimate: Estimate) -> str:
    """Sentence on the corner with the strongest singularity and its remedy; "" where no field is strongly singular."""
    if not estimate.corners:
        return ""
    r, z = min(estimate.corners, key=lambda point: estimate.corners[point])
    where = f"; what flows through the corner r = {r:g} m, z = {z:g} m depends on picometres"
    return where + ": let the good conductors overlap there, or keep them apart"


def on_mesh(geometry: CrossSection, mesh: Mesh, accuracy: float, *, degree: int = 2) -> HeatProblem:
    """The heat problem of a geometry on a given mesh, cut open along its interfaces (`surfaces.split`).

    Raises InputError: a racetrack, which is not axisymmetric.
    """
    if geometry.straight:
        raise InputError(
            f"{geometry.name!r} is a racetrack ([plan] straight), and the FEM solves circles",
            "`thermofem reduce` makes its model for simulate and others, surrogate.reduce_layout(th.read_layout(file)) "
            "in Python; without [plan] it is a circle",
        )
    mesh = mesh if mesh.depth == geometry.depth else replace(mesh, depth=geometry.depth)
    surfaces = surfaces_of(geometry, mesh, resistances(geometry))
    discretization = discretize(mesh, *properties(geometry, mesh), surfaces, degree=degree)
    heat = HeatProblem(geometry, mesh, discretization, accuracy)
    return heat.reading(*heat.probes)


def divided(mesh: Mesh, estimate: Estimate, target: float) -> Mesh | None:
    """Divide the triangles that carry too much of the error; None where they would be finer than `FINEST`.

    mesh: that of the estimate, but without doubled nodes. target: wanted relative error.

    At a vertex where the field is strongly singular triangles are divided several times at once: so often that the
    error falls as it does at an ordinary corner.
    """
    finest = FINEST * float(np.abs(mesh.points).max())
    small = _longest(mesh) < 2 * finest
    beside = {point: _touching(mesh, point) for point in estimate.corners}
    stuck = sum(beside.values(), np.array(False)) & small
    chosen = marked(estimate, target, stuck)
    if not chosen.any():
        return None
    deeper = [point for point, touching in beside.items() if (touching & chosen).any()]
    mesh = refined(mesh, chosen)
    for point in deeper:
        ordinary = 2 / 3  # exponent of the field at the corner of a good conductor
        divisions = round(ordinary / estimate.corners[point])
        for _ in range(divisions - 1):
            large = _longest(mesh) >= 2 * finest
            touching = _touching(mesh, point) & large
            if touching.any():
                mesh = refined(mesh, touching)
    return mesh


def marked(estimate: Estimate, target: float, stuck: Mask) -> Mask:
    """Select the triangles to divide, shape (triangles,).

    stuck [shape (triangles,)]: triangles that must not be divided. They may take at most half of the target, whatever
        their error; the others are divided until their error is below the rest.
    """
    chosen = np.zeros(stuck.size, dtype=bool)
    for channel, errors in estimate.errors.items():
        allowed = target / max(estimate.weights[channel], 1e-12)
        for error, share in zip(errors, estimate.shares[channel], strict=True):
            of_stuck = float(share[stuck].sum())
            of_others = allowed - min(of_stuck, allowed / 2)
            if error - of_stuck > of_others:
                free = np.where(stuck, 0.0, share)
                chosen |= _largest(free, AIM * of_others)
    return chosen


def _touching(mesh: Mesh, point: tuple[float, float]) -> Mask:
    """Which triangles have a corner at the point (r, z), shape (triangles,)."""
    here = (mesh.points == point).all(axis=1)
    return here[mesh.triangles].any(axis=1)


def _longest(mesh: Mesh) -> Array:
    """Length in m of the longest edge of each triangle."""
    lengths = np.linalg.norm(sides(mesh.points[mesh.triangles]), axis=-1)
    return lengths.max(axis=1)


def _largest(share: Array, aim: float) -> Mask:
    """The fewest triangles whose division brings the sum of error shares to ``aim``, with at most `BULK` of it."""
    order = np.argsort(share)[::-1]
    so_far = np.cumsum(share[order])
    total = float(share.sum())
    excess = (total - aim) / (1 - LEFT)
    needed = min(excess, BULK * total)
    last = int(np.searchsorted(so_far, needed))
    chosen = np.zeros(share.size, dtype=bool)
    chosen[order[: last + 1]] = True
    return chosen


def refined(mesh: Mesh, marked: Mask) -> Mesh:
    """The mesh with the marked triangles divided in four equal ones, and neighbours as needed.

    mesh: without nodes that are doubled along contacts. Its points are the first ones of the result.
    marked [shape (triangles,)]
    """
    regions = {name: np.flatnonzero(mesh.region == k) for k, name in enumerate(mesh.region_names)}
    grid = mesh.skfem.with_subdomains(regions).refined(np.flatnonzero(marked))
    triangles = grid.t.T.astype(np.int64)
    region = np.empty(len(triangles), dtype=np.int64)
    for k, name in enumerate(mesh.region_names):
        region[grid.subdomains[name]] = k
    return replace(mesh, points=grid.p.T, triangles=triangles, region=region)


class Leader:
    """Keeps the mesh of one geometry and moves it to similar ones, which saves making a mesh for each.

    mesh: with an estimated error below ``accuracy``; default one that is made with `LEADER_MARGIN`.
    """

    def __init__(self, geometry: CrossSection, accuracy: float, mesh: Mesh | None = None) -> None:
        if mesh is None:
            _, mesh = adapted(geometry, mesh_for(geometry, accuracy), LEADER_MARGIN * accuracy)
        self.motion = Motion(mesh, geometry)
        self.accuracy = accuracy
        self.last: Discretization | None = None

    def follow(self, geometry: CrossSection) -> tuple[HeatProblem, Mesh] | None:
        """Heat problem of another geometry on the moved mesh, and that mesh before it is cut open along contacts.

        None where its error is too large, or where the mesh cannot move to that geometry.
        """
        try:
            points = self.motion.moved(geometry)
        except InputError:
            return None
        flattest = quality(points, self.motion.mesh.triangles).min()
        if flattest < FLATTEST:
            return None
        mesh = replace(self.motion.mesh, points=points)
        heat = on_mesh(geometry, split(mesh, resistances(geometry)), self.accuracy)
        if self.last is not None:
            heat.discretization.factors.inherit(self.last.factors)
        self.last = heat.discretization
        estimate = heat.estimate()
        if estimate.largest <= self.accuracy:
            return heat, mesh
        flat, inaccurate = DIVIDED
        if flattest < flat or estimate.largest > inaccurate * self.accuracy:
            return None
        finer = divided(mesh, estimate, self.accuracy) or mesh
        return adapted(geometry, finer, self.accuracy)


def assemble(geometry: CrossSection, accuracy: float = 1e-3, *, mesh: Mesh | str | Path | None = None) -> HeatProblem:
    """Mesh a cross-section and assemble its heat problem.

    Parameters
    ----------
    geometry : CrossSection
    accuracy : float
        wanted relative error of R_th and of the step response from 1 ns on; it picks the mesh sizes. Where the
        estimated error (`HeatProblem.mesh_error`) of a heated part, or of a copy of a part off the axis, is larger,
        triangles are divided. The meshes of the reference strip are committed, and other strips take them with moved
        vertices where their error allows; any other mesh is made by gmsh.

    mesh : Mesh or path, optional
        a mesh of your own in m, from gmsh (.msh) or `Mesh`, whose physical groups are named after layers and parts. It
        is taken as it is. The geometry gives materials, heated parts, contacts and sides; the log says where the
        estimated error is above ``accuracy``.

    With [light] in the geometry the mode is solved, too, and "light" can be read.

    Raises
    ------
    InputError
        accuracy out of range; a racetrack; a mesh with other names, or that does not fill the domain of the geometry.
    MissingLibraryError
        a mesh must be made and gmsh cannot be loaded.
    """
    sizes(accuracy)
    if mesh is None:
        heat, _ = meshed(geometry, accuracy)
    else:
        heat, _ = adapted(geometry, own_mesh(geometry, mesh), accuracy, rounds=1)
    if beyond := geometry.beyond_laws():
        log.warning(beyond)
    return heat.lit


def meshed(geometry: CrossSection, accuracy: float) -> tuple[HeatProblem, Mesh]:
    """`assemble`, and the mesh without the cuts of contacts."""
    sizes(accuracy)
    followed = None
    if _like_a_strip(geometry) and not committed_mesh(geometry, accuracy):
        leader = _strip(accuracy)
        followed = leader and leader.follow(geometry)
    return followed or adapted(geometry, mesh_for(geometry, accuracy), accuracy)


def light(
    section: CrossSection | HeatProblem, *, wavelength: float | None = None, part: str | None = None, order: int = 2
) -> Light:
    """The guided modes of a cross-section.

    Parameters
    ----------
    section : CrossSection or HeatProblem
        of a heat problem its mesh is taken, cut to a window about the part; of a geometry that of `assemble`. Where the
        heat has no triangles (air above the stack, voids) a mesh is drawn.
    wavelength : float, m
        default that of [light] in the geometry.
    part : str
        the core; default that of [light], or "core", or the first heated part.
    order : int
        of the elements, 2 or 3. On the mesh for 1e-3 of the heat n_eff and n_g are within 2e-4 (order 2) and 2e-5 (3).

    Raises
    ------
    InputError
        no guided mode; a material without an index in its reach; a wavelength outside an index law's range.

    >>> import thermofem as th
    >>> mode = th.light(th.strip_ring(), wavelength=1.55e-6).mode("TE0")
    >>> round(mode.n_eff, 2), round(mode.n_g, 2)
    (2.36, 4.29)
    """
    hint = "th.strip_ring() is a geometry, th.assemble(geometry) a heat problem"
    checks.instance("section", section, CrossSection, HeatProblem, hint=hint)
    if isinstance(section, HeatProblem):
        return Light.of(section, wavelength, part, order)
    circle, _ = meshed(replace(section, straight=0.0), accuracy=1e-3)
    return replace(Light.of(circle, wavelength, part, order), geometry=section)


def assemble_like(base: str, geometry: CrossSection, accuracy: float) -> HeatProblem:
    """The heat problem of a geometry, on the moved mesh of ``base`` (text of a geometry file; "" for none) if it fits.

    Raises InputError, MissingLibraryError: as `assemble`.
    """
    if base and getattr(_thread, "key", None) != (base, accuracy):
        _thread.key = base, accuracy
        _thread.leader = None
        with suppress(InputError):  # the base geometry itself cannot be solved
            origin = CrossSection.from_toml_text(base)
            _thread.leader = Leader(origin, accuracy)
    if not base or _thread.leader is None:
        return meshed(geometry, accuracy)[0]
    followed = _thread.leader.follow(geometry)
    heat, _ = followed or adapted(geometry, mesh_for(geometry, accuracy), accuracy)
    return heat


def _like_a_strip(geometry: CrossSection) -> bool:
    """Whether a geometry has the same faces and the same heated part as `strip_ring`."""
    if geometry.heated != ("core",):
        return False
    owners = [face.owner for face in geometry.subdivision.faces]
    return owners == ["substrate", "box", "cladding", "core"]


def _strip(accuracy: float) -> Leader | None:
    """Leader with a committed mesh of the reference strip of this accuracy, or up to `COARSER` finer; else None."""
    leaders: dict[float, Leader | None] = _thread.__dict__.setdefault("strips", {})
    if accuracy not in leaders:
        geometry = strip_ring()
        leaders[accuracy] = None
        served = [a for a in COMMITTED if a <= accuracy <= COARSER * a]
        committed = committed_mesh(geometry, served[0]) if served else None
        if committed:
            leaders[accuracy] = Leader(geometry, accuracy, committed)
    return leaders[accuracy]
