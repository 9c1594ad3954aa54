"""Triangle meshes of cross-sections: made by gmsh, refined, moved with the geometry, written and read."""

from .committed import content_hash, find_committed, mesh_for, write_references
from .generate import make
from .library import gmsh_problem
from .triangles import Mesh, load

__all__ = ["Mesh", "content_hash", "find_committed", "gmsh_problem", "load", "make", "mesh_for", "write_references"]
