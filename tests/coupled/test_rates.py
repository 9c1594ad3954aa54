"""The rates in Python against the compiled equations, which are differentiated by dual numbers."""

from dataclasses import replace

import numpy as np
import pytest

import coupled
import thermofem as th
from coupled.kernel import rates as closed
from coupled.kernel.tableaus import Method
from coupled.kernel.units import internal_rates, single_ring

RINGS = {
    "trap-assisted lifetime": coupled.borghi2021(),
    "constant lifetime, one bus": coupled.vanvaerenbergh2012(),
    "no carriers": replace(coupled.borghi2021(), tpa_coefficient=0.0),
}


@pytest.fixture(params=RINGS, name="ring")
def _ring(request):
    return RINGS[request.param]


def states(ring, count=20):
    """Random states (Re a, Im a, N, x) of a ring with one pole, and the compiled dy/dt and Jacobian there."""
    rng = np.random.default_rng(3)
    model = th.Foster(R=[7e3], tau=[1e-6])
    problem = single_ring(ring, model, 2e-3, 0.0, 1.0, Method.RODAS4)
    for _ in range(count):
        y = np.array([*rng.normal(0, 4, 2), 10 ** rng.uniform(-3, 0.5), rng.uniform(0, 10)])
        yield y, *problem.slopes(y)


def test_carriers_are_made_and_lost_as_the_kernel_says(ring):
    rates, _ = internal_rates(ring)
    for (re, im, N, _), slopes, J in states(ring):
        lost, by_N = closed.recombination(N, rates)
        made = rates.g * (re**2 + im**2) ** 2
        # round-off of sums of about ten terms
        assert slopes[2] == pytest.approx(made - lost, rel=1e-12, abs=1e-14)
        assert J[2, 2] == pytest.approx(-by_N, rel=1e-12)


def test_loss_and_dispersion_are_those_of_the_kernel(ring):
    """d(da/dt)/da without the coupling of Re a and Im a: the radial part is -gamma, the rotation dS/dN."""
    rates, fcd = internal_rates(ring)
    for (re, im, N, _), slopes, J in states(ring):
        U = re**2 + im**2
        radial = (re * slopes[0] + im * slopes[1]) / U
        gamma = closed.field_loss(U, N, rates)
        by_N = (re * J[0, 2] + im * J[1, 2]) / U
        turned = (re * J[1, 2] - im * J[0, 2]) / U
        _, slope = closed.dispersion(N, fcd)
        assert by_N == pytest.approx(-rates.fca, rel=1e-10, abs=1e-14)
        assert turned == pytest.approx(-slope, rel=1e-9)  # da/dt = i D a with D = -S(N) - ...
        pump = np.sqrt(2 * ring.bus_rate * 1e-9 * 2e-3 / 1e-6)
        assert radial == pytest.approx(-gamma + pump * im / U, rel=1e-9, abs=1e-10)


def test_heat_and_its_slopes_are_those_of_the_kernel(ring):
    rates, _ = internal_rates(ring)
    gain = 7e3 * 1e-6 * 1e-9 / 1e-6  # K/fJ, of the pole: R/tau
    rate = 1e-9 / 1e-6  # 1/ns
    for (re, im, N, x), slopes, J in states(ring):
        U = re**2 + im**2
        by_U, by_N = closed.absorbed_slopes(U, N, rates)
        P = closed.absorbed_power(U, N, rates)
        assert slopes[3] + rate * x == pytest.approx(gain * P, rel=1e-9)
        assert J[3, 0] == pytest.approx(gain * by_U * 2 * re, rel=1e-9, abs=1e-15)
        assert J[3, 2] == pytest.approx(gain * by_N, rel=1e-9, abs=1e-15)


def test_steady_carriers_balance_and_their_slope_is_that_of_differences(ring):
    rates, _ = internal_rates(ring)
    made = np.geomspace(1e-9, 1.0, 40) if rates.b else np.geomspace(1e-9, 1e-2, 40)
    N, slope = closed.steady_carriers(made, rates)
    lost, _ = closed.recombination(N, rates)
    np.testing.assert_allclose(lost, made, rtol=1e-11)  # N without cancellation: a few round-offs
    step = 1e-4 * made
    above, _ = closed.steady_carriers(made + step, rates)
    below, _ = closed.steady_carriers(made - step, rates)
    # a central difference leaves the square of the step, 1e-8, and the error of N, 1e-12, over the step
    np.testing.assert_allclose((above - below) / (2 * step), slope, rtol=1e-7)
