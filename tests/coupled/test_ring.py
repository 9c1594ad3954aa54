"""The ring and its published parameters: derived rates, variants, and slips of unit."""

from __future__ import annotations

from dataclasses import replace

import pytest

import coupled
from coupled import parameters as paper
from thermofem import InputError

RING = coupled.borghi2021()


def test_derived_rates_are_those_of_the_paper(validated):
    # Computed by hand from the tables with CODATA constants; as many digits as are written here.
    shift = RING.thermal_shift
    validated("Coupled dynamics", "thermal shift", shift, 6.46811e10, rel=1e-6, unit="rad/s/K", source="by hand")
    assert RING.eta_fca == pytest.approx(1.022020e-13, rel=1e-6, abs=0)
    assert RING.eta_tpa == pytest.approx(5.55711e21, rel=1e-6)
    assert RING.g_tpa == pytest.approx(9.87769e57, rel=1e-6)
    assert RING.linear_rate == pytest.approx(91.5e9, rel=1e-12)


def test_quality_factors_lie_within_the_measured_error_bars(validated):
    measured = "measured, with its error bar (the paper, Section 2)"
    validated("Coupled dynamics", "loaded Q", RING.loaded_q, 6.5e3, within=0.2e3, source=measured)
    validated("Coupled dynamics", "intrinsic Q", RING.intrinsic_q, 1.11e5, within=0.08e5, source=measured)


@pytest.mark.parametrize(
    ("ring", "tau0", "a"),
    [(RING, 35.59162e-9, 1.6155486e-21), (RING.with_swapped_srh(), 23.41999e-9, 2.4551664e-21)],
    ids=["printed", "swapped"],
)
def test_recombination_constants(ring, tau0, a):
    # By hand from Eq. 4 and Table 2; the tolerance is one unit of the last digit written.
    assert ring.carriers.tau0 == pytest.approx(tau0, rel=3e-7, abs=0)
    assert ring.carriers.a == pytest.approx(a, rel=3e-8, abs=0)
    assert ring.carriers.b == pytest.approx(9.9999975e-22, rel=3e-8, abs=0)


def test_variants_change_what_they_say_and_nothing_else():
    lumped = RING.with_lumped_fcd()
    assert lumped.fcd == ((-9.5e-27, 1.0),)
    assert replace(lumped, fcd=RING.fcd, name=RING.name) == RING
    swapped = RING.with_swapped_srh()
    assert (swapped.carriers.tau_n, swapped.carriers.tau_p) == (22.5e-9, 35e-9)
    assert replace(swapped, carriers=RING.carriers, name=RING.name) == RING
    with pytest.raises(InputError, match="lumped_fcd"):
        replace(RING, lumped_fcd=None).with_lumped_fcd()


def test_thermal_parameter_sets_have_the_static_gain_the_paper_quotes():
    # kappa tau_f tau_s / (m c_p) with the printed numbers, in K/W; caption of Fig. 5 and Section 5.
    sets = (paper.SECOND_ORDER_FEM, paper.SECOND_ORDER_EXPERIMENT)
    gains = [s.kappa * s.tau_f * s.tau_s / s.heat_capacity for s in sets]
    assert gains == pytest.approx([7784.2, 7140.5], abs=0.05)
    assert paper.NEWTON_FIT.heat_capacity == pytest.approx(6.9 * 7.63e-12, rel=1e-12, abs=0)
