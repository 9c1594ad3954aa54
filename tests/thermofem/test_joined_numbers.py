"""Equal lengths that differ by round-off, and warnings for each geometry of one name."""

import logging
from dataclasses import replace

import pytest

import thermofem as th
from thermofem.fem import domain_truncation

OFF_AXIS = """
name = "bar"
kind = "straight"
length = "100 um"
half_width = "{half} um"
[[layer]]
name = "substrate"
material = "Si"
thickness = "5 um"
[[layer]]
name = "box"
material = "SiO2"
thickness = "3 um"
datum = true
[[layer]]
name = "cladding"
material = "SiO2"
thickness = "3.22 um"
[[part]]
name = "core"
material = "Si"
x = "1 um"
width = "450 nm"
bottom = "0 nm"
height = "220 nm"
heated = true
"""


def test_a_depth_that_is_a_half_width_but_for_round_off():
    """5 um + 3 um is 8.000000000000001 um: R_th is between those of the neighbouring widths, which differ by 0.1 %."""
    narrow, equal, wide = (
        th.assemble(th.CrossSection.from_toml_text(OFF_AXIS.format(half=half))).thermal_resistance("core")
        for half in ("7.9", "8", "8.1")
    )
    assert wide < equal < narrow


def test_each_length_of_a_guide_warns(caplog, monkeypatch):
    """The ends take a larger part of the heat the shorter the guide is: each says its own number."""
    monkeypatch.setattr(domain_truncation, "_reported", set())
    with caplog.at_level(logging.INFO, logger="thermofem"):
        for length in (320e-6, 100e-6, 30e-6):
            heat = th.assemble(replace(th.straight_guide(length=length), name="guide"))
            share = heat.errors("core")[1]
            assert f"moves R_th by {share:.1e}" in caplog.messages[-1]
    assert len(caplog.messages) == 3


def test_an_equal_geometry_warns_once(caplog, monkeypatch):
    monkeypatch.setattr(domain_truncation, "_reported", set())
    with caplog.at_level(logging.INFO, logger="thermofem"):
        for _ in range(2):
            th.assemble(th.straight_guide(length=100e-6)).errors("core")
    assert len(caplog.messages) == pytest.approx(1)
