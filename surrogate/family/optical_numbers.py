"""The light of a family: optical numbers of its rings and the temperature "light", as polynomials over the box.

    y(p) = sum over k of c_k T_k(p)        T: products of Chebyshev polynomials (`interpolation.Polynomial`)

y is an optical number, or the logarithm of a coupling or of what a bend radiates; and of every unknown of the reference
mesh the weight c_light of its temperature in that of the mode (`thermofem.fem.HeatProblem.with_light`), which becomes
V^T c_light(p) on the functions V of the family. Modes and couplers of members are solved on moved meshes.
"""

from __future__ import annotations

import itertools
import logging
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from thermofem import Foster, StateSpace, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.fem import HeatProblem
from thermofem.fem.assembly import assemble_like
from thermofem.geometry.section_parts import LIGHT
from thermofem.models import HasModel
from thermofem.optics.coupler import of_buses
from thermofem.optics.mode import LEAST_RATE
from thermofem.optics.mode_derivatives import numbers
from thermofem.optics.modes import Light

from .affine_engine import AffineEngine, AffineMembers
from .interpolation import Polynomial, total_degree
from .members import MemberMatrices, MemberModes, Solver
from .moved_mesh_engine import MovedMeshEngine, MovedMeshMembers
from .parameter_box import Box

log = logging.getLogger("thermofem")

LEFT_OUT = 8  # members that give the errors
MEMBERS_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class OpticalNumbers:
    """Polynomials of the optical numbers of a ring over the box of parameters.

    names: as `mode_derivatives.numbers` of `thermofem.optics`, "loss" [1/m] where [light] has it, "kappa 0" and
        "kappa 1": kappa^2 of every bus, and "radiated" [1/s].
    curve: of all numbers, logarithms of some, over the fractions of the ranges.
    errors [shape (numbers,)]: largest relative error over members left out.
    solved: how many members were solved.
    """

    names: tuple[str, ...]
    curve: Polynomial
    errors: Array
    solved: int

    def at(self, share: Array) -> dict[str, float]:
        """The numbers by name at fractions ``share`` (0 to 1) of the parameter ranges, shape (p,)."""
        (row,) = self.rows(share[None])
        return dict(zip(self.names, row.tolist(), strict=True))

    def rows(self, shares: Array) -> Array:
        """The numbers of n members, shape (n, numbers), at fractions ``shares`` (n, p) of the parameter ranges."""
        values = self.curve(shares)
        np.exp(values, out=values, where=_logarithmic(self.names))
        radiated = values[:, self.names.index("radiated")]
        radiated[:] = np.where(radiated > 2 * LEAST_RATE, radiated - LEAST_RATE, 0.0)
        return values

    def moves(self, k: int) -> bool:
        """Whether any of the optical numbers depends on the k-th parameter.

        That is, whether one differs by more than 1e-6 of itself between the ends of the parameter's range, with all
        other parameters in the middle of theirs.
        """
        ends = np.full((2, self.curve.powers.shape[1]), 0.5)
        ends[:, k] = 0.0, 1.0
        low, high = self.rows(ends)
        same = np.abs(high - low) <= 1e-6 * np.abs(low)
        return not same.all()

    @property
    def error(self) -> dict[str, float]:
        """Largest relative error of every number over members left out."""
        return dict(zip(self.names, self.errors.tolist(), strict=True))

    def words(self) -> str:
        """Text with the errors of n_eff and of the couplings, and the largest error of the other numbers."""
        errors = self.error
        kappas = [errors.pop(name) for name in self.names if name.startswith("kappa")]
        worst = max(errors, key=lambda name: errors[name])
        couplings = f"kappa^2 {max(kappas):.1e}, " if kappas else ""
        return f"n_eff {errors['n_eff']:.1e}, {couplings}of the others at most {errors[worst]:.1e} ({worst})"


@dataclass(frozen=True, eq=False)
class LightPort:
    """Weights of the temperature "light" as polynomials over the box of parameters.

        K <T>_light = c(p)^T x

    with K the shift -d ln(w)/dT of the mode in 1/K: c alone, which K divides, has a pole where a cladding cancels it.

    weights [1/K]: c for n unknowns of the reference mesh, or n functions of the family.
    shift [1/K]: K, one column.
    """

    weights: Polynomial
    shift: Polynomial

    def at(self, shares: Array) -> Array:
        """Weights c/K of m members, shape (m, n), at fractions ``shares`` (0 to 1) of the parameter ranges (m, p)."""
        return self.weights(shares) / self.shift(shares)

    def on(self, free: NDArray[np.intp], V: Array) -> LightPort:
        """The same for functions V instead of unknowns; V has the values of the ``free`` ones, the others are zero."""
        of_functions = self.weights.coefficients[:, free] @ V
        return replace(self, weights=replace(self.weights, coefficients=of_functions))


