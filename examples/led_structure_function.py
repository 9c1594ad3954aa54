"""Thermal impedance, time-constant spectrum and structure function of a measured step response.

    python examples/led_structure_function.py STEP.csv [picture.png]

STEP.csv has a header line and the columns time (s) and thermal impedance (K/W) after a power step, as a thermal
transient tester writes them; further columns are ignored.
"""

from __future__ import annotations

import sys

import matplotlib.pyplot as plt
import numpy as np

import surrogate
import thermofem as th
from thermofem.plot import BLUE, INK, VERMILION, save_figure


def main(source: str, picture: str) -> None:
    """Fit, print and draw."""
    time, rise = np.loadtxt(source, delimiter=",", skiprows=1, usecols=(0, 1), unpack=True)
    data = th.dataset.build(time, rise, th.Constant(1.0))
    spectrum = surrogate.fit_spectrum(data, per_decade=10)
    few = surrogate.fit_foster(data, 6)
    path = th.models.cauer.structure_function(spectrum.model)
    for name, fit in (("spectrum", spectrum), ("six poles", few)):
        share = 100 * fit.residual / rise[-1]
        print(f"{name}: R_th = {fit.model.thermal_resistance:.4g} K/W, rms {share:.3f} % of the last value")

    _, (a, b, c) = plt.subplots(3, 1, figsize=(5.7, 8), layout="constrained")
    a.semilogx(time, rise, ".", color=INK, markersize=4, label="measured")
    a.semilogx(time, few.model.step_response(time), color=VERMILION, linewidth=1, label="six poles")
    a.set(xlabel="time (s)", ylabel="thermal impedance (K/W)")
    a.legend(frameon=False)
    b.stem(spectrum.model.tau, spectrum.model.R, linefmt=BLUE, markerfmt=" ", basefmt=" ")
    b.set(xscale="log", xlabel="time constant (s)", ylabel="R (K/W)", ylim=(0, None))
    c.step(path.resistance, path.capacity, where="post", color=BLUE)
    c.set(yscale="log", xlabel="cumulative resistance (K/W)", ylabel="cumulative capacity (J/K)")
    save_figure(a, picture)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "structure_function.png")
