"""Estimates of the mesh error of a thermal resistance and a step response.

For functionals c of the heated part and d of what is read, real s >= 0, u = (K + s M)^-1 c and w the same for d,

    Z(s) = d^T u,    Z_exact(s) - Z(s) = a(u_exact - u, w_exact - w),    a the bilinear form of K + s M

(a minimum principle where d = c: Z rises with every enrichment). Cubic functions on the same triangles, added to u and
w, stand for u_exact - u and w_exact - w, times `SATURATION`: on every edge a b, and in every triangle,

    l_a l_b (l_a - l_b),    l_0 l_1 l_2

with l the barycentric coordinates. With the quadratic functions they span the cubics, in a basis in which the two
levels hardly couple: solved for alone, with the quadratic part kept as it is, the cubic functions add 0.82 to 0.98 of
the energy that they add together with it (measured on 12 random cross-sections at six shifts each). As

    s Z(s) = int s^2 t exp(-s t) step(t) dt/t,    a kernel that is one decade wide in t around 1/s,

one s a decade sees the whole step response; s = 0 is R_th. Cubic functions see less of the error in triangles at a
vertex where the field is strongly singular: these count more (`saturation`). The share of each triangle in
a(u_3 - u, w_3 - w) says where to refine, see `assembly`.

At such a vertex T = T_0 + C rho^lambda phi(angle), with lambda^2 the smallest eigenvalue, but for 0, of

    -(k phi')' = lambda^2 k phi    around the vertex,    phi' = 0 on insulated sides, phi = 0 on held ones.

For four right angles with k_1 < k_2 in turn, lambda = (4/pi) arctan sqrt(k_1/k_2): 0.13 for silicon in oxide, with no
lower limit. It is 1/2 or more at the corner of one material in another. The energy that elements of size h miss is
proportional to h^(2 lambda): where lambda is small, dividing them or adding cubic functions finds little of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import LinearOperator, cg
from skfem import ElementTriP2
from skfem.element.element_h1 import ElementH1
from skfem.refdom import RefTri

from ..arrays import Array, Indices, NDArray
from .surfaces import surface_terms
from .weak_forms import assembled, element_capacity, element_conduction, properties

if TYPE_CHECKING:
    from .heat_problem import HeatProblem
    from .weak_forms import Discretization

# of a quadratic element of length 1: int phi' phi', int phi phi
_SLOPES = np.array([[7.0, 1.0, -8.0], [1.0, 7.0, -8.0], [-8.0, -8.0, 16.0]]) / 3
_VALUES = np.array([[4.0, -1.0, 2.0], [-1.0, 4.0, 2.0], [2.0, 2.0, 16.0]]) / 30
STRONG = 0.5  # the field goes with distance^lambda at a vertex; where lambda is smaller, cubic functions see too little


def saturation(exponent: float) -> float:
    """Largest ratio of the exact energy to that which cubic functions add, in triangles at a vertex with this lambda.

    Measured at six corners with contrasts of 10, 94 and 1000, lambda from 0.028 to 0.39: at most 1.13 lambda^-1.23.
    Cubic functions in the whole would leave 1/(1 - (2/3)^(4 lambda)).
    """
    return 1.2 * exponent**-1.25


def strong(d: Discretization, conductivity: Array, region: NDArray[np.int64]) -> dict[int, float]:
    """Vertices with an exponent lambda < `STRONG`, and their lambda.

    conductivity [shape (2, triangles), W/(m K)]: k_r and k_z.
    region [shape (triangles,)]
    """
    held = d.basis.mesh.facets[:, d.surfaces.held]
    exponents = {vertex: _exponent(d, conductivity, vertex, held) for vertex in _candidates(d, region, held).tolist()}
    return {vertex: exponent for vertex, exponent in exponents.items() if exponent < STRONG}


def _candidates(d: Discretization, region: NDArray[np.int64], held: NDArray[np.int64]) -> Indices:
    """Vertices where a strong singularity is possible, as an array of indices.

    Three edges between regions meet there; on the boundary two, or one where a held side ends.
    """
    grid = d.basis.mesh
    count = grid.p.shape[1]
    first, second = grid.f2t
    inner = second >= 0
    other_region = region[np.where(inner, second, first)]
    between = np.flatnonzero(inner & (region[first] != other_region))
    meeting = np.bincount(grid.facets[:, between].ravel(), minlength=count)
    outside = np.bincount(grid.facets[:, ~inner].ravel(), minlength=count) > 0
    on_held = np.bincount(held.ravel(), minlength=count) == 1
    possible = np.where(outside, meeting + on_held >= 2, meeting >= 3)
    return np.flatnonzero(possible)


def _exponent(d: Discretization, conductivity: Array, vertex: int, held: NDArray[np.int64]) -> float:
    """Exponent lambda of the singularity at a vertex, by quadratic functions of the angle on each of its triangles.

    Where k_r and k_z differ, angles are those of r/sqrt(k_r), z/sqrt(k_z) and k is sqrt(k_r k_z): exact as lambda -> 0.
    """
    t = d.basis.mesh.t
    p = d.basis.mesh.p
    around = np.flatnonzero((t == vertex).any(axis=0))
    corners = t[:, around].T
    ends = corners[corners != vertex].reshape(-1, 2)  # the edges at the vertex, by their other ends
    k = conductivity[:, around]
    x = (p[:, ends[:, 0]] - p[:, [vertex]]) / np.sqrt(k)
    y = (p[:, ends[:, 1]] - p[:, [vertex]]) / np.sqrt(k)
    cross = x[0] * y[1] - x[1] * y[0]
    angles = np.abs(np.arctan2(cross, (x * y).sum(axis=0)))
    edges, number = np.unique(ends, return_inverse=True)
    middles = len(edges) + np.arange(len(around))
    nodes = np.column_stack([number.reshape(-1, 2), middles])
    count = len(edges) + len(around)
    slopes = np.zeros((count, count))
    values = np.zeros((count, count))
    for three, kt, angle in zip(nodes, np.sqrt(k[0] * k[1]), angles, strict=True):
        block = np.ix_(three, three)
        slopes[block] += kt / angle * _SLOPES
        values[block] += kt * angle * _VALUES
    fixed = held[:, (held == vertex).any(axis=0)]
    is_free = np.append(~np.isin(edges, fixed), np.full(len(around), True))
    free = np.flatnonzero(is_free)
    squares = eigh(slopes[np.ix_(free, free)], values[np.ix_(free, free)], eigvals_only=True)
    constant_field = len(free) == count
    square = squares[1] if constant_field else squares[0]
    return float(np.sqrt(max(square, 0.0)))


_QUADRATIC = [0, 1, 2, 3, 5, 7]
_CUBIC = [4, 6, 8, 9]  # local functions of `ElementTriP2Enriched`


class ElementTriP2Enriched(ElementH1):
    """Triangle with quadratic and additional cubic functions: corners, (quadratic, cubic) on each edge, inside."""

    nodal_dofs, facet_dofs, interior_dofs, maxdeg = 1, 2, 1, 3
    dofnames = ("u", "u", "c", "c")
    doflocs = np.array([[0, 0], [1, 0], [0, 1], *([[0.5, 0]] * 2), *([[0.5, 0.5]] * 2), *([[0, 0.5]] * 2), [1 / 3] * 2])
    refdom = RefTri

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Function ``i`` and its gradient on the reference triangle; of a cubic one by complex steps, to round-off."""
        if i in _QUADRATIC:
            return ElementTriP2().lbasis(X, _QUADRATIC.index(i))
        h = 1e-30
        along_r = _cubic(np.array([X[0] + 1j * h, X[1]]), i)
        along_z = _cubic(np.array([X[0], X[1] + 1j * h]), i)
        return _cubic(X, i), np.array([along_r.imag / h, along_z.imag / h])


