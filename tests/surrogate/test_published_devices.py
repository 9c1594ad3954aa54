"""Figures of published devices from their stacks: what docs/measured.toml says was computed."""

from __future__ import annotations

import pytest
from devices import DEVICES, computed

pytestmark = pytest.mark.slow
# rounding to three digits, 0.5 %; the mesh, 0.5 % in R_th, up to threefold in times and bandwidths on a flat tail
WITHIN = 0.02


@pytest.mark.parametrize("row", DEVICES, ids=[row["name"] for row in DEVICES])
def test_figures_of_published_devices(row):
    found = computed(row)
    for figure in row["figure"]:
        ours, low, high = found[figure["kind"]]
        assert ours == pytest.approx(figure["ours"], rel=WITHIN, abs=0), figure["what"]
        assert [low, high] == pytest.approx(figure["range"], rel=WITHIN, abs=0), figure["what"]


def test_static_figures_agree_with_the_laboratory_within_what_is_unknown():
    """π powers, tunings and resistances, as the validation page says."""
    static = {"pi_power", "tuning", "resistance", "undercut"}
    ratios = [f["ours"] / f["published"] for row in DEVICES for f in row["figure"] if f["kind"] in static]
    assert len(ratios) >= 6
    assert all(0.7 < ratio < 1.3 for ratio in ratios), ratios
