"""The right-hand side against the equations as printed, its Jacobian, and known fixed points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rings import LAWS, NETWORKS, RING, SECOND_ORDER, printed_equations, state

from coupled.kernels import equations as eq


def right_hand_side(y, power, detuning, ring, model):
    rates, fcd = eq.internal_rates(ring)
    drive, shift = eq.internal_pump(ring, power), eq.internal_detuning(detuning)
    return eq.right_hand_side(y, drive, shift, rates, fcd, eq.internal_thermal(model))


def jacobian(y, detuning, ring, model):
    rates, fcd = eq.internal_rates(ring)
    return eq.jacobian(y, eq.internal_detuning(detuning), rates, fcd, eq.internal_thermal(model))


@pytest.mark.parametrize(("power", "detuning"), [(6.31e-3, 0.0), (1e-2, -17e9)])
def test_right_hand_side_is_the_printed_one_in_other_units(power, detuning):
    y = state(2)
    got = right_hand_side(y, power, detuning, RING, SECOND_ORDER) / eq.NS  # per second
    a, N = (y[0] + 1j * y[1]) * math.sqrt(eq.FJ), y[2] * eq.DENSITY
    da, dN, dx = printed_equations(a, N, y[3:], power, detuning, SECOND_ORDER)
    want = np.array([da.real / math.sqrt(eq.FJ), da.imag / math.sqrt(eq.FJ), dN / eq.DENSITY, *dx])
    # Round-off of sums of a dozen terms up to 100 times larger than the result, and eps^2/N^2 = 1e-17 in S(N).
    assert got == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize("poles", NETWORKS)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("carriers", [1.7, 1e-3])
def test_jacobian_is_the_derivative(poles, law, carriers):
    y, model = state(poles, carriers), NETWORKS[poles]
    analytic = jacobian(y, -3e9, LAWS[law], model)
    numeric = np.empty_like(analytic)
    for j in range(y.size):
        # Fourth-order differences with a step of 1e-3 of the state: truncation 1e-12 f^(5) y^4/f', and round-off of
        # 1e-16 f/(h f'), worst for the heat (100 fJ/ns) by few carriers (h = 1e-6): 1e-10 of the row's largest entry.
        h = 1e-3 * abs(y[j])
        f = [right_hand_side(y + k * h * np.eye(y.size)[j], 6.31e-3, -3e9, LAWS[law], model) for k in (-2, -1, 1, 2)]
        numeric[:, j] = (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)
    scale = np.abs(analytic).max(axis=1, keepdims=True)
    assert np.abs((analytic - numeric) / scale).max() < 1e-7


def test_dispersion_is_smooth_at_zero_and_a_power_beyond():
    rates_fcd = eq.internal_rates(RING)[1]
    shift, slope = eq.dispersion(0.0, rates_fcd)
    assert shift == 0
    assert math.isfinite(slope)
    N = 1e-4  # 1e19 per m^3: eps/N = 1e-4 changes N^0.8 by 0.1 eps^2/N^2 = 1e-9
    want = RING.index_rate * eq.NS * (-1.07e-27 * N * eq.DENSITY - 1.63e-22 * (N * eq.DENSITY) ** 0.8)
    assert eq.dispersion(N, rates_fcd)[0] == pytest.approx(want, rel=2e-9)
    assert eq.dispersion(-N, rates_fcd)[0] == -eq.dispersion(N, rates_fcd)[0]  # a step may overshoot below zero


def fixed_point(U, N, dT, detuning):
    """The state at a fixed point from its energy (fJ), carriers (1e23/m^3) and temperature."""
    rates, fcd = eq.internal_rates(RING)
    gamma = rates.loss + rates.fca * N + rates.tpa * U
    D = -rates.thermal_shift * dT - eq.dispersion(N, fcd)[0] - eq.internal_detuning(detuning)
    drive = math.sqrt(U * (gamma**2 + D**2))
    a = 1j * drive / (gamma - 1j * D)
    share = SECOND_ORDER.R / SECOND_ORDER.thermal_resistance
    return np.array([a.real, a.imag, N, *(share * dT)]), drive


def test_fixed_point_at_8_dbm_on_resonance():
    # Computed by a one-dimensional scan in U, seven digits. Rounding dT by 5e-7 K and N by 5e-7 shifts D by 1e-4 rad/ns
    # of gamma = 330 rad/ns, so the power that belongs to U is known to 1e-6; the other residuals to the digits of U.
    y, drive = fixed_point(18.740013, 1.990834, 6.945106, 0.0)
    power = 10**0.8 * 1e-3
    assert drive**2 == pytest.approx(eq.internal_pump(RING, power) ** 2, rel=2e-6)
    residual = right_hand_side(y, power, 0.0, RING, SECOND_ORDER)
    rates = eq.internal_rates(RING)[0]
    assert abs(residual[:2]).max() < 2e-6 * drive
    assert abs(residual[2]) < 5e-7 * rates.g * 18.74**2
    assert abs(residual[3:]).max() < 5e-7 * (eq.internal_thermal(SECOND_ORDER).poles[1] * y[3:]).max()


def test_eigenvalues_at_that_fixed_point():
    # An unstable focus, a real pole and the optical pair, per ns; digits as far as they were computed. D known to 1e-4
    # of 330 rad/ns and the slow eigenvalues a small difference of large terms: a few units of 1e-6 of the fast rates.
    y, _ = fixed_point(18.740013, 1.990834, 6.945106, 0.0)
    values = np.linalg.eigvals(jacobian(y, 0.0, RING, SECOND_ORDER))
    values = sorted(values[values.imag >= 0], key=lambda v: -v.real)
    assert values[0] == pytest.approx(0.01518554 + 0.006693j, abs=2e-6)
    assert values[1] == pytest.approx(-0.00580991, abs=1e-7)
    assert values[2] == pytest.approx(-112.08 + 128.18j, abs=0.01)


@pytest.mark.parametrize(
    ("U", "unstable", "focus"), [(10.100040, 0, False), (15.548322, 1, False), (21.760990, 2, True)]
)
def test_three_fixed_points_at_7_dbm_minus_28_ghz(U, unstable, focus):
    # Stable node, saddle, unstable focus, from the same scan. N is the positive root of the carriers' balance and
    # dT = R_th P_abs, so the power tells whether all fits: dP/P = 2 D dD/(gamma^2 + D^2) ~ 1e-6 for eight digits of U.
    rates = eq.internal_rates(RING)[0]
    b, c = 1 - rates.a * rates.tau0 * rates.g * U**2, -rates.tau0 * rates.g * U**2
    N = (-b + math.sqrt(b * b - 4 * rates.b * c)) / (2 * rates.b)
    dT = SECOND_ORDER.thermal_resistance * eq.UW * eq.absorbed_power(U, N, rates)
    y, drive = fixed_point(U, N, dT, -28e9)
    assert drive**2 == pytest.approx(eq.internal_pump(RING, 10**0.7 * 1e-3) ** 2, rel=1e-6)
    growing = np.linalg.eigvals(jacobian(y, -28e9, RING, SECOND_ORDER))
    growing = growing[growing.real > 0]
    assert growing.size == unstable
    assert np.any(growing.imag != 0) == focus
