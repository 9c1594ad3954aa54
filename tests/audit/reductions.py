"""Audit of the certified reduction: random heat-flow pencils, with their true error beside the bound.

    python tests/audit/reductions.py 1500

A pencil E dx/dt = -K x + F P is made with known eigenvectors or small enough for `scipy.linalg.eigh`, so that the true
transfer function costs nothing. Counted: bounds below the true error (there must be none), tolerances refused as out of
reach, and refusals with a false reason.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from time import process_time

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

import surrogate
import thermofem as th

Array = NDArray[np.float64]

ROUND_OFF = 1e-11  # of the ports' own gains: what the reference itself leaves


@dataclass(frozen=True, eq=False)
class Case:
    """One pencil with its ports, and what is asked of it."""

    name: str
    K: Array
    M: Array
    ports: Array
    tolerance: float

    @property
    def system(self) -> th.StateSpace:
        """Every port heats and reads."""
        names = tuple(f"p{k}" for k in range(self.ports.shape[1]))
        return th.StateSpace(self.M, -self.K, self.ports, self.ports.T, inputs=names, outputs=names)


@dataclass(frozen=True)
class Verdict:
    """What the audit found: ``ratio`` is the largest true error over its bound, nan where it was refused."""

    name: str
    ratio: float
    order: int
    refusal: str = ""


def case(seed: int) -> Case:
    """A random pencil: spectra of one to five decades, chains of layers, rotated dense ones; ports alike or not."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(6, 121))
    kind = ("spectrum", "chain", "dense", "clustered")[rng.integers(4)]
    slow, decades = 10 ** rng.uniform(4, 6), rng.uniform(0.5, 7)
    M = np.eye(n)
    if kind == "chain":  # layers with conductances over four decades, held at one end
        k = 10 ** rng.uniform(-2, 2, n)
        K = np.diag(k + np.append(k[1:], 0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
        M = np.diag(10 ** rng.uniform(-1, 1, n)) * 1e-6
    else:
        rate = slow * 10 ** np.sort(rng.uniform(0, decades, n))
        if kind == "clustered":
            rate = np.repeat(rate[:: max(1, n // 6)], n // len(rate[:: max(1, n // 6)]) + 1)[:n]
            rate = rate * (1 + 10 ** rng.uniform(-12, -2) * rng.standard_normal(n))
        K = np.diag(rate)
        if kind == "dense":
            turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
            mass = 10 ** rng.uniform(-1, 1, n)
            K, M = turn @ K @ turn.T, np.diag(mass)
            K = np.sqrt(mass)[:, None] * (K + K.T) / 2 * np.sqrt(mass)
    ports = _ports(rng, n)
    return Case(f"{kind} {n}, {ports.shape[1]} ports", K, M, ports, float(10 ** rng.uniform(-7, -1)))


def _ports(rng: np.random.Generator, n: int) -> Array:
    """One to three columns of either sign or none; the second and third may differ from the first by a hair only."""
    p = int(rng.choice([1, 1, 1, 2, 2, 3]))
    first = rng.standard_normal(n) if rng.random() < 0.5 else np.abs(rng.standard_normal(n))
    if rng.random() < 0.3:  # heat in a few places
        first *= rng.random(n) < 0.3
        first[rng.integers(n)] = 1.0
    columns = [first]
    for _ in range(p - 1):
        if rng.random() < 0.6:
            columns.append(first * (1 + 10 ** rng.uniform(-13, -1) * rng.standard_normal(n)))
        else:
            columns.append(rng.standard_normal(n) * 10 ** rng.uniform(-2, 2))
    return np.column_stack(columns)


def nearly_equal(d: float, seed: int) -> Case:
    """The pencil of the counter-example: ports b and b (1 + d noise) on 80 rates from 1e5 to 1e9 1/s."""
    rng = np.random.default_rng(seed)
    b = rng.standard_normal(80)
    ports = np.column_stack([b, b * (1 + d * rng.standard_normal(80))])
    return Case(f"nearly equal ports, {d:g}", np.diag(np.geomspace(1e5, 1e9, 80)), np.eye(80), ports, 1e-4)


def judge(one: Case) -> Verdict:
    """Reduce, and compare the true error with the bound at the samples of the bound and between them."""
    try:
        found = surrogate.reduce(one.system, tolerance=one.tolerance)
    except th.InputError as error:
        return Verdict(one.name, float("nan"), 0, str(error))
    rate, modes = eigh(one.K, one.M)
    full = modes.T @ one.ports
    if isinstance(found.model, th.Foster):
        theta, residues = 1 / found.model.tau[:, None, None], (found.model.R / found.model.tau)[:, None, None]
    else:
        theta = -np.diag(found.model.A)[:, None, None]
        residues = found.model.C.T[:, :, None] * found.model.B[:, None, :]
    top = found.channel_bounds * np.abs(_scale(one, rate, full))
    worst = 0.0
    low, high = rate[0] / 1e3, max(rate[-1], theta.max()) * 1e3
    for omega in np.geomspace(low, high, 700):
        exact = full.T @ (full / (rate + 1j * omega)[:, None])
        small = (residues / (theta + 1j * omega)).sum(axis=0)
        own = np.sqrt(np.outer(*[np.einsum("ia,ia,i->a", full, full, 1 / rate)] * 2))
        error = np.abs(exact - small) - ROUND_OFF * own
        if (error > top).any():
            error = np.abs(_solved(one, omega) - small) - ROUND_OFF * own
        worst = max(worst, float((error / top).max()))
    return Verdict(one.name, worst, found.order)


def _solved(one: Case, omega: float) -> Array:
    """F^T (K + i w M)^-1 F by solves that are refined with residuals in extended precision."""
    matrix = one.K + 1j * omega * one.M
    F, exact = one.ports.astype(np.clongdouble), one.K.astype(np.clongdouble) + 1j * np.longdouble(omega) * one.M
    x = np.zeros_like(F)
    for _ in range(6):
        x = x + np.linalg.solve(matrix, (F - exact @ x).astype(complex))
    return np.asarray((F.T @ x).astype(complex))


def _scale(one: Case, rate: Array, full: Array) -> Array:
    """What ``channel_bounds`` is relative to: the channel's gain, at least 1e-6 of the two ports' own."""
    gain = full.T @ (full / rate[:, None])
    own = np.sqrt(np.outer(np.diag(gain), np.diag(gain)))
    return np.maximum(np.abs(gain), 1e-6 * own)


def main(count: int) -> int:
    """Judge ``count`` random pencils and 60 of nearly equal ports; the number of bounds that are too low."""
    cases = [case(seed) for seed in range(count)]
    cases += [nearly_equal(10.0 ** -(1 + k % 12), k) for k in range(60)]
    start, broken, refused, false = process_time(), 0, 0, 0
    for number, one in enumerate(cases):
        found = judge(one)
        if found.ratio > 1:
            broken += 1
            print(f"BROKEN case {number}: {found.name}, tolerance {one.tolerance:.1e}: error {found.ratio:.3g} x bound")
        if found.refusal:
            refused += "out of reach" in found.refusal
            false += "out of reach" not in found.refusal
            print(f"refused case {number}: {found.name}, tolerance {one.tolerance:.1e}: {found.refusal}")
    print(
        f"{len(cases)} pencils, {process_time() - start:.0f} s: {broken} bounds below the true error, "
        f"{refused} out of reach, {false} refused for another reason"
    )
    return broken + false


if __name__ == "__main__":
    sys.exit(1 if main(int(sys.argv[1]) if len(sys.argv) > 1 else 1500) else 0)
