"""Triangle meshes of cross-sections: made by gmsh, refined, moved with the geometry, written and read."""

from .committed_meshes import content_hash, find_committed, mesh_for, write_references
from .gmsh_mesher import gmsh_problem, make
from .triangles import Mesh, load

__all__ = ["Mesh", "content_hash", "find_committed", "gmsh_problem", "load", "make", "mesh_for", "write_references"]