def _cubic(X: Any, i: int) -> Any:
    """A cubic function of `ElementTriP2Enriched`."""
    corners = 1 - X[0] - X[1], *X
    if i == 9:
        return corners[0] * corners[1] * corners[2]
    first, second = RefTri.facets[_CUBIC.index(i)]
    a = corners[first]
    b = corners[second]
    return a * b * (a - b)


@dataclass(frozen=True, eq=False)
class Functions:
    """Numbering of the quadratic functions of a mesh as in its basis, then of the cubic ones: edges, triangles.

    It has what `weak_forms` and `surfaces` ask of a scikit-fem basis.
    """

    Nbfun: ClassVar[int] = 10  # on each triangle

    mesh: Any
    elem: Any
    element_dofs: Indices
    N: int
    quadratic: int

    @property
    def nelems(self) -> int:
        """Number of triangles."""
        return int(self.element_dofs.shape[1])

    @classmethod
    def of(cls, basis: Any) -> Functions:
        """Number the cubic functions behind those of a quadratic basis."""
        grid = basis.mesh
        count = basis.N
        inside = count + grid.facets.shape[1] + np.arange(basis.nelems)
        dofs = np.empty((10, basis.nelems), dtype=np.intp)
        dofs[_QUADRATIC] = basis.element_dofs
        dofs[_CUBIC] = np.vstack([count + grid.t2f, inside])
        return cls(grid, ElementTriP2Enriched(), dofs, int(inside[-1]) + 1, count)


