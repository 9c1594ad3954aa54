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
    from ..fem import assembly, cubic_enrichment, domain_truncation

    __all__ = [
        "assembly", "cubic_enrichment", "domain_truncation", "h5netcdf", "meshio", "qdldl", "scipy", "shapely", "skfem",
        "solving",
    ]  # fmt: skip
