"""Fig. 1(a) and Section 2: spectrum of the ring over many orders, its mass, and the coupling that its gap gives."""

import numpy as np
import xarray as xr
from scipy.constants import c

import coupled
import thermofem as th
from thermofem.plot import BLUE, INK, VERMILION

from .printed import DETUNINGS, RING, heat, panel
from .report.study import Result, figure, study
from .table2 import KAPPA_SQUARED

WAVELENGTH = 1.555e-6  # m
GAP, STRAIGHT = 250e-9, 3e-6  # m, between ring and bus, and over which they run side by side
NARROWER = 10e-9  # m, by which the gap is varied
LOSS = 161.0  # 1/m of the power, 7 dB/cm; no number below depends on it
SAMPLED = np.linspace(1.50e-6, 1.61e-6, 5)  # m, at which modes are computed; n_eff is a parabola between them
SHOWN = np.linspace(1.50e-6, 1.61e-6, 20001)  # m
ENLARGED = 60e9  # Hz on either side of the resonance


def through(frequency, n_eff, perimeter):
    """Power that a ring with two equal buses lets through, over the input.

        T = t^2 (1 - 2 a cos phi + a^2)/(1 - 2 t^2 a cos phi + t^4 a^2),   t^2 = 1 - kappa^2,   phi = 2 pi n_eff L f/c

    with the amplitude a that one round trip leaves, exp(-gamma_i n_g L/c). frequency [Hz], perimeter L [m].
    """
    t2 = 1 - KAPPA_SQUARED
    a = np.exp(-RING.loss_rate * RING.group_index * perimeter / c)
    phase = 2 * np.pi * n_eff * perimeter * frequency / c
    interference = 2 * a * np.cos(phase)
    return t2 * (1 - interference + a**2) / (1 - t2 * interference + (t2 * a) ** 2)


@study("Fig. 1(a): spectrum", quick=True)
def spectrum(elements):
    """Spectrum at low power from the guided mode; its group index, and the distance of orders."""
    geometry, perimeter = th.strip_ring(), elements.numbers["perimeter_m"]
    mode = th.light(geometry, wavelength=WAVELENGTH).mode("TE0")
    per_width = mode.derivatives(["part.core.width"])["n_g"].item()
    indices = [th.light(geometry, wavelength=wavelength).mode("TE0").n_eff for wavelength in SAMPLED]
    n_eff = np.polynomial.Polynomial.fit(SAMPLED, indices, 2)
    transmission = through(c / SHOWN, n_eff(SHOWN), perimeter)
    round_trips = perimeter * n_eff(SHOWN) / SHOWN  # falls with the wavelength
    orders = np.arange(np.ceil(round_trips.min()), round_trips.max())
    resonances = np.sort(np.interp(orders, round_trips[::-1], SHOWN[::-1]))
    middles = (resonances[1:] + resonances[:-1]) / 2
    own = resonances[np.abs(resonances - WAVELENGTH).argmin()]
    near = own * (1 + np.linspace(-ENLARGED, ENLARGED, 401) * own / c)
    numbers = {
        "n_g": mode.n_g, "n_g_per_width": per_width, "orders": orders.size, "resonance_m": own,
        "width_change_m": (RING.group_index - mode.n_g) / per_width,
        "spacing_m": np.interp(WAVELENGTH, middles, np.diff(resonances)),
        "printed_spacing_m": WAVELENGTH**2 / (RING.group_index * perimeter),
    }
    data = {
        "wide": xr.Dataset({"through": ("wavelength", transmission)}, {"wavelength": SHOWN}),
        "near": xr.Dataset(
            {"through": ("wavelength", through(c / near, n_eff(near), perimeter))}, {"wavelength": near}
        ),
    }
    return Result(numbers, data)


@study("Section 2: mass and coupling", quick=True)
def section(elements):
    """Mass of the core, and the power coupled into a bus across the paper's gap."""
    geometry, perimeter = heat().geometry, elements.numbers["perimeter_m"]
    core = geometry.parts[0]
    line = th.materials.find("Si").density * core.height * perimeter  # kg/m, per width

    def coupling(gap):
        """kappa^2 = 1 - exp(-2 gamma_e n_g L/c)."""
        made = coupled.ring_from(geometry, wavelength=WAVELENGTH, loss=LOSS, gap=gap, straight=STRAIGHT, buses=2)
        return -np.expm1(-2 * made.ring.bus_rate * made.ring.group_index * perimeter / c)

    nominal = coupling(GAP)
    per_gap = np.log(coupling(GAP - NARROWER) / nominal) / NARROWER
    return Result({
        "mass_kg": line * (core.outer_radius - core.inner_radius), "printed_width_m": 1.09e-14 / line,
        "coupling": nominal, "printed_gap_m": GAP - np.log(KAPPA_SQUARED / nominal) / per_gap,
    })


@figure
def fig1a(spectrum):
    ax, wide, near = panel(4.6, 3.6), spectrum.data["wide"], spectrum.data["near"]
    own = spectrum.numbers["resonance_m"]
    decibels = 10 * np.log10(wide["through"])
    ax.plot(wide["wavelength"] * 1e9, decibels, color=INK, linewidth=0.9)
    order = np.abs(wide["wavelength"] - own) < spectrum.numbers["spacing_m"] / 2
    ax.plot(wide["wavelength"][order] * 1e9, decibels[order], color=VERMILION, linewidth=1.2)
    ax.set(xlabel="wavelength (nm)", ylabel="through port (dB)", xlim=(1500, 1610), ylim=(-58, 2))
    inset = ax.inset_axes((0.12, 0.1, 0.8, 0.4))
    inset.axvspan(DETUNINGS[0] * 1e-9, DETUNINGS[-1] * 1e-9, color=BLUE, alpha=0.15, linewidth=0)
    detuning = (own - near["wavelength"]) * c / own**2
    inset.plot(detuning * 1e-9, near["through"], color=VERMILION)
    inset.set(xlim=(-60, 60), ylim=(0, 1.02))
    inset.set_title("detuning (GHz); blue: of the maps", fontsize="x-small")
    inset.tick_params(labelsize="x-small")
    return ax
