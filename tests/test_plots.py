"""Every plot function: what it draws, and what it says when it gets something else."""

from __future__ import annotations

import inspect
import pkgutil
from dataclasses import replace
from importlib import import_module

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from surrogate_systems import periodic as of_periodic_state

import coupled
import surrogate
import thermofem as th

matplotlib.use("Agg")
MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
TIMES = np.linspace(0, 5e-6, 201)


def functions() -> dict[str, object]:
    """All public plot functions of the plot modules of the three packages, by name."""
    found = {}
    for package in (th, surrogate, coupled):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if module.name.split(".")[1].startswith("plot"):
                for name, function in vars(import_module(module.name)).items():
                    if name.startswith("plot_") and inspect.isfunction(function):
                        found[name] = function
    return found


FUNCTIONS = functions()


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.mark.parametrize("periodic", [False, True])
def test_a_fit_is_drawn_with_its_data_and_its_residual(periodic):
    if periodic:
        data = of_periodic_state(MODEL, th.SquareWave(1e-3, 1e-6, 1 / 3))
    else:
        data = th.dataset.build(TIMES, MODEL.response(th.Constant(1e-3), TIMES), th.Constant(1e-3))
    fit = surrogate.fit_newton(data)
    upper, lower = FUNCTIONS["plot_fit"](fit, data)
    drawn, missed = upper.lines[0].get_ydata(), lower.lines[-1].get_ydata()
    np.testing.assert_array_equal(drawn, data.delta_T.values)
    np.testing.assert_allclose(upper.lines[1].get_ydata() - drawn, missed, atol=1e-12)
    # the straight lines between 4001 samples of a period miss (dt/tau)^2/8 of the swing: 3e-6 for tau = 50 ns
    assert np.sqrt(np.mean(missed**2)) == pytest.approx(fit.residual, rel=1e-4, abs=0)


def test_the_logarithmic_panel_shows_the_magnitude_of_every_error():
    periods = np.geomspace(1e-7, 1e-5, 20)
    curves = {
        name: surrogate.period_error(th.Foster(R=[7e3 * k], tau=[1e-6]), MODEL, periods)
        for name, k in (("a", 1), ("b", 1.1))
    }
    left, right = FUNCTIONS["plot_period_errors"](curves)
    assert right.get_yscale() == "log"
    for line, curve in zip(right.lines, curves.values(), strict=False):
        expected = np.abs(100 * curve["relative_error"].values)
        np.testing.assert_allclose(line.get_ydata(), np.where(expected > 0, expected, np.nan))
    assert left.get_legend() is None  # one legend for both panels
    _, right = FUNCTIONS["plot_period_errors"]({"none": surrogate.period_error(MODEL, MODEL, periods)})
    assert right.get_ylim()[1] > 10  # the line of 10 % is there where every error is round-off


def test_the_legend_of_period_errors_is_no_wider_than_the_figure():
    """Two columns of the models of `thermofem validate` fit into it."""
    curve = surrogate.period_error(MODEL, MODEL, np.geomspace(1e-7, 1e-5, 20))
    names = [f"certified reduction (0.0001), {states} states" for states in (12, 13)]
    left, _ = FUNCTIONS["plot_period_errors"](dict.fromkeys(names, curve))
    left.figure.draw_without_rendering()
    legend = left.figure.legends[0].get_window_extent()
    assert left.figure.bbox.x0 <= legend.x0 < legend.x1 <= left.figure.bbox.x1


def drawn_fit():
    """A fit in volts of a drive with many words, of log-spaced samples."""
    wave = th.Pulse(1.2345e-3, 3.4567e-6)
    times = np.geomspace(1e-9, 2e-5, 100)
    data = th.dataset.build(times, MODEL.response(wave, times), wave)
    return FUNCTIONS["plot_fit"](MODEL, data.assign_attrs(assumed="1 V counts as 1 K"))


def drawn_errors():
    """Errors of two models over a wide range, with the points of a ring and a long title."""
    curve = surrogate.period_error(MODEL, th.Foster(R=[7e3], tau=[9e-7]), np.geomspace(1e-7, 1e-4, 20))
    ring = curve.assign_attrs(loaded_q=20000.0)
    names = ["certified reduction (0.0001), 12 states", "second order equation, trained on a pulse of 20 us"]
    title = "paper's ring without cladding, radius 60 um: k(T) at a square wave of 2 mW, duty 1/3, against its FEM"
    return FUNCTIONS["plot_period_errors"](dict.fromkeys(names, curve), points={names[1]: ring}, title=title)


@pytest.mark.parametrize("draw", [drawn_fit, drawn_errors])
def test_nothing_of_a_figure_leaves_it(draw):
    """What leaves the figure is cut in the image; in inches, to a pixel."""
    figure = draw()[0].figure
    figure.draw_without_rendering()
    drawn = figure.get_tightbbox()
    assert min(drawn.x0, drawn.y0) > -0.01
    assert drawn.x1 < figure.get_figwidth() + 0.01
    assert drawn.y1 < figure.get_figheight() + 0.01


def test_the_line_of_a_transmission_does_not_join_two_stretches_that_leave_the_range():
    """At 3 mW from -20 GHz on, the branch leaves below -20 GHz near 0.95 mW and comes back near 1.6 mW."""
    model = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31)
    curve = coupled.transmission(coupled.borghi2021(), model, power=3e-3, detuning=(-20e9, 20e9))
    assert np.abs(np.diff(1e3 * curve["drop"].values)).max() > 0.4  # the two stretches follow each other
    ax = FUNCTIONS["plot_transmission"](curve)
    for line in ax.lines:
        assert np.nanmax(np.abs(np.diff(line.get_ydata()))) < 0.05


