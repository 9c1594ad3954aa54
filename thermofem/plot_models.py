"""Pictures of thermal models of any kind: the step response, and the thermal impedance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import LogLocator

from .checks import InputError
from .plot_style import BLUE, CYCLE, INK, VERMILION, WIDTH, axes, takes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .models import ThermalModel

MODEL = "a thermal model, such as th.Foster or the .model of a fit or a reduction"
MOST_DECADES = 6  # with a number at the axis of a panel
SHARES = (0.01, 0.99)  # of the steady rise, between which a step response is drawn, with a decade on either side


def plot_step(model: ThermalModel, ax: Axes | None = None, *, power: float = 1e-3, label: str | None = None) -> Axes:
    """Temperature rise (K) after a step of ``power`` (W), against time on a logarithmic axis.

    model: with one input and one output (``model.channel(heated, read)`` picks them), or a fit or a reduction.
    power [W]
    label: name in the legend.
    """
    model = _single(model)
    ax = axes(ax)
    drawn = len(ax.lines)
    times = _times(model)
    rise = power * np.asarray(model.step_response(times))
    ax.semilogx(times, rise, color=CYCLE[drawn % len(CYCLE)], label=label)
    ax.set(xlabel="time (s)", ylabel=f"temperature rise\nfor a {power * 1e3:g} mW step (K)")
    ax.set_ylim(bottom=min(0.0, float(rise.min())))
    if label:
        ax.legend(frameon=False, fontsize="small", loc="upper left")
    return ax


def plot_model(model: ThermalModel, ax: Any = None) -> np.ndarray:
    """Step response for 1 mW above, magnitude and phase of the thermal impedance below.

    model: as for `plot_step`.
    """
    model = _single(model)
    if ax is None:
        _, ax = plt.subplots(2, 1, figsize=(WIDTH, 5.6), layout="constrained")
    left, right = ax
    plot_step(model, left)
    times = _times(model)
    frequency = np.geomspace(0.02 / times[-1], 1 / times[0], 200)
    Z = np.asarray(model.impedance(frequency))
    right.loglog(frequency, np.abs(Z) / 1e3, color=INK)
    right.set(xlabel="frequency (Hz)", ylabel="|Z| (K/mW)")
    phase = right.twinx()
    phase.semilogx(frequency, np.degrees(np.angle(Z)), color=BLUE, linestyle="--", linewidth=1)
    phase.set_ylabel("phase (°)", color=BLUE)
    for panel in (left, right):
        panel.xaxis.set_major_locator(LogLocator(numticks=MOST_DECADES))
    resistance = float(model.thermal_resistance)
    left.axhline(resistance * 1e-3, color=INK, linewidth=0.6, linestyle=":")
    left.set_title(f"{type(model).__name__}, $R_\\mathrm{{th}}$ = {resistance / 1e3:.4g} K/mW", fontsize="small")
    right.set_title(f"{model.inputs[0]} heated, {model.outputs[0]} read", fontsize="small")
    left.lines[0].set_color(VERMILION)
    return np.array([left, right])


def _single(model: Any) -> Any:
    """A model with one input and one output, taken out of what holds it."""
    if not hasattr(model, "step_response"):
        model = getattr(model, "model", model)
    takes("model", model, "step_response", "impedance", "inputs", "outputs", what=MODEL)
    if len(model.inputs) > 1 or len(model.outputs) > 1:
        pair = f"model.channel({model.inputs[0]!r}, {model.outputs[0]!r})"
        raise InputError(f"model has {len(model.inputs)} inputs and {len(model.outputs)} outputs; draw one: {pair}")
    return model


def _times(model: Any) -> np.ndarray:
    """From a decade before 1 % of the steady rise is reached to a decade after 99 %."""
    times = np.geomspace(1e-12, 1e2, 281)
    share = np.asarray(model.step_response(times)) / float(model.thermal_resistance)
    first, last = (times[min(int(np.argmax(share >= s)), times.size - 1)] for s in SHARES)
    return np.geomspace(first / 10, 10 * last, 300)
