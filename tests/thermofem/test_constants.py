"""The constants of physics are those of SciPy, and those of the page of `explore`."""

from __future__ import annotations

import re

import pytest
import scipy.constants

from coupled.explore.bundle import text_of
from thermofem import constants


@pytest.mark.parametrize("name", ["c", "h", "hbar", "e", "k"])
def test_constants_are_those_of_scipy(name):
    """Exact by definition; hbar is rounded to the next double in both."""
    assert getattr(constants, name) == pytest.approx(getattr(scipy.constants, name), rel=2e-16)


@pytest.mark.parametrize(
    ("module", "name", "value"),
    [
        ("ring", "C", constants.c),
        ("ring", "HBAR", constants.h),  # the numerator of h / (2 pi)
        ("script", "BOLTZMANN", constants.k),
        ("script", "CHARGE", constants.e),
    ],
)
def test_the_page_has_the_same(module, name, value):
    written = re.search(rf"^const {name} = ([\d.e-]+)", text_of(f"page/{module}.mjs"), re.MULTILINE)
    assert float(written[1]) == value