class Enrichment:
    """Cubic functions of a mesh: matrices among themselves and with the quadratic ones, each stored as K + i M.

    across, own [sparse; W/K and J/K]: of the free cubic functions (rows) with the quadratic ones, and with themselves.
    each [shape (triangles, 4, 4)]: between the cubic functions of each triangle, without the surfaces.
    cubic [shape (triangles, 4)]: numbers of the cubic functions, from 0.
    free: those that are not on edges at the ambient temperature.
    """

    def __init__(self, d: Discretization, conductivity: Array, heat_capacity: Array) -> None:
        """Assemble the matrices for k_r, k_z (2, triangles) in W/(m K) and rho c_p (triangles,) in J/(m^3 K)."""
        self.functions = Functions.of(d.basis)
        count = self.functions.quadratic
        K = element_conduction(self.functions, conductivity)
        M = element_capacity(self.functions, heat_capacity)
        each = K[:, _CUBIC] + 1j * M[:, _CUBIC]
        matrix = assembled(self.functions, each, _CUBIC)
        if d.surfaces.any:
            matrix = matrix + surface_terms(self.functions, conductivity, d.surfaces)
        self.free = np.setdiff1d(np.arange(self.functions.N - count), d.surfaces.held)
        rows = matrix.tocsr()[count + self.free]
        self.across = rows[:, :count]
        self.own = rows[:, count + self.free]
        self.each = each[:, :, _CUBIC]
        self.cubic = self.functions.element_dofs[_CUBIC].T - count

    def mean(self, heat: HeatProblem, name: str) -> Array:
        """Functional of the mean over a region, a probe or the light, for the cubic functions."""
        integral = heat.integral(name, self.functions)
        count = self.functions.quadratic
        return integral[count:] / integral[:count].sum()

    def added(self, s: float, quadratic: Array, load: Array) -> tuple[Array, Array]:
        """Correction of quadratic solutions by cubic functions: its products with the loads, and energy per triangle.

        s [1/s]
        quadratic [shape (quadratic functions, n), K/W]: solutions of (K + s M) u = c.
        load [shape (cubic functions, n)]: c for the cubic functions.
        Returns [shape (n, n), K/W]: c_i^T x_j of the correction x.
        Returns [shape (n, triangles), K/W]: the share of c_i^T x_i in every triangle, without the surfaces.
        """

        def at(numbers: Any) -> Any:
            return numbers.real + s * numbers.imag

        diagonal = at(self.own.diagonal())
        matrix = LinearOperator(self.own.shape, lambda x: at(self.own @ x), dtype=float)
        scaled = LinearOperator(self.own.shape, lambda x: x / diagonal, dtype=float)
        residual = load[self.free] - at(self.across @ quadratic)
        correction = np.zeros_like(load)
        for column, b in zip(correction.T, residual.T, strict=True):
            column[self.free], _ = cg(matrix, b, rtol=0.0, maxiter=STEPS, M=scaled)
        free = correction[self.free]
        products = free.T @ at(self.own @ free)
        x = correction[self.cubic]
        energies = np.einsum("tia,tia->at", x, at(self.each) @ x)
        return products, energies


Channel = tuple[str, str]  # heated, read

