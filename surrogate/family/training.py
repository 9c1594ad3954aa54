"""Training of a family: members are solved where the error is largest until new ones are predicted well enough.

Every batch of members is predicted before it is added, so its error is a fair test of the functions so far. Between
batches, many candidates are looked at with all functions and with those of earlier batches alone; where the two differ
most, the next members are solved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from thermofem.arrays import Array

from .affine import LineEngine
from .basis import Member, extended
from .box import Box
from .moved import MovedEngine, projected
from .reduced import LineTerms, difference
from .solving import Solver, member_of

SHARE = 0.4  # of the tolerance, for what the functions leave of members on the reference mesh; the rest is the mesh's
STATIC = 0.1  # of the tolerance, by which thermal resistances of the first functions may miss those of all
KEPT = 0.01  # of the tolerance: energy of the weakest direction that a batch adds
CANDIDATES = 128
BATCH = 6
MOST = 60  # batches


@dataclass(frozen=True, eq=False)
class Trained:
    """Results of the training.

    basis [shape (unknowns, N)]: functions, those of the static fields first.
    statics: how many.
    left: worst error of every batch, predicted before it was added.
    """

    basis: Array
    statics: int
    members: tuple[Member, ...]
    left: tuple[float, ...]
    terms: LineTerms | None


@dataclass
class Trainer:
    """State of a training run."""

    engine: LineEngine | MovedEngine
    ports: tuple[str, ...]
    tolerance: float
    seed: int
    heated: int
    report: Callable[[str], None]
    solver: Solver

    def __post_init__(self) -> None:
        self.box: Box = self.engine.box
        self.X = self.engine.reference.discretization.K
        self.V = np.empty((self.engine.unknowns, 0))
        self.members: list[Member] = []
        self.earlier = 0  # functions before the last batch

    def run(self) -> Trained:
        """Train until a batch is predicted to `SHARE` of the tolerance."""
        left: list[float] = []
        rows = self._first()
        for number in range(MOST):
            errors = []
            new = self._solved(rows)
            for member in new:
                if number:
                    here = projected(self.engine.heat(member.row), self.V, self.ports).modes()
                    errors.append(difference(here, member.modes, self.heated))
                self.members.append(member)
            self.report(f"{len(self.members)} members solved, {self.V.shape[1]} functions")
            if errors:
                left.append(max(errors))
                if left[-1] <= SHARE * self.tolerance:
                    break
            self.earlier = self.V.shape[1]
            fields = np.hstack([member.fields for member in new])
            self.V = extended(self.V, self.X, fields, KEPT * self.tolerance)
            rows = self._next(number)
        return self._finish(left)

    def _solved(self, rows: Array) -> list[Member]:
        """Members on the reference mesh; those that fail are left out."""
        tasks = [(self.engine, row, self.ports, self.tolerance) for row in rows]
        mesh = f"{self.engine.unknowns} {self.engine.reference.mesh.points.sum():.15g}"
        found = self.solver(member_of, tasks, rows, mesh)
        return [member for member in found if member is not None]

    def _first(self) -> Array:
        """The middle, some corners and points inside."""
        return np.vstack([self.box.middle[None], self.box.corners(2 * BATCH), self.box.draw(BATCH, self.seed)])

    def _terms(self, V: Array, statics: int) -> LineTerms | None:
        """Terms between functions, where the engine has such."""
        if not isinstance(self.engine, LineEngine):
            return None
        terms = self.engine.project(V, self.ports)
        return LineTerms.of(self.engine.coefficients, terms, self.engine.volumes(self.ports), statics)

    def _next(self, number: int) -> Array:
        """Members where all functions and the earlier ones differ most, and some drawn at random."""
        random = self.box.draw(BATCH, self.seed + 1 + number)
        terms = self._terms(self.V, 0)
        if terms is None or not self.earlier:
            return random
        inside = self.box.draw(CANDIDATES, self.seed + 1000 + number)
        candidates = np.vstack([inside, self.box.corners(CANDIDATES // 4)])
        gaps = []
        for row in candidates:
            small = terms.member(row)
            gaps.append(difference(small.first(self.earlier).modes(), small.modes(), self.heated))
        span = self.box.high - self.box.low
        picked: list[int] = []
        for k in np.argsort(gaps)[::-1]:  # apart from each other
            if all(np.abs((candidates[k] - candidates[m]) / span).max() > 0.2 for m in picked):
                picked.append(int(k))
            if len(picked) == BATCH // 2:
                break
        return np.vstack([candidates[picked], random[: BATCH - len(picked)]])

    def _finish(self, left: list[float]) -> Trained:
        """The fewest functions that hold all members, those of the static fields first."""
        none = np.empty((self.engine.unknowns, 0))
        static = extended(none, self.X, np.hstack([m.static for m in self.members]), 0.02 * KEPT * self.tolerance)
        fields = np.hstack([member.fields for member in self.members])
        basis, statics = extended(static, self.X, fields, KEPT * self.tolerance), static.shape[1]
        terms = self._terms(basis, statics)
        if terms is not None:
            count = self._fewest(terms, statics)
            kept, statics = np.eye(terms.size)[:, :count], self._enough(terms, statics, count)
            basis, terms = basis[:, :count], terms.rotated(kept, statics)
        return Trained(basis, statics, tuple(self.members), tuple(left), terms)

    def _fewest(self, terms: LineTerms, statics: int) -> int:
        """Smallest number of functions that keeps the error of all members below `SHARE` of the tolerance."""
        small = [terms.member(member.row) for member in self.members]
        low, high = statics, terms.size
        while high - low > 1:
            count = (low + high) // 2
            pairs = zip(small, self.members, strict=True)
            off = (difference(one.first(count).modes(), m.modes, self.heated) for one, m in pairs)
            if all(error <= SHARE * self.tolerance for error in off):
                high = count
            else:
                low = count
        return high

    def _enough(self, terms: LineTerms, statics: int, count: int) -> int:
        """Smallest number of functions whose thermal resistances are those of ``count`` of them, up to `STATIC`.

        The static fields of the members span those of other members less well than all their fields do. Looked at where
        no member was solved, and at the corners.
        """
        rows = np.vstack([self.box.draw(CANDIDATES, self.seed + 2000), self.box.corners(CANDIDATES)])
        small = [terms.member(row).first(count) for row in rows]
        all_of_them = [one.resistances(self.heated) for one in small]
        low, high = statics - 1, count
        while high - low > 1:
            middle = (low + high) // 2
            pairs = zip(small, all_of_them, strict=True)
            off = (np.abs(one.resistances(self.heated, middle) / R - 1).max() for one, R in pairs)
            if all(error <= STATIC * self.tolerance for error in off):
                high = middle
            else:
                low = middle
        return high
