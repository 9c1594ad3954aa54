"""Everything that solving a geometry imports: a server process imports it once for all workers, see `processes`."""

from __future__ import annotations

import contextlib

with contextlib.suppress(ImportError):  # a worker says what is missing
    import h5netcdf
    import meshio
    import qdldl
    import scipy.linalg
    import scipy.sparse.linalg
    import shapely
    import skfem

    from .. import solving
    from ..fem import assembly, domain, enrichment

    __all__ = [
        "assembly", "domain", "enrichment", "h5netcdf", "meshio", "qdldl", "scipy", "shapely", "skfem", "solving",
    ]  # fmt: skip
