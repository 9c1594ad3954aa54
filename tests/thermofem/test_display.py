"""What a notebook shows: well-formed, escaped, with the numbers that matter."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from html import escape

import numpy as np
import pytest

import surrogate
import thermofem as th

LINEAR = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
EYE = np.eye(2)
TIMES = np.geomspace(1e-9, 1e-4, 60)
SHOWN = {
    "Foster": (LINEAR, ["Foster", "7 K/mW", "50 ns to 1 us"]),
    "OutputMap": (th.OutputMap(LINEAR, -4e-4), ["OutputMap", "z + (-0.0004 /K) z²"]),
    "StateSpace": (th.StateSpace(EYE, -EYE, EYE, EYE, ("a", "b"), ("a", "b")), ["StateSpace", "a, b"]),
    "Quadratic": (th.Quadratic(-1e6 * EYE, np.zeros((2, 2, 2)), 0 * EYE, [1e9, 1e9], [1, 1]), ["2 K/mW"]),
    "strip": (th.strip_ring(), ["layer box", "SiO2, 2 um", "heated"]),
    "disc": (th.disc(), ["part"]),
}


def words(shown):
    text = shown._repr_html_()
    ET.fromstring(text)  # every tag closed, every < escaped
    return text


@pytest.mark.parametrize("case", SHOWN)
def test_a_notebook_shows(case):
    shown, expected = SHOWN[case]
    text = words(shown)
    for word in expected:
        assert word in text


def test_a_fit_and_a_reduction_show_their_errors():
    data = th.dataset.build(TIMES, LINEAR.response(th.Constant(1e-3), TIMES), th.Constant(1e-3))
    fit, heat = words(surrogate.fit_newton(data)), th.assemble(th.strip_ring())
    assert all(word in fit for word in ("tau_th", " ± ", "misfit"))
    assert "of R_th at every frequency" in words(surrogate.reduce(heat.system, 1e-3))
    assert all(word in words(heat) for word in ("2508", "substrate, box, cladding, core", "part core"))
    assert repr(heat) == "HeatProblem('strip ring', 2508 unknowns, accuracy 0.001, heated core)"


def test_materials_list_themselves():
    text = str(th.materials)
    assert list(th.materials)[:2] == ["Si", "SiO2"]
    assert len(text.splitlines()) == len(th.materials) + 1
    for name in th.materials:
        material = th.materials[name]
        assert f"{material.conductivity:g}" in next(line for line in text.splitlines() if line.startswith(f"{name} "))
        assert escape(material.source, quote=False) in words(th.materials)
    assert "void" not in text
