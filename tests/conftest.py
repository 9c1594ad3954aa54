"""What several tests share."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def needs_mesher():
    """Skip where gmsh's system libraries are missing: only the committed meshes work there."""
    from thermofem.mesh import gmsh_problem

    problem = gmsh_problem()
    if problem:
        pytest.skip(problem)
