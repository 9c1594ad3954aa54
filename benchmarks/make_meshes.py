"""Make the meshes of the reference strip that are committed, and print the rows of the table in meshes/README.md."""

from pathlib import Path

import numpy as np

import thermofem as th
from thermofem import mesh

for accuracy in (1e-3, 1e-4):
    geometry = th.strip_ring()
    made = mesh.make(geometry, accuracy)
    name = f"strip_ring-{accuracy:.0e}-{mesh.content_hash(geometry, accuracy)}.npz"
    path = Path(__file__).parents[1] / "meshes" / name
    arrays = {name: getattr(made, name) for name in ("points", "triangles", "region")}
    np.savez_compressed(path, region_names=np.array(made.region_names), **arrays)
    extent = f"{len(made.points)} | {len(made.triangles)} | {path.stat().st_size / 1024:.0f} kB"
    print(f"| `{path.name}` | `strip_ring()` | {accuracy:.0e} | {extent} |")