STEPS = 3  # of conjugate gradients; they find 0.9 to 0.999 of the energy (measured as above)
SLOWEST, FASTEST = 5, 9  # powers of ten of the shifts in 1/s: of an ordinary chip, and of the step at 1 ns
FAINT = 1e-2  # of the R_th of the heated part: where another part warms less, its error hardly counts for the mesh
SATURATION = 2.0  # the exact energy over what the cubic functions add, at most (tests/audit/accuracy.py)
CROSS = 1.75  # the same where another part is read than heated: the most found on 200 random cross-sections (there)
PEAK = 1.2  # most that the error of the step at one time is over its average around it; not for s = 0 and the last s


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated errors of some channels at every shift, relative to their reference values.

    shifts [shape (s,), 1/s]
    errors [dict from (heated, read) to array, shape (s,)]
    shares [dict from (heated, read) to array, shape (s, triangles)]: contribution of every triangle, absolute value.
    weights [dict from (heated, read) to float]: what a channel counts when the mesh is judged: 1 where the heated part
        is read, else gain/(gain + `FAINT` R_th), as what is hardly felt is not worth a finer mesh.
    corners [dict from (r, z) in m to float]: where the field is strongly singular, with the exponent.
    """

    shifts: Array
    errors: dict[Channel, Array]
    shares: dict[Channel, Array]
    weights: dict[Channel, float]
    corners: dict[tuple[float, float], float]

    @property
    def largest(self) -> float:
        """The largest of all errors, each times the weight of its channel."""
        return max(float(errors.max()) * self.weights[channel] for channel, errors in self.errors.items())


class MeshError:
    """Estimates the mesh error in the channels of one heat problem."""

    def __init__(self, heat: HeatProblem) -> None:
        self.heat = heat
        self._statics: dict[str, Array] = {}

    @cached_property
    def enrichment(self) -> Enrichment:
        """The cubic functions on the mesh."""
        return Enrichment(self.heat.discretization, *properties(self.heat.geometry, self.heat.mesh))

    @cached_property
    def strong(self) -> dict[int, float]:
        """Vertices where the field is strongly singular, with the exponent."""
        heat = self.heat
        conductivity, _ = properties(heat.geometry, heat.mesh)
        return strong(heat.discretization, conductivity, heat.mesh.region)

    @cached_property
    def unseen(self) -> Array:
        """Part to be added to each triangle's error share at strong singularities, relative to the share; (triangles,).

        saturation(lambda)/`SATURATION` - 1, as cubic functions see less of the error there; 0 elsewhere.
        """
        triangles = self.heat.mesh.triangles
        unseen = np.zeros(len(triangles))
        for vertex, exponent in self.strong.items():
            around = (triangles == vertex).any(axis=1)
            share = saturation(exponent) / SATURATION - 1
            unseen[around] = np.maximum(unseen[around], share)
        return unseen

    @cached_property
    def shifts(self) -> Array:
        """Shifts s in 1/s of the estimate: one a decade from the slowest rate of the system to `FASTEST`, then 0."""
        d = self.heat.discretization
        x = self.static(self.heat.heated[0])
        x = d.factors.solve(0.0, 1.0, d.E @ x)
        slowest = float(x @ (d.K @ x)) / float(x @ (d.E @ x))  # Rayleigh's quotient after one inverse iteration
        first = min(SLOWEST, int(np.floor(np.log10(slowest))))
        return np.append(10.0 ** np.arange(FASTEST, first - 1, -1), 0.0)

    def static(self, name: str) -> Array:
        """Static field K^-1 c of a part or probe with the mean functional c, shape (unknowns,)."""
        if name not in self._statics:
            d = self.heat.discretization
            self._statics[name] = d.factors.solve(0.0, 1.0, d.means[name][d.free])
        return self._statics[name]

    def estimate(self, channels: tuple[Channel, ...]) -> Estimate:
        """Estimate the errors of some channels: `SATURATION` (and `PEAK`) times |a(u_3 - u, w_3 - w)| / Z.

        Relative to Z(s) for a part that is heated and read. Where another part is read nothing has arrived early on,
        and the error is relative to its R_th; there each triangle counts with the root of its two energies, which is
        Cauchy's and Schwarz's inequality, times `CROSS`, as the parts may cancel in u_3 and not in the exact field.
        """
        names = list(dict.fromkeys(name for channel in channels for name in channel))
        values, totals, energies = self._enriched(names)
        between = (self.shifts > 0) & (self.shifts < self.shifts.max())
        factor = SATURATION * np.where(between, PEAK, 1.0)
        errors = {}
        local = {}
        weights = {}
        for heated, read in channels:
            i = names.index(heated)
            j = names.index(read)
            pair = np.sqrt(np.abs(energies[:, j] * energies[:, i]))
            whole = np.abs(totals[:, j, i])
            if self.strong:
                whole = whole + pair @ self.unseen
                pair = pair * (1 + self.unseen)
            if i == j:
                scale = np.abs(values[:, i, i])
                local[heated, read] = (factor / scale)[:, None] * pair
                errors[heated, read] = factor * whole / scale
                weights[heated, read] = 1.0
            else:
                gain = abs(values[-1, j, i])
                local[heated, read] = (CROSS * factor / gain)[:, None] * pair
                errors[heated, read] = local[heated, read].sum(axis=1)
                weights[heated, read] = float(gain / (gain + FAINT * values[-1, i, i]))
        corners = {}
        for vertex, exponent in self.strong.items():
            r, z = self.heat.mesh.points[vertex]
            corners[float(r), float(z)] = exponent
        return Estimate(self.shifts, errors, local, weights, corners)

    def _enriched(self, names: list[str]) -> tuple[Array, Array, Array]:
        """Quadratic solutions of n functionals at all shifts, and what cubic functions add to them.

        Returns values Z [shape (s, n, n), K/W], and products and energies as `Enrichment.added` [(s, n, n), (s, n, t)].
        """
        d = self.heat.discretization
        means = np.column_stack([d.means[name] for name in names])
        load = np.column_stack([self.enrichment.mean(self.heat, name) for name in names])
        static = np.column_stack([self.static(name) for name in names])  # while the factors of 0 are there
        values = []
        products = []
        energies = []
        for s in self.shifts:
            fields = np.zeros_like(means)
            fields[d.free] = static
            if s:
                fields[d.free] = np.column_stack([d.factors.solve(s, 1.0, mean) for mean in means[d.free].T])
            product, energy = self.enrichment.added(s, fields, load)
            values.append(means.T @ fields)
            products.append(product)
            energies.append(energy)
        return np.array(values), np.array(products), np.array(energies)
