"""Two racetracks with and without a trench between them: tetrahedra by gmsh and scikit-fem, brought as matrices.

A trench cuts the stack, so that neither an axisymmetric field nor a layout serves. Any finite elements do: their
matrices make a StateSpace, which is reduced, certified and driven like every other model.

python examples/trench.py [picture.png]
"""

import sys

import gmsh
import matplotlib.pyplot as plt
import numpy as np
from skfem import Basis, BilinearForm, ElementTetP2, LinearForm, MeshTet
from skfem.helpers import dot, grad

import coupled
import surrogate
import thermofem as th

STRAIGHT, BEND, APART = 8.0, 5.0, 24.0  # um: straight length, radius of the bends, distance of the middles
WIDTH, HEIGHT, SIDE = 0.45, 0.22, 32.0  # um: core, and from the middle to the sides of the domain
MATERIALS = {"core": (130, 2330 * 700), "oxide": (1.38, 2203 * 703), "substrate": (130, 2330 * 700)}  # W/m/K, J/m3/K


def racetrack(x):
    """Volume tag of the half y > 0 of a racetrack whose middle is at ``x``, straight along y."""
    occ, pieces = gmsh.model.occ, []
    for radius in (BEND + WIDTH / 2, BEND - WIDTH / 2):
        half = occ.addBox(x - radius, 0, 0, 2 * radius, STRAIGHT / 2, HEIGHT)
        bend = occ.addCylinder(x, STRAIGHT / 2, 0, 0, 0, HEIGHT, radius)
        pieces.append(occ.fuse([(3, half)], [(3, bend)])[0])
    outer, inner = pieces
    ring = occ.cut(outer, inner)[0]
    below = occ.addBox(-SIDE, -SIDE, -1, 2 * SIDE, SIDE, 2)  # what the bend's cylinder has at y < 0, if anything
    return occ.cut(ring, [(3, below)])[0]


def mesh(trench):
    """Tetrahedra of the half y > 0, and the material of each."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    cores = [*racetrack(-APART / 2), *racetrack(APART / 2)]
    oxide = [(3, occ.addBox(-SIDE, 0, -2, 2 * SIDE, SIDE, 4.22))]
    substrate = [(3, occ.addBox(-SIDE, 0, -22, 2 * SIDE, SIDE, 20))]
    if trench:
        cut = [(3, occ.addBox(-3, 0, -12, 6, SIDE, 20))]
        oxide, substrate = occ.cut(oxide, cut, removeTool=False)[0], occ.cut(substrate, cut)[0]
    _, parents = occ.fragment(cores, [*oxide, *substrate])
    occ.synchronize()
    core_tags = [tag for part in parents[: len(cores)] for _, tag in part]
    faces = [tag for _, tag in gmsh.model.getBoundary([(3, tag) for tag in core_tags], oriented=False)]
    field = gmsh.model.mesh.field
    field.add("Distance", 1)
    field.setNumbers(1, "SurfacesList", faces)
    field.setNumber(1, "Sampling", 40)
    field.add("MathEval", 2)
    field.setString(2, "F", "0.5 + 0.5*F1")
    field.setAsBackgroundMesh(2)
    for name in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints"):
        gmsh.option.setNumber(f"Mesh.{name}", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 8)
    gmsh.model.mesh.generate(3)
    tags, points, _ = gmsh.model.mesh.getNodes()
    index = np.zeros(int(tags.max()) + 1, dtype=int)
    index[tags.astype(int)] = np.arange(tags.size)
    cells, owner = [], []
    for _, volume in gmsh.model.getEntities(3):
        corners = index[gmsh.model.mesh.getElements(3, volume)[2][0].astype(int)].reshape(-1, 4)
        cells.append(corners)
        owner.append(np.full(len(corners), volume))
    gmsh.finalize()
    used, cells = np.unique(np.concatenate(cells), return_inverse=True)
    grid = MeshTet(np.ascontiguousarray(points.reshape(-1, 3)[used].T * 1e-6), cells.reshape(-1, 4).T.copy())
    owner = np.concatenate(owner)
    middle = grid.p[:, grid.t].mean(axis=1)
    material = np.where(np.isin(owner, core_tags), "core", np.where(middle[2] > -2e-6, "oxide", "substrate"))
    return grid, material


def system(trench):
    """E x' = A x + B P with the power in each racetrack in W, and the mean rise of each in K; both halves of y."""
    grid, material = mesh(trench)
    basis = Basis(grid, ElementTetP2(), intorder=2)
    k, c = (np.array([MATERIALS[name][j] for name in material])[:, None] for j in (0, 1))
    ones = np.ones((1, basis.X.shape[1]))
    A = -2 * BilinearForm(lambda u, v, w: w.k * dot(grad(u), grad(v))).assemble(basis, k=k * ones)
    E = 2 * BilinearForm(lambda u, v, w: w.c * u * v).assemble(basis, c=c * ones)
    rows = []
    for side in (-1, 1):
        own = np.flatnonzero((material == "core") & (grid.p[0, grid.t].mean(axis=0) * side > 0))
        total = LinearForm(lambda v, w: v).assemble(Basis(grid, ElementTetP2(), elements=own, intorder=2))
        rows.append(total / total.sum())
    free = basis.complement_dofs(basis.get_dofs(lambda x: x[2] < -22e-6 + 1e-9))  # the bottom is held
    C = np.array(rows)[:, free]
    E, A = E[free][:, free].tocsc(), A[free][:, free].tocsc()
    return th.StateSpace(E, A, C.T, C, inputs=("ring 1", "ring 2"), outputs=("ring 1", "ring 2"))


figure, axes = plt.subplots(2, 1, figsize=(5.7, 6), layout="constrained")
times, circuit = np.geomspace(1e-8, 3e-4, 200), coupled.Circuit(
    [coupled.borghi2021()] * 2,
    lasers=[coupled.LaserPort("one", "ring 1.in"), coupled.LaserPort("two", "ring 2.in")],
)  # fmt: skip
for trench, colour in ((False, "#0072B2"), (True, "#D55E00")):
    full = system(trench)
    rom = surrogate.reduce(full, tolerance=1e-3)
    name = "with a trench" if trench else "uniform stack"
    R = rom.model.gain
    print(f"{name}: {full.order} unknowns, {rom.model.order} states, error below {rom.error_bound:.0e}")
    print(f"  R_th {R[0, 0] / 1e3:.2f} K/mW, crosstalk {R[1, 0]:.0f} K/W ({R[1, 0] / R[0, 0]:.2%})")
    rise = rom.model.channel("ring 1", "ring 2").step_response(times)
    axes[0].semilogx(times * 1e6, rise, color=colour, label=name)
    run = coupled.simulate(circuit, rom.model, power={"one": 6.31e-3, "two": 1e-6}, duration=20e-6, rtol=1e-5)
    axes[1].plot(run.time * 1e6, run.delta_T.sel(ring="ring 2"), color=colour, label=name, lw=1)
axes[0].set(xlabel="time (µs)", ylabel="rise of the other racetrack (K/W)")
axes[1].set(xlabel="time (µs)", ylabel="rise beside a self-pulsing racetrack (K)")
axes[0].legend(frameon=False, fontsize="small")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "trench.png", dpi=220)
