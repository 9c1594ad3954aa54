"""A heat capacity with a kink: what groups of nodes know of it, against the law at every node."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from models import coarse_warm_fem

import thermofem as th
from thermofem.algebra.krylov import krylov
from thermofem.transient.nonlinear import curvature


@cache
def kinked():
    """Capacities that are constant up to 7 K above ambient, and steep from there on; the system and its fields."""
    system, law = coarse_warm_fem(), th.materials.Table((307, 400, 500), (700.0, 950.0, 1050.0), reference=307)
    laws = tuple((law, at) for _, at in system.content.laws)
    system = replace(system, content=replace(system.content, laws=laws))
    return system, krylov(system.linear)


def amplitudes(basis):
    """A pulse of 10 K and steady heat of 12 K."""
    steady = basis.heating[:, 0] / basis.rate
    both = np.stack([steady * (1 - np.exp(-basis.rate * 50e-9)), steady])
    hottest = np.abs(both @ basis.vectors.T).max(axis=1)
    return both * np.array([10.0, 12.0])[:, None] / hottest[:, None]


def test_a_kink_of_the_heat_capacity_counts():
    system, basis = kinked()
    forms, z = curvature(system, basis), amplitudes(basis)
    held, parabolas = forms(z)[1], replace(forms, departures=())(z)[1]
    x = z @ basis.vectors.T
    exact = np.stack([system.content(row) - system.linear.E @ row for row in x]) @ basis.vectors
    apart = [np.linalg.norm(found - exact, axis=1) / np.linalg.norm(exact, axis=1) for found in (held, parabolas)]
    assert np.all(apart[0] < [0.35, 0.15])  # the groups are small, not points
    assert np.all(apart[0] < apart[1] / 2)


def test_the_derivative_along_a_slope():
    system, basis = kinked()
    forms, z = curvature(system, basis), amplitudes(basis)
    slope, step = z[::-1], 1e-5
    for found, plus, minus in zip(forms.along(z, slope), forms(z + step * slope), forms(z - step * slope), strict=True):
        assert found == pytest.approx((plus - minus) / (2 * step), rel=0, abs=1e-6 * np.abs(found).max())
