"""Optical numbers of the rings of a family: a polynomial of each over the box of parameters, with its error.

    y(p) = sum over k of c_k T_k1(x_1) T_k2(x_2) ...,    k1 + k2 + ... <= degree,    x = 2 share - 1

T Chebyshev's polynomials; y is the logarithm of the couplings and of what a bend radiates. By least squares over
members whose modes and couplers are solved on moved meshes; members left out give the error of every number.
"""

from __future__ import annotations

import itertools
import logging
from dataclasses import dataclass, replace
from math import comb
from typing import Any

import numpy as np

from thermofem import CrossSection, checks
from thermofem.arrays import Array
from thermofem.fem.assembly import assemble_like
from thermofem.optics.coupler import of_buses
from thermofem.optics.mode import LEAST
from thermofem.optics.modes import Light
from thermofem.optics.shape import numbers

from .members import Solver
from .parameter_box import Box

MOST_TERMS = 40  # of a polynomial
DEGREES = 1, 4  # lowest and highest
PER_TERM = 2  # members solved for each term, beside corners of the box
LEFT_OUT = 8  # members that give the errors
ACCURACY = 1e-3  # of the meshes of the heat, on which modes are within 2e-4

log = logging.getLogger("thermofem")


@dataclass(frozen=True, eq=False)
class OpticalNumbers:
    """Polynomials of the optical numbers over a box.

    names: those of `thermofem.optics.shape.numbers`, "loss" [1/m] where [light] has it, "kappa 0" and "kappa 1":
        kappa^2 of every bus, and "radiated" [1/s].
    powers [shape (terms, p)]: degrees of the polynomials in each term.
    coefficients [shape (terms, numbers)]
    errors [shape (numbers,)]: largest relative error over members left out.
    solved: how many members were solved.
    """

    names: tuple[str, ...]
    powers: Array
    coefficients: Array
    errors: Array
    solved: int

    def at(self, share: Array) -> dict[str, float]:
        """The numbers at a place in the box, 0 to 1 of each range."""
        return dict(zip(self.names, self.rows(share[None])[0].tolist(), strict=True))

    def rows(self, shares: Array) -> Array:
        """The numbers at many places, shape (n, numbers)."""
        found = chebyshev(shares, self.powers) @ self.coefficients
        grow = np.array([_logarithmic(name) for name in self.names])
        found[:, grow] = np.exp(found[:, grow])
        silent = self.names.index("radiated")
        found[:, silent] = np.where(found[:, silent] > 2 * LEAST, found[:, silent] - LEAST, 0.0)
        return np.asarray(found)

    def moves(self, k: int) -> bool:
        """Whether the k-th parameter moves any number over its range."""
        ends = np.full((2, self.powers.shape[1]), 0.5)
        ends[:, k] = 0.0, 1.0
        low, high = self.rows(ends)
        return bool((np.abs(high - low) > 1e-6 * np.abs(low)).any())

    @property
    def error(self) -> dict[str, float]:
        """Largest relative error of every number over members left out."""
        return dict(zip(self.names, self.errors.tolist(), strict=True))

    def words(self) -> str:
        """The errors of the index, of the group index and of the couplings, and the largest of the others."""
        rest = {name: error for name, error in self.error.items() if not name.startswith("kappa")}
        kappas = [error for name, error in self.error.items() if name.startswith("kappa")]
        worst = max(rest, key=lambda name: rest[name])
        return (
            f"n_eff {rest['n_eff']:.1e}, "
            + (f"kappa^2 {max(kappas):.1e}, " if kappas else "")
            + (f"of the others at most {rest[worst]:.1e} ({worst})")
        )

    def content(self) -> tuple[dict[str, Any], dict[str, Array]]:
        """What a family's file keeps: words, and arrays."""
        arrays = {f"optics_{name}": getattr(self, name) for name in ("powers", "coefficients", "errors")}
        return {"names": list(self.names), "solved": self.solved}, arrays

    @classmethod
    def of_content(cls, words: dict[str, Any], arrays: dict[str, Array]) -> OpticalNumbers:
        """The inverse of `content`."""
        names = checks.check_names("optics", words["names"])
        powers, coefficients, errors = (arrays[f"optics_{name}"] for name in ("powers", "coefficients", "errors"))
        if coefficients.shape != (len(powers), len(names)) or errors.shape != (len(names),):
            raise ValueError("optics: names and coefficients do not fit")
        return cls(names, powers, coefficients, errors, checks.integer("solved", words["solved"], 1, np.inf))


