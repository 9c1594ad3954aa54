"""Bode plot of a linear ring: magnitude in dB and phase in degrees over frequency."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from thermofem.data import quantity
from thermofem.data.variables import contents
from thermofem.plot import CYCLE, INK, WIDTH, axes as new_axes

RESPONSE = "a Dataset of Linear.response"


def plot_bode(
    data: xr.Dataset, given: str = "detuning", seen: Sequence[str] = ("drop", "delta_T"), axes: np.ndarray | None = None
) -> np.ndarray:
    """Draw magnitude and phase from one input to some outputs; the legend has the gain that counts as 0 dB.

    data: from `Linear.response`; its lowest frequency gives 0 dB.
    """
    response = contents("data", data, ("frequency", "response"), what=RESPONSE)["response"].sel(input=given)
    above, below = new_axes(axes, (WIDTH, 4.6), 2, sharex=True)
    f = response["frequency"].values
    per = str(response["input_unit"].values)
    for colour, name in zip(CYCLE, seen, strict=False):
        H = response.sel(output=name)
        values = H.values
        gain = quantity.gain(abs(values[0]), str(H["output_unit"].values), per)
        decibels = 20 * np.log10(np.abs(values) / np.abs(values[0]))
        phase = np.degrees(np.unwrap(np.angle(values)))
        above.semilogx(f, decibels, color=colour, label=f"{name}, 0 dB = {gain}")
        below.semilogx(f, phase, color=colour)
    above.axhline(-3, color=INK, linewidth=0.6, linestyle=":")
    above.set(ylabel="magnitude (dB)", xlim=(f[0], f[-1]))
    above.set_ylim(bottom=max(above.get_ylim()[0], -80))
    above.legend(frameon=False, fontsize="small")
    above.set_title(f"from {given}", fontsize="small", loc="left")
    below.set(xlabel="frequency (Hz)", ylabel="phase (degrees)")
    for panel in (above, below):
        panel.grid(True, which="major", linewidth=0.3, color="#c3c8ce")
    return np.array([above, below])
