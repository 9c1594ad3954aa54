"""A fit over the data that it was trained on, with the residual below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np

from thermofem.dataset import drive_of
from thermofem.plot_style import INK, VERMILION, takes
from thermofem.waveforms import period_times

if TYPE_CHECKING:
    import xarray as xr

FINE = 4001  # samples of a period, between which a periodic state is a straight line


def plot_fit(fit: Any, data: xr.Dataset, ax: Any = None) -> np.ndarray:
    """Data and model against time (us) above, their difference (K) below.

    fit [reduction or thermal model]
    data: the data of the fit, or any other of `thermofem.solve` or `thermofem.read_csv`.
    ax: for the traces and for the residual.
    """
    model = takes("fit", getattr(fit, "model", fit), "response", what="a fit, a reduction or a thermal model")
    takes("data", data, "time", "delta_T", what="a Dataset of th.solve or th.read_csv, with time and delta_T")
    drive = drive_of(data)
    if drive.periodic:
        times = period_times(drive.wave, FINE)
        rise = np.interp(drive.times, times, model.periodic_response(drive.wave, FINE))
    else:
        rise = np.asarray(model.response(drive.wave, drive.times))
    if ax is None:
        layout: dict[str, Any] = {"sharex": True, "height_ratios": [3, 1], "layout": "constrained"}
        _, ax = plt.subplots(2, 1, figsize=(6.0, 4.2), **layout)
    upper, lower = ax
    t, missed = drive.times * 1e6, rise - drive.rise
    upper.plot(t, drive.rise, color=INK, linewidth=2.6, alpha=0.4, label="data")
    upper.plot(t, rise, color=VERMILION, linewidth=1.2, label="model")
    upper.set(ylabel="temperature rise (K)", xlim=(t[0], t[-1]))
    upper.legend(frameon=False, fontsize="small")
    rms = float(np.sqrt(np.mean(missed**2)))
    upper.set_title(f"{drive.name}: residual {rms:.2g} K rms, {rms / drive.swing:.2%} of the swing", fontsize="small")
    lower.axhline(0, color=INK, linewidth=0.6)
    lower.plot(t, missed, color=VERMILION, linewidth=1)
    lower.set(xlabel="time (µs)", ylabel="residual (K)")
    return np.array([upper, lower])
