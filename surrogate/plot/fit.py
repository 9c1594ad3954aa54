"""A fit over the data that it was trained on, with the residual below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np

from thermofem.data.dataset import response_of
from thermofem.data.column_units import unit_of
from thermofem.plot import INK, VERMILION, WIDTH, takes, time_unit
from thermofem.waveforms import period_times

if TYPE_CHECKING:
    import xarray as xr

RATIOS = 5  # times the median gap: the mean gap beyond which samples are in equal ratios
FINE = 4001  # samples of a period, between which a periodic state is a straight line


def plot_fit(fit: Any, data: xr.Dataset, ax: Any = None) -> np.ndarray:
    """Data and model against time above, their difference below; samples in equal ratios on a logarithmic axis.

    fit [reduction or thermal model]
    data: the data of the fit, or any other of `thermofem.solve` or `thermofem.read_trace`.
    ax: for the traces and for the residual.
    """
    model = takes("fit", getattr(fit, "model", fit), "response", what="a fit, a reduction or a thermal model")
    takes("data", data, "time", "delta_T", what="a Dataset of th.solve or th.read_trace, with time and delta_T")
    response = response_of(data)
    if response.periodic:
        times = period_times(response.wave, FINE)
        rise = np.interp(response.times, times, model.periodic_response(response.wave, FINE))
    else:
        rise = np.asarray(model.response(response.wave, response.times))
    if ax is None:
        layout: dict[str, Any] = {"sharex": True, "height_ratios": [3, 1], "layout": "constrained"}
        _, ax = plt.subplots(2, 1, figsize=(WIDTH, 4.2), **layout)
    upper, lower = ax
    factor, unit = time_unit(float(response.times[-1]))
    rise_unit = unit_of(data.attrs.get("assumed", ""))
    t, missed = response.times * factor, rise - response.rise
    upper.plot(t, response.rise, color=INK, linewidth=2.6, alpha=0.4, label="data")
    upper.plot(t, rise, color=VERMILION, linewidth=1.2, label="model")
    gaps = np.diff(t)
    if not response.periodic and gaps.mean() > RATIOS * np.median(gaps):
        upper.set(xscale="log")
        lower.set(xscale="log")
    rise_label = "temperature rise (K)" if rise_unit == "K" else "rise of the voltage (V)"
    upper.set(ylabel=rise_label, xlim=(t[t > 0][0] if upper.get_xscale() == "log" else t[0], t[-1]))
    upper.legend(frameon=False, fontsize="small")
    rms = float(np.sqrt(np.mean(missed**2)))
    of = response.name.replace(" us", " µs")
    upper.set_title(
        f"{of}: residual {rms:.2g} {rise_unit} rms, {rms / response.swing:.2%} of the swing", fontsize="small"
    )
    lower.axhline(0, color=INK, linewidth=0.6)
    lower.plot(t, missed, color=VERMILION, linewidth=1)
    lower.set(xlabel=f"time ({unit})", ylabel=f"residual ({rise_unit})")
    return np.array([upper, lower])
