"""Balanced truncation: bound above the true error, static gain exact, Hankel singular values of another program."""

import numpy as np
import pytest
from surrogate_systems import discretized, geometries, slicot, strip

import surrogate
import thermofem as th

FREQUENCY = np.geomspace(1e3, 1e12, 50)


@pytest.mark.parametrize("geometry", list(geometries(2)))
def test_true_error_below_the_bound_and_static_gain_exact(geometry):
    system = strip(**geometry)
    exact, static = system.impedance(FREQUENCY), system.thermal_resistance
    for order in (2, 5, 9):
        small = surrogate.balanced_truncation(system, order)
        error = np.abs(exact - small.model.impedance(FREQUENCY)).max() / static
        assert small.order == order
        # the restored gain takes as much as the truncation left out: the bound is at most twice the true error
        assert error <= small.error_bound <= 2 * error
        assert small.model.passive
        assert small.model.thermal_resistance == pytest.approx(static, rel=1e-9)


def test_for_one_part_the_truncation_loses_exactly_its_bound_at_zero():
    """H(0) = 2 sum of all sigma, and what is left out of them is missing: symmetric systems attain the bound."""
    system = strip()
    small = surrogate.balanced_truncation(system, 4)
    # both traces are of X in two bases; the certificate's part of H is not among the sigma
    assert 2 * small.singular_values.sum() == pytest.approx(system.thermal_resistance, rel=1e-9)
    assert small.error_bound == pytest.approx(2 * small.truncation_bound + small.certificate, rel=1e-9)


def test_a_channel_between_two_parts():
    system = discretized(heater=True, smallest=0.2).state_space(("core", "heater"), ("core", "heater"))
    channel = system.channel("heater", "core")
    exact = channel.impedance(FREQUENCY)
    for order in (4, 8):
        small = surrogate.balanced_truncation(channel, order)
        error = np.abs(exact - small.model.impedance(FREQUENCY)).max() / channel.thermal_resistance
        assert error <= small.error_bound
        assert small.model.thermal_resistance == pytest.approx(channel.thermal_resistance, rel=1e-8)
    assert (small.model.inputs, small.model.outputs) == (("heater",), ("core",))
    with pytest.raises(th.InputError, match="pick one of each"):
        surrogate.balanced_truncation(system, 4)


@pytest.mark.parametrize(
    "model", [None, th.Foster([1.0], [1e-6]), th.Quadratic([[-1.0]], [[[0.0]]], [[0.0]], [1.0], [1.0])]
)
def test_what_has_no_matrices_of_heat_flow_is_refused(model):
    words = f"system is a {type(model).__name__}; the StateSpace of a heat problem"
    for make in (surrogate.reduce, lambda m: surrogate.balanced_truncation(m, 2)):
        with pytest.raises(th.InputError, match=words):
            make(model)


def test_the_bound_holds_where_a_transfer_is_largest_beside_zero_frequency():
    """Modes of either sign nearly cancel at rest: H_r is largest elsewhere, and so is what restoring the gain costs."""
    rate = np.array([2.2, 1.4, 1.6, 3.9, 0.6, 0.7, 0.4]) * 1e6
    heat = 1e3 * np.array([-0.4, 1.7, -0.4, 1.2, 0.8, 0.7, 0.8])
    read = 1e3 * np.array([-1, 0.4, 1.6, -0.7, 0, -0.7, 0.3])
    names = {"inputs": ("one",), "outputs": ("other",)}
    system = th.StateSpace(np.eye(7), -np.diag(rate), heat[:, None], read[None], **names)
    static, s = (heat * read / rate).sum(), 2j * np.pi * np.geomspace(1e2, 1e8, 300)
    exact = (heat * read / (s[:, None] + rate)).sum(axis=1)
    for order in (4, 5, 6):
        small = surrogate.balanced_truncation(system, order, tolerance=1e-3)
        error = np.abs(exact - small.model.impedance(s.imag / (2 * np.pi))).max() / abs(static)
        assert error <= small.error_bound
        assert error > small.truncation_bound  # so that what restoring the gain costs decides


def test_lifted_states_give_the_field_whose_mean_is_the_model():
    system = discretized(heater=True, smallest=0.2).state_space(("core", "heater"), ("core", "heater"))
    system = system.channel("heater", "core")
    small = surrogate.balanced_truncation(system, 6)
    states = np.asarray(small.model.R) * 1e-3  # settled at 1 mW
    mean = system.C[0] @ small.lift(states)
    assert mean == pytest.approx(1e-3 * small.model.thermal_resistance, rel=1e-9)


def test_hankel_singular_values_are_those_of_pymor():
    from pymor.models import iosys

    system = slicot()
    theirs = np.asarray(iosys.LTIModel.from_matrices(system.A.toarray(), system.B, system.C).hsv())
    small = surrogate.balanced_truncation(system, 5, tolerance=1e-7)
    # a singular value moves by less than the largest error over all frequencies, which is certified
    assert small.singular_values[:8] == pytest.approx(theirs[:8], rel=0, abs=small.certificate * 0.1105583195)
    assert small.model.thermal_resistance == pytest.approx(0.1105583195, abs=5e-11)


@pytest.mark.parametrize(("order", "reason"), [(0, "order"), (99, "order"), (1.5, "whole")])
def test_orders_out_of_range(order, reason):
    with pytest.raises(th.InputError, match=reason):
        surrogate.balanced_truncation(strip(), order)
