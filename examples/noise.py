"""How quiet can a ring be? Thermo-refractive noise of a silicon strip, a nitride ring and a disc.

The closed form beside them (Kondratiev and Gorodetsky, Phys. Lett. A 382, 2265 (2018)) is that of a ring in a
homogeneous medium: it knows no substrate. Writes noise.png.
"""

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from scipy.constants import Boltzmann, c

import thermofem as th
from thermofem.fluctuations import linewidth

TEMPERATURE = 300.0  # K
FREQUENCIES = np.geomspace(1e3, 1e8, 61)  # Hz
NITRIDE = th.CrossSection(
    name="nitride ring",
    outer_radius=600e-6,
    layers=(
        th.Layer("substrate", "Si", 200e-6),
        th.Layer("box", "SiO2", 4e-6, datum=True),
        th.Layer("cladding", "SiO2", 3.8e-6),
    ),
    parts=(th.Part("core", "Si3N4", 227.25e-6, 228.75e-6, bottom=0.0, height=0.82e-6, heated=True),),
)
DISC = th.disc()
STRIP = th.strip_ring()


def closed_form(f, radius=228e-6, across=0.9e-6, along=0.5e-6, conductivity=1.38, capacity=2203 * 703.0):
    """S_T (K^2/Hz) of a nitride ring in glass; across, along: half axes of the mode in m."""
    omega = 2 * np.pi * f
    decay = (np.pi / 4) ** (1 / 3) * capacity / conductivity * along**2
    size = radius * np.sqrt(across**2 - along**2)
    diffusion = np.sqrt(np.pi**3 * conductivity * capacity * omega)
    return Boltzmann * TEMPERATURE**2 / diffusion / size / (1 + (omega * decay) ** 0.75) ** 2


figure, ax = plt.subplots(figsize=(5.7, 3.8), layout="constrained")
for section, wavelength in ((STRIP, 1.555e-6), (NITRIDE, 1.55e-6), (DISC, 1.55e-6)):
    heat = th.assemble(section.opened())
    mode = th.light(heat, wavelength=wavelength).mode("TE0")
    noise = th.thermal_noise(heat.with_light(mode), FREQUENCIES, temperature=TEMPERATURE)
    (line,) = ax.loglog(FREQUENCIES, noise["S_nu"], label=section.name)
    rms = noise.attrs["rms_frequency"]
    print(f"{section.name}: rms {rms / 1e3:.3g} kHz, S_nu(1 kHz) {float(noise['S_nu'][0]):.3g} Hz^2/Hz", end="")
    print(f", linewidth {linewidth(noise) / 1e3:.3g} kHz")
    if section is NITRIDE:
        shift = mode.thermo_optic * c / wavelength
        homogeneous = shift**2 * closed_form(FREQUENCIES)
        ax.loglog(FREQUENCIES, homogeneous, "--", color=line.get_color(), label="closed form, homogeneous glass")
        ratio = homogeneous / noise["S_nu"].values
        print(f"closed form over this: {ratio[0]:.2g} at 1 kHz, {np.interp(1e7, FREQUENCIES, ratio):.2g} at 10 MHz")
ax.set(xlabel="frequency (Hz)", ylabel="$S_\\nu$ (Hz²/Hz)", xlim=(FREQUENCIES[0], FREQUENCIES[-1]))
ax.legend(frameon=False, fontsize="small")
figure.savefig(Path("noise.png"), dpi=200)
