"""The heated guide of femwell's example, solved by femwell (pip install femwell) on this package's own mesh.

    python benchmarks/check_femwell_guide.py mesh.json            # with thermofem: writes the mesh, prints its values
    python benchmarks/check_femwell_guide.py mesh.json --femwell  # with femwell, in the same or another environment

At rest with quadratic elements; the step with femwell's linear ones on the mesh refined once and twice, by Crank and
Nicolson with 20 and 40 ns; both errors of second order are removed. Printed are rises of core and heater in K per W at
rest and after the times, which `test_straight.py` compares.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

TIMES = (1e-6, 3e-6, 10e-6)
SECTION = """
name = "section of the example"
kind = "straight"
length = "320 um"
half_width = "8 um"
layer = [
    { name = "box", material = "SiO2", thickness = "1 um", datum = true },
    { name = "cladding", material = "SiO2", thickness = "2.8 um" },
]
[[part]]
name = "core"
material = "Si"
x = "0 um"
width = "500 nm"
bottom = "0 um"
height = "220 nm"
[[part]]
name = "heater"
material = "TiN"
x = "0 um"
width = "2 um"
bottom = "2.2 um"
height = "140 nm"
heated = true
[material.Si]
conductivity = "90 W/m/K"
density = "2330 kg/m^3"
specific_heat = "711 J/kg/K"
[material.TiN]
conductivity = "28 W/m/K"
density = "5240 kg/m^3"
specific_heat = "598 J/kg/K"
[material.SiO2]
conductivity = "1.38 W/m/K"
density = "2203 kg/m^3"
specific_heat = "709 J/kg/K"
"""


def ours(path: Path) -> None:
    """Write mesh and materials, print this package's values."""
    import thermofem as th

    geometry = th.CrossSection.from_toml_text(SECTION)
    heat = th.assemble(geometry, 1e-3)
    materials = {name: geometry.material_of(name) for name in heat.mesh.region_names}
    content = {
        "points": heat.mesh.points.tolist(),
        "triangles": heat.mesh.triangles.tolist(),
        "regions": [heat.mesh.region_names[k] for k in heat.mesh.region],
        "bottom": geometry.bottom_z,
        "watt": 1 / geometry.depth,
        "k": {name: m.conductivity for name, m in materials.items()},
        "c": {name: m.heat_capacity for name, m in materials.items()},
    }
    path.write_text(json.dumps(content))
    for read in ("core", "heater"):
        data = th.solve(heat, th.Constant(1.0), times=[0.0, *TIMES], heated="heater", read=read, rtol=1e-6)
        print(read, heat.thermal_resistance("heater", read), *data.delta_T.values[1:])


def theirs(path: Path) -> None:
    """Print femwell's values."""
    from femwell.thermal import solve_thermal
    from femwell.thermal_transient import solve_thermal_transient
    from skfem import Basis, ElementTriP0, LinearForm, MeshTri

    given = json.loads(path.read_text())
    names, regions = list(given["k"]), np.array(given["regions"])
    mesh = MeshTri(np.array(given["points"]).T, np.array(given["triangles"]).T)
    mesh = mesh.with_subdomains({name: np.flatnonzero(regions == name) for name in names})
    mesh = mesh.with_boundaries({"bottom": lambda x: np.abs(x[1] - given["bottom"]) < 1e-12})
    load = LinearForm(lambda v, _: v)

    def mean(basis, field, name) -> float:
        row = load.assemble(Basis(basis.mesh, basis.elem, elements=basis.mesh.subdomains[name]))
        return float(row @ field / row.sum())

    def problem(mesh):
        cells = Basis(mesh, ElementTriP0(), intorder=4)
        k, c = cells.zeros(), cells.zeros()
        for name in names:
            dofs = cells.get_dofs(elements=name)
            k[dofs], c[dofs] = given["k"][name], given["c"][name]
        heater = load.assemble(Basis(mesh, ElementTriP0(), elements=mesh.subdomains["heater"])).sum()
        return cells, k, c, np.sqrt(given["watt"] / heater)

    cells, k, _, density = problem(mesh)
    basis, field = solve_thermal(cells, k, {"heater": 1.0}, {"heater": density}, {"bottom": 0}, order=2)

    def after(times_refined: int, dt: float) -> np.ndarray:
        cells, k, c, density = problem(mesh.refined(times_refined))
        basis, fields = solve_thermal_transient(
            cells, k, k / c, {"heater": 1.0}, {"heater": 0.0}, {"heater": lambda _: density}, {"bottom": 0}, dt,
            round(TIMES[-1] / dt),
        )  # fmt: skip
        return np.array([[mean(basis, fields[round(t / dt)], name) for t in TIMES] for name in ("core", "heater")])

    rest = {name: mean(basis, field, name) for name in ("core", "heater")}
    steps = {(n, dt): after(n, dt) for n, dt in ((1, 20e-9), (1, 40e-9), (2, 40e-9))}
    for k, name in enumerate(rest):
        base, slow, fine = (steps[key][k] for key in ((1, 20e-9), (1, 40e-9), (2, 40e-9)))
        print(name, rest[name], *(fine + (fine - slow) / 3 + 4 / 3 * (base - slow)))


if __name__ == "__main__":
    (theirs if "--femwell" in sys.argv else ours)(Path(sys.argv[1]))