@dataclass(frozen=True, eq=False)
class LitMember(HasModel):
    """A member as the Foster network ``first`` of its first channel, which also holds "light" for rings that read it.

    model: the same heat with both outputs; rings and model files take it.
    """

    model: StateSpace
    first: Foster

    @property
    def provenance(self) -> dict[str, Any]:
        """Origin of the member."""
        return dict(self.model.origin or {})

    @property
    def _other(self) -> Foster:
        return self.first

    @property
    def R(self) -> ArrayLike:
        """Thermal resistances in K/W of the first channel."""
        return self.first.R

    @property
    def tau(self) -> ArrayLike:
        """Time constants in s of the first channel."""
        return self.first.tau

    @property
    def dynamics(self) -> Foster:
        """The first channel."""
        return self.first


def two_outputs(
    modes: MemberModes, names: tuple[str, str], ports: tuple[int, int, int], origin: dict[str, Any] | None
) -> StateSpace:
    """A member in modal form, heated and read in two parts by their ``names``, and read in the light.

    ports: indices of the heated and of the read part and of the light among those of ``modes``.
    """
    part, *read = ports
    decays = modes.tau > 0
    rate = 1 / modes.tau[decays]
    scaled = modes.ports[:, decays] * np.sqrt(rate)
    B = scaled[part, :, None]
    outputs = (names[1], LIGHT)
    return StateSpace(np.eye(rate.size), -np.diag(rate), B, scaled[read], names[:1], outputs, origin=origin)


@dataclass(frozen=True, eq=False)
class Members:
    """Small matrices of the members of a family, with the port "light" after the others where there is one.

    projection: of the engine on the basis of the family.
    light: of the functions of the basis.
    """

    projection: AffineMembers | MovedMeshMembers
    light: LightPort | None = None

    def matrices(self, rows: Array) -> MemberMatrices:
        """Projected matrices of n members with the parameters ``rows``, shape (n, p), stacked along a first axis."""
        members = self.projection.matrices(rows)
        if self.light is None:
            return members
        light = self.light.at(self.projection.box.share(rows))
        return replace(members, ports=np.concatenate([members.ports, light[:, None]], axis=1))

    def member(self, row: Array) -> MemberMatrices:
        """Projected matrices of the member with parameters ``row``, shape (p,)."""
        members = self.matrices(row[None])
        return MemberMatrices(members.K[0], members.M[0], members.ports[0])

    def resistances(self, rows: Array, heated: int, read: int) -> Array:
        """R_th in K/W from port ``heated`` to port ``read`` of members with parameters ``rows`` (n, p); shape (n,)."""
        gains = []
        for start in range(0, len(rows), MEMBERS_AT_ONCE):
            members = self.matrices(rows[start : start + MEMBERS_AT_ONCE])
            fields = np.linalg.solve(members.K, members.ports[:, heated, :, None])
            gains.append(np.einsum("nk,nk->n", members.ports[:, read], fields[..., 0]))
        return np.concatenate(gains)


@dataclass(frozen=True, eq=False)
class Engine:
    """Full and projected matrices of the members of a family, with the port "light" where there is one.

    light: of the unknowns of the reference mesh.
    """

    mesh_engine: AffineEngine | MovedMeshEngine
    light: LightPort | None = None

    @property
    def box(self) -> Box:
        """The box of parameters."""
        return self.mesh_engine.box

    @property
    def reference(self) -> HeatProblem:
        """The heat problem in the middle of the box."""
        return self.mesh_engine.reference

    def heat(self, row: Array) -> HeatProblem:
        """The heat problem of a member on the moved reference mesh, with "light" among its means."""
        heat = self.mesh_engine.heat(row)
        if self.light is None:
            return heat
        (light,) = self.light.at(self.box.share(row[None]))
        dark = heat.discretization
        return replace(heat, discretization=replace(dark, means={**dark.means, LIGHT: light}))

    def project(self, V: Array, ports: tuple[str, ...]) -> Members:
        """Project the family on the functions V, shape (free unknowns, N); "light" is the last of the ports."""
        means = tuple(name for name in ports if name != LIGHT)
        projection = self.mesh_engine.project(V, means)
        free = self.reference.discretization.free
        return Members(projection, self.light and self.light.on(free, V))