def train_optics(box: Box, seed: int, solver: Solver) -> OpticalNumbers:
    """Solve modes and couplers of members, and fit the polynomials.

    Raises InputError: more than a quarter of the members are no rings; the reason is that of the last one.
    """
    powers = total_degree(box.size)
    rows = np.vstack([box.middle[None], box.corners(16), box.draw(PER_TERM * len(powers), seed)])
    test = box.draw(LEFT_OUT, seed, unseen=True)
    every, base = np.vstack([rows, test]), box.base.to_toml()
    tasks = [(base, box.geometry(row).to_toml()) for row in every]
    found = replace(solver, store=None)(numbers_of, tasks, every)
    made = [one if isinstance(one, dict) else None for one in found]
    missing, reason = made.count(None), next((one for one in found[::-1] if isinstance(one, str)), "")
    if missing > len(made) / 4:
        raise checks.InputError(f"{missing} of {len(made)} members are no rings; the last one said: {reason}")
    if missing:
        log.warning("optics: %d of %d members are left out; the last one said: %s", missing, len(made), reason)
    names = tuple(next(one for one in made if one is not None))
    there = np.array([one is not None for one in made])
    table = np.array([[one[name] for name in names] for one in made if one is not None])
    learn = (np.arange(len(made)) < len(rows))[there]
    values = table + LEAST * np.array([name == "radiated" for name in names])
    grow = np.array([_logarithmic(name) for name in names])
    values[:, grow] = np.log(values[:, grow])
    shares = box.share(every[there])
    coefficients = np.linalg.lstsq(chebyshev(shares[learn], powers), values[learn], rcond=None)[0]
    curve = OpticalNumbers(names, powers, coefficients, np.zeros(len(names)), len(table))
    off = np.abs(curve.rows(shares) - table)[~learn] / np.maximum(np.abs(table[~learn]), 1e-300)
    return replace(curve, errors=np.where(table[~learn] == 0, 0.0, off).max(axis=0))


def numbers_of(base: str, geometry: str) -> dict[str, float] | str:
    """The numbers of one member, or why it has none; the texts of the geometry whose mesh moves, and of the member."""
    try:
        heat = assemble_like(base, CrossSection.from_toml_text(geometry), ACCURACY)
        mode, given = Light.of(heat).mode(), heat.geometry.light
        kappas = {f"kappa {k}": bus.power for k, bus in enumerate(of_buses(mode, heat.geometry.buses))}
        loss = {} if given is None or given.loss is None else {"loss": given.loss}
        return numbers(mode) | loss | kappas | {"radiated": mode.radiation_rate}
    except checks.InputError as error:
        return str(error)


def total_degree(size: int) -> Array:
    """Powers of all terms of the highest total degree that has at most `MOST_TERMS` of them, shape (terms, size)."""
    low, high = DEGREES
    degree = max(d for d in range(low, high + 1) if d == low or comb(size + d, d) <= MOST_TERMS)
    return np.array([k for k in itertools.product(range(degree + 1), repeat=size) if sum(k) <= degree])


def chebyshev(shares: Array, powers: Array) -> Array:
    """Products of Chebyshev's polynomials at places in the box, shape (n, terms)."""
    each = np.cos(np.arange(powers.max() + 1) * np.arccos(np.clip(2 * shares - 1, -1, 1))[..., None])
    return np.asarray(np.prod([each[:, k, column] for k, column in enumerate(powers.T)], axis=0))


def _logarithmic(name: str) -> bool:
    return name.startswith("kappa") or name == "radiated"
