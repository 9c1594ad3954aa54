"""Triangle meshes of cross-sections: made by gmsh, refined, moved with the geometry, written and read."""

from .gmsh_mesher import committed_mesh, content_hash, gmsh_problem, make, mesh_for
from .triangles import Mesh, load

__all__ = ["Mesh", "committed_mesh", "content_hash", "gmsh_problem", "load", "make", "mesh_for"]