def test_a_run_has_a_panel_for_each_quantity():
    wave = coupled.Sweep([0, 1e-6], [10e9, -10e9])
    run = coupled.simulate(coupled.borghi2021(), MODEL, power=1e-3, detuning=wave, duration=1e-6)
    figure = FUNCTIONS["plot_traces"](run).figure
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels == ["drop power (µW)", "temperature rise (K)", "detuning (GHz)"]
    _, ax = plt.subplots()
    assert FUNCTIONS["plot_traces"](run, ax) is ax
    assert len(ax.figure.axes) == 2  # the twin


def test_the_spike_of_the_light_that_is_switched_on_sets_no_axis():
    """In the first nanosecond the drop power reached 5.6 mW, and 3.6 mW in the pulses after it."""
    ring = coupled.borghi2021()
    run = coupled.simulate(ring, MODEL, power=6.31e-3, detuning=0.0, duration=5e-6)
    spike, later = (float(1e3 * run["drop"].values[kept].max()) for kept in (slice(None), run["time"].values > 5e-9))
    assert spike > 1.3 * later
    assert later < FUNCTIONS["plot_traces"](run).get_ylim()[1] < 1.1 * later
    wave = coupled.Sweep([0, 5e-6], [0.0, -40e9])
    run = coupled.simulate(ring, MODEL, power=6.31e-3, detuning=wave, duration=5e-6)
    later = float(1e3 * run["drop"].values[run["time"].values > 5e-9].max())
    assert max(line.get_ydata().max() for line in FUNCTIONS["plot_sweep"](run).lines) == pytest.approx(later)
    coarse = coupled.simulate(ring, MODEL, power=1e-3, detuning=wave, duration=5e-6, times=np.linspace(0, 5e-6, 11))
    assert sum(line.get_xdata().size for line in FUNCTIONS["plot_sweep"](coarse).lines) == 11


def test_points_that_do_not_pulse_have_no_colour_of_a_regime():
    """Also slow transients, in the panels of frequency and duty cycle."""
    frame = {"dims": ("power", "detuning"), "coords": {"power": [1e-3, 2e-3], "detuning": [0.0, 1e9]}}
    regime = xr.DataArray([["slow transient", "self-pulsing"]] * 2, **frame)
    duty = xr.DataArray([[np.nan, 0.4]] * 2, **frame)
    ax = FUNCTIONS["plot_map"](xr.Dataset({"regime": regime, "duty": duty}), "duty")
    regimes = import_module("coupled.plot.maps").REGIMES.values()
    assert matplotlib.colors.to_hex(ax.get_facecolor()) not in {colour.lower() for colour in regimes}


def test_the_names_of_parts_stand_beside_the_cross_section():
    """No name lies over the frame."""
    geometry = th.heated_ring()
    ax = FUNCTIONS["plot_preview"](geometry, th.assemble(geometry, accuracy=0.05).mesh)
    figure = ax.figure
    figure.draw_without_rendering()
    frame = ax.get_window_extent()
    names = [matplotlib.text.Text.get_window_extent(text) for text in ax.texts]
    assert [text.get_text() for text in ax.texts] == ["heater (heated)", "core (heated)"]
    assert all(frame.x1 < box.x0 and box.x1 < figure.bbox.x1 for box in names)
    assert names[1].y1 < names[0].y0
    assert "air or void, not meshed" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_the_preview_points_at_every_part_where_no_later_one_lies_over_it():
    slab, top = th.rib_ring().parts  # its core stands on the slab; here it goes through it
    geometry = replace(th.rib_ring(), parts=(slab, replace(top, bottom=0.0, height=top.bottom + top.height)))
    mesh = th.assemble(geometry, accuracy=0.05).mesh
    centres = 1e6 * mesh.points[mesh.triangles].mean(axis=1)
    for label in FUNCTIONS["plot_preview"](geometry, mesh).texts:
        nearest = np.argmin(np.hypot(*(centres - label.xy).T))
        assert mesh.region_names[mesh.region[nearest]] == label.get_text().removesuffix(" (heated)")


def test_a_fit_of_samples_in_equal_ratios_is_drawn_over_them():
    """Seconds after microseconds: on a straight axis in microseconds the rise would be a line on the left edge."""
    times = np.geomspace(1e-4, 90.0, 100)
    data = th.dataset.build(times, th.Foster(R=[10.0], tau=[1.0]).response(th.Constant(1.0), times), th.Constant(1.0))
    upper, lower = FUNCTIONS["plot_fit"](surrogate.fit_foster(data, order=1), data)
    assert upper.get_xscale() == lower.get_xscale() == "log"
    assert lower.get_xlabel() == "time (s)"


def test_a_ring_on_one_bus_shows_its_through_port():
    """There is no light at a drop port that it does not have; the panel shows the through port."""
    ring = replace(coupled.borghi2021(), drop_rate=0.0)
    wave = coupled.Sweep([0, 1e-6], [10e9, -10e9])
    run = coupled.simulate(ring, MODEL, power=1e-3, detuning=wave, duration=1e-6)
    ax = FUNCTIONS["plot_traces"](run)
    assert ax.get_ylabel() == "through power (µW)"
    np.testing.assert_allclose(ax.lines[0].get_ydata(), 1e6 * run["through"].values)
    assert FUNCTIONS["plot_sweep"](run).get_ylabel() == "through power (µW)"
    curve = coupled.transmission(ring, MODEL, power=1e-3, detuning=(-30e9, 20e9))
    ax = FUNCTIONS["plot_transmission"](curve)
    assert ax.get_ylabel() == "through power (mW)"
    assert FUNCTIONS["plot_transmission"](curve, "absorbed").get_ylabel() == "absorbed power (mW)"
