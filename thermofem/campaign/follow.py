"""Members of a campaign on the moved mesh of its base geometry.

The mesh of the base geometry is made once in every worker, with a smaller error than promised (`MARGIN`). For a
member its vertices move with the outlines (`mesh.motion`). The moved mesh is taken where its estimated error keeps the
promise; where it does not, or where the faces differ, the member gets a mesh of its own. What a member gets does not
depend on the members before it. Moved meshes share the places of their matrices, so that orderings and symbolic
factorizations are made once, too (`Pencil.inherit`).
"""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING

from ..checks import InputError
from ..geometry import CrossSection
from ..heat.interface import split
from ..heat.problem import adapted, assemble, on_mesh, resistances
from ..mesh import mesh_for
from ..mesh.motion import Motion, quality

if TYPE_CHECKING:
    from ..heat import Discretization, HeatProblem

MARGIN = 0.75  # of the accuracy, for the mesh that is moved
FLATTEST = 0.05  # of `motion.quality`; flatter triangles are not worth an estimate

_worker = threading.local()  # one thread works on one member at a time


class Leader:
    """The mesh of a base geometry, to be moved.

    Parameters
    ----------
    geometry : CrossSection
    accuracy : float
    """

    def __init__(self, geometry: CrossSection, accuracy: float) -> None:
        heat, mesh = adapted(geometry, mesh_for(geometry, accuracy), MARGIN * accuracy)
        self.accuracy = accuracy
        self.motion = Motion(mesh, geometry)
        self.last: Discretization = heat.discretization

    def follow(self, geometry: CrossSection) -> HeatProblem | None:
        """The heat problem of another geometry on the moved mesh; None where that does not keep the accuracy."""
        try:
            points = self.motion.moved(geometry)
        except InputError:
            return None
        if quality(points, self.motion.mesh.triangles).min() < FLATTEST:
            return None
        contacts = resistances(geometry)
        mesh = split(replace(self.motion.mesh, points=points), contacts)
        heat = on_mesh(geometry, mesh, contacts, self.accuracy)
        heat.discretization.factors.inherit(self.last.factors)
        self.last = heat.discretization
        return heat if heat.estimate().largest <= self.accuracy else None


def assemble_like(base: str, geometry: CrossSection, accuracy: float) -> HeatProblem:
    """The heat problem of a geometry, on the moved mesh of ``base`` (text of a geometry file; "" for none) if it fits.

    Raises
    ------
    InputError, MissingLibraryError
        as `heat.assemble`.
    """
    if not base:
        return assemble(geometry, accuracy)
    key = base, accuracy
    if getattr(_worker, "key", None) != key:
        _worker.leader = _leader(base, accuracy)
        _worker.key = key
    heat = None if _worker.leader is None else _worker.leader.follow(geometry)
    return heat or assemble(geometry, accuracy)


def _leader(base: str, accuracy: float) -> Leader | None:
    """None where the base geometry cannot be solved itself."""
    try:
        return Leader(CrossSection.from_toml_text(base), accuracy)
    except InputError:
        return None