class MemberLight(NamedTuple):
    """Light of one member.

    numbers: its optical numbers by name.
    weights [shape (unknowns,), 1/K]: d ln(w) by the temperature of every unknown of the reference mesh; K is their sum.
    hybrid: whether its mode is.
    """

    numbers: dict[str, float]
    weights: Array
    hybrid: bool


def train_optics(engine: AffineEngine | MovedMeshEngine, seed: int, solver: Solver) -> tuple[OpticalNumbers, LightPort]:
    """Solve the light of many members, and fit polynomials over the box of parameters to it.

    ``errors`` of the numbers are measured at `LEFT_OUT` members that are left out of the fit; those of the port "light"
    are part of the errors of the family.

    Raises InputError: more than a quarter of the members are no rings; the message says why.
    """
    box = engine.box
    # 40: terms of a polynomial, at most
    powers = total_degree(box.size, 40)
    # 2: members solved for each term, beside corners of the box
    rows = np.vstack([box.middle, box.corners(16), box.draw(2 * len(powers), seed)])
    every = np.vstack([rows, box.draw(LEFT_OUT, seed, unseen=True)])
    tasks = [(engine, row) for row in every]
    results = solver(light_of, tasks, every, words="light of members")
    solved = np.array([isinstance(result, MemberLight) for result in results])
    members = list(itertools.compress(results, solved))
    hybrid = sum(member.hybrid for member in members)
    if hybrid:
        log.warning("optics: the mode of %d of %d members is hybrid: its name may hop", hybrid, len(every))
    _check_left_out(results)
    names = tuple(members[0].numbers)
    table = np.array([list(member.numbers.values()) for member in members])
    values = table.copy()
    values[:, names.index("radiated")] += LEAST_RATE
    np.log(values, out=values, where=_logarithmic(names))
    shares = box.share(every[solved])
    learn = np.flatnonzero(solved) < len(rows)
    curve = Polynomial.fit(shares[learn], values[learn], powers)
    optics = OpticalNumbers(names, curve, np.zeros(len(names)), len(table))
    truth = table[~learn]
    off = np.abs(optics.rows(shares[~learn]) - truth)
    relative = off / np.maximum(np.abs(truth), 1e-300)
    errors = np.where(truth == 0, 0.0, relative).max(axis=0)
    weights = Polynomial.fit(shares[learn], np.array([member.weights for member in members])[learn], powers)
    shift = Polynomial(powers, weights.coefficients.sum(axis=1, keepdims=True))
    return replace(optics, errors=errors), LightPort(weights, shift)


def _check_left_out(results: list[Any]) -> None:
    """Log how many members are no rings and why; InputError where they are more than a quarter."""
    reasons = Counter(result for result in results if isinstance(result, str))
    missing = sum(not isinstance(result, MemberLight) for result in results)  # None of one that failed
    if not missing:
        return
    # 3: reasons that are named
    words = "; ".join(f"{many} said: {reason}" for reason, many in reasons.most_common(3))
    text = f"{missing} of {len(results)} members are no rings"
    if missing > len(results) / 4:
        raise checks.InputError(f"{text}; {words}")
    log.warning("optics: %s and are left out; %s", text, words)


def light_of(engine: AffineEngine | MovedMeshEngine, row: Array) -> MemberLight | str:
    """The light of the member with parameters ``row``, shape (p,), or a text that says why it has none."""
    try:
        geometry = engine.box.geometry(row)
        # 1e-3: of the mesh of the heat, on which modes are within 2e-4
        heat = assemble_like(engine.box.base.to_toml(), geometry, 1e-3)
        mode = Light.of(heat).mode()
        by_name = numbers(mode)
        guide: Any = geometry.light  # which `Light.of` found
        if guide.loss is not None:
            by_name["loss"] = guide.loss
        for k, bus in enumerate(of_buses(mode, geometry.buses)):
            by_name[f"kappa {k}"] = bus.power
        by_name["radiated"] = mode.radiation_rate + mode.leak_rate
        lit = engine.heat(row).with_light(mode)
        weights = mode.thermo_optic * lit.discretization.means[LIGHT]
        return MemberLight(by_name, weights, mode.hybrid)
    except checks.InputError as error:
        return str(error)


def _logarithmic(names: tuple[str, ...]) -> NDArray[np.bool_]:
    return np.array([name.startswith(("kappa", "radiated")) for name in names])
