"""What a notebook shows: well-formed, escaped, with the numbers that matter."""

from __future__ import annotations

import inspect
import xml.etree.ElementTree as ET
from enum import Enum
from html import escape
from typing import Protocol

import numpy as np
import pytest
from surrogate_systems import strip

import coupled
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
    text = words(surrogate.fit_newton(data))
    assert "tau_th" in text
    assert " ± " in text
    assert "misfit" in text
    assert "of R_th at every frequency" in words(surrogate.reduce(strip(smallest=0.3), 1e-3))


def test_a_heat_problem_shows_what_can_be_heated_and_read():
    heat = th.assemble(th.strip_ring())
    text = words(heat)
    assert "2508" in text
    assert "substrate, box, cladding, core" in text
    assert "part core" in text
    assert repr(heat) == "HeatProblem('strip ring', 2508 unknowns, accuracy 0.001, heated core)"


def test_no_result_fills_the_terminal():
    rom = surrogate.reduce(strip(smallest=0.3), 1e-3)
    data = th.dataset.build(TIMES, LINEAR.response(th.Constant(1e-3), TIMES), th.Constant(1e-3))
    for shown in (rom, surrogate.fit_foster(data, order=2), LINEAR, th.assemble(th.strip_ring())):
        assert len(repr(shown)) < 1200, type(shown)


NO_OBJECTS = (BaseException, Enum, Protocol)  # errors, choices and contracts


@pytest.mark.parametrize("package", [th, surrogate, coupled])
def test_every_public_class_has_a_notebook_display(package):
    classes = [c for c in (getattr(package, name) for name in package.__all__) if inspect.isclass(c)]
    assert classes
    objects = [c for c in classes if not issubclass(c, NO_OBJECTS) and not getattr(c, "_is_protocol", False)]
    assert [c.__name__ for c in objects if not hasattr(c, "_repr_html_")] == []


LARGE = {
    "ring": coupled.borghi2021,
    "geometry": th.strip_ring,
    "mesh": lambda: th.assemble(th.strip_ring()).mesh,
    "matrices": lambda: th.assemble(th.strip_ring()).system,
    "discretization": lambda: th.assemble(th.strip_ring()).discretization,
    "samples": lambda: th.Sampled(np.linspace(0, 1, 900), np.ones(900)),
    "Foster": lambda: th.Foster(R=np.ones(100), tau=np.ones(100)),
    "circuit": lambda: coupled.crow([coupled.borghi2021()] * 9),
    "corrector": lambda: coupled.FEM(th.assemble(th.strip_ring())),
    "event": lambda: coupled.Event("carriers", 1e23),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_objects_fit_three_lines(name):
    shown = LARGE[name]()
    assert len(repr(shown)) <= 3 * 116
    assert "\n" not in repr(shown)
    assert repr(shown).startswith(type(shown).__name__ + "(")
    words(shown)


def test_materials_list_themselves():
    text = str(th.materials)
    assert list(th.materials)[:2] == ["Si", "SiO2"]
    assert len(text.splitlines()) == len(th.materials) + 1
    for name in th.materials:
        material = th.materials[name]
        assert f"{material.conductivity:g}" in next(line for line in text.splitlines() if line.startswith(f"{name} "))
        assert escape(material.source) in words(th.materials)
    assert "void" not in text
