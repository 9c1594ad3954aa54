"""Measured loops of a silicon ring against the model: the steady fit, the jumps, another day, and where it may pulse.

python examples/measured_bistability.py folder [picture.png]

The folder holds full_loops_2018-01-12.csv, jumps_2018-01-12.csv and loops_2018-01-10.csv, made from the data of
github.com/DejavuITA/AOD-ANN (MIT, Copyright (c) 2017 Davide Bazzanella) as columns of wavelength (nm), attenuator
transparency and drop signal (V). Every point is a 100 ms average behind a 1 kHz photodiode: the loops are steady
states, and what lies above the kink at a transparency of 0.51 to 0.53 is an average over whatever the ring did. That it
pulsed there is an inference: the model has a Hopf point near by, but where exactly depends on the cold wavelength, the
thermal model and the law of free-carrier dispersion, and nobody resolved it in time.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.constants import c
from scipy.optimize import least_squares

import coupled
import thermofem as th

DROP = 1.906e-3  # W on the chip for one volt: 0.6175 mW at the photodiode, over a grating of 0.324
LEAKAGE = 0.0148  # of the attenuator
LINEWIDTH = 0.63e-9  # m, full width at half maximum; 0.60(5) in the thesis
VOLUME = 29.34 / 49.98  # of the modes, by perimeter, against the ring of the paper
UNITS = np.array([1e-3, 1e-9, 1e9, 1e-9])  # mW a unit of transparency, nm, 1/ns, ns: of the four free parameters
BELOW_THE_KINK = 0.5001  # transparency; as much power as 0.65 on the other day
OTHER_DAY = 0.6501
GEOMETRY = {"radius": 4.67e-6, "width": 480e-9, "height": 220e-9, "box": 2e-6, "cladding": 2e-6, "substrate": 30e-6}
STATIC = th.Foster(R=[13.43e3], tau=[1e-6])  # K/W, of the finite elements of GEOMETRY


def load(path):
    """One file as wavelength (m), transparency and drop power (W)."""
    data = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding=None)
    lit = data["voa_transparency"] > 0
    return data["wavelength_nm"][lit] * 1e-9, data["voa_transparency"][lit], data["drop_V"][lit] * DROP


def ring_of(x, *, lumped=False):
    """The ring at (W for full transparency, cold wavelength, absorbing rate, carrier lifetime) in the units above."""
    _, wavelength, absorbed, lifetime = x * UNITS
    paper = coupled.borghi2021()
    total = np.pi * c * LINEWIDTH / wavelength**2
    ring = replace(
        paper,
        name="IRIS ring 1",
        frequency=c / wavelength,
        loss_rate=absorbed,
        bus_rate=(total - absorbed) / 2,
        tpa_volume=paper.tpa_volume * VOLUME,
        fca_volume=paper.fca_volume * VOLUME,
        carriers=coupled.ConstantLifetime(lifetime),
    )
    return ring.with_lumped_fcd() if lumped else ring


def misfit(x, data, *, lumped=False, model=STATIC):
    """ln(power that the model needs for the measured drop / power that was there)."""
    wavelength, open_, drop = data
    ring = ring_of(x, lumped=lumped)
    needed = coupled.equilibria.transmission.power_for_drop(
        ring, model, drop=drop, detuning=c / wavelength - ring.frequency
    )
    return np.log(needed / (x[0] * UNITS[0] * (open_ + LEAKAGE)))


def fit(data, *, lumped=False, model=STATIC):
    """The four parameters from all points below the kink, and the rms of ln P."""
    below = [column[data[1] < BELOW_THE_KINK] for column in data]
    found = least_squares(
        lambda x: misfit(x, below, lumped=lumped, model=model), [18, 1551.8, 3, 12], x_scale=[1, 0.01, 1, 1],
        bounds=([1, 1550, 0.01, 0.5], [100, 1552.18, 50, 200]),
    )  # fmt: skip
    return found.x, float(np.sqrt(np.mean(found.fun**2)))


def refit(data, x, *, lumped=False):
    """Another day: only the power and the cold wavelength are free."""
    below = [column[data[1] < OTHER_DAY] for column in data]
    found = least_squares(
        lambda free: misfit(np.array([*free, *x[2:]]), below, lumped=lumped), x[:2], x_scale=[1, 0.01],
        bounds=([1, 1550], [100, 1552.3]),
    )  # fmt: skip
    return np.array([*found.x, *x[2:]]), float(np.sqrt(np.mean(found.fun**2)))


def jumps(x, jumped, *, lumped=False):
    """Relative errors of the powers at which the model jumps up and down, shape (2, loops)."""
    ring = ring_of(x, lumped=lumped)
    errors = []
    for row in jumped:
        drop = np.geomspace(1e-5, 8e-3, 20000)
        needed = coupled.equilibria.transmission.power_for_drop(
            ring, STATIC, drop=drop, detuning=c / (row["wavelength_nm"] * 1e-9) - ring.frequency
        )
        turns = needed[1:-1][np.diff(np.sign(np.diff(needed))) != 0] / (x[0] * UNITS[0]) - LEAKAGE
        measured = [
            (row["up_last_low"] + row["up_first_high"]) / 2,
            (row["down_last_high"] + row["down_first_low"]) / 2,
        ]
        errors.append((turns[:2] + LEAKAGE) / (np.array(measured) + LEAKAGE) - 1)
    return np.array(errors).T


def fit_by_curves(data):
    """The same four by `coupled.fit_transmission`: distances from the curve through both folds of each loop."""
    wavelength, open_, drop = (column[data[1] < BELOW_THE_KINK] for column in data)
    full = 18 * UNITS[0]
    loops = []
    for one in np.unique(wavelength):
        here = wavelength == one
        power = ("step", full * (open_[here] + LEAKAGE))
        loops.append(xr.Dataset({"drop": ("step", drop[here]), "power": power}, attrs={"wavelength": one}))
    found = coupled.fit_transmission(
        ring_of(np.array([18, 1551.8, 3, 12])), loops, free=["power", "frequency", "loss_rate", "tau0"], model=STATIC,
        bounds={"frequency": (c / 1552.18e-9, c / 1551.3e-9), "loss_rate": (1e8, 1e10)},
    )  # fmt: skip
    power, frequency, absorbed, lifetime = (found.parameters[n] for n in ("power", "frequency", "loss_rate", "tau0"))
    return np.array([full * power, c / frequency, absorbed, lifetime]) / UNITS, found


def averages(x, model, wavelength, transparencies):
    """Time-averaged drop power (W) of the simulated ring, from cold, over the second half of 60 us."""
    ring = ring_of(x)
    means = []
    for open_ in transparencies:
        run = coupled.simulate(
            ring, model, power=x[0] * UNITS[0] * (open_ + LEAKAGE), detuning=c / wavelength - ring.frequency,
            duration=60e-6, rtol=1e-5,
        )  # fmt: skip
        t, drop = run["time"].values, run["drop"].values
        late = t > 30e-6
        means.append((np.trapezoid(drop[late], t[late]) / np.ptp(t[late]), coupled.pulsing(run).regime))
    return means


def figure(folder):
    """Measured loops, the fit, the other day, and the stretch where the model pulses."""
    import matplotlib.pyplot as plt

    import surrogate

    first, second = load(folder / "full_loops_2018-01-12.csv"), load(folder / "loops_2018-01-10.csv")
    heat = th.assemble(th.strip_ring(**GEOMETRY, outer_radius=60e-6))
    model = surrogate.reduce(heat.system, tolerance=1e-3).model
    x, rms = fit(first, model=model)
    moved, rms_moved = refit(second, x)
    print(f"R_th {model.thermal_resistance / 1e3:.2f} K/mW, rms {rms:.1%} and {rms_moved:.1%} the other day")
    for name, value in zip(("mW a unit", "nm, cold", "1/ns absorbed", "ns of the carriers"), x, strict=True):
        print(f"{value:10.4f} {name}")
    print("by distances from the curves:", ", ".join(f"{value:.4f}" for value in fit_by_curves(first)[0]))
    picture, axes = plt.subplots(3, 1, figsize=(5.7, 9), layout="constrained")
    drawn = (
        (axes[0], first, x, (1552.304, 1552.246, 1552.194)),
        (axes[1], second, moved, (1552.392, 1552.339, 1552.300)),
    )
    for ax, data, y, lines in drawn:
        ring = ring_of(y)
        for nm, colour in zip(lines, ("#0072B2", "#009E73", "#D55E00"), strict=True):
            here = np.isclose(data[0], nm * 1e-9, rtol=0, atol=1e-14)
            ax.plot(data[1][here], data[2][here] * 1e3, ".", color=colour, markersize=3, alpha=0.5)
            span = y[0] * UNITS[0] * (np.array([0.02, 1.0]) + LEAKAGE)
            curve = coupled.transmission(ring, model, power=tuple(span), detuning=c / (nm * 1e-9) - ring.frequency)
            open_ = curve.power.values / (y[0] * UNITS[0]) - LEAKAGE
            rest = curve.regime.values == "stable"
            touching = rest | np.roll(rest, 1) | np.roll(rest, -1)
            drop = curve["drop"].values * 1e3
            ax.plot(open_, np.where(touching, drop, np.nan), color=colour, linewidth=1.4, label=f"{nm:.3f} nm")
            ax.plot(open_, np.where(rest, np.nan, drop), color=colour, linewidth=1, linestyle=(0, (1, 1.5)))
        ax.set(xlabel="transparency of the attenuator", ylabel="drop power (mW)", xlim=(0, 1), ylim=(0, 7.5))
        ax.legend(frameon=False, fontsize="small", loc="lower right")
    axes[0].set_title(f"fitted below 0.5, rms of ln P {100 * rms:.1f} %", fontsize="small")
    axes[1].set_title(f"another day: power and cold wavelength refitted, {100 * rms_moved:.1f} %", fontsize="small")
    nm = 1552.246
    here = np.isclose(first[0], nm * 1e-9, rtol=0, atol=1e-14)
    axes[2].plot(first[1][here], first[2][here] * 1e3, ".", color="#777777", markersize=4, label="measured, averaged")
    opens = np.linspace(0.48, 1.0, 14)
    found = averages(x, model, nm * 1e-9, opens)
    axes[2].plot(opens, [m * 1e3 for m, _ in found], color="#D55E00", linewidth=1, label="model, averaged")
    for open_, (mean, regime) in zip(opens, found, strict=True):
        pulses = regime == "self-pulsing"
        axes[2].plot(open_, mean * 1e3, "o", color="#D55E00", markerfacecolor="#D55E00" if pulses else "white")
    axes[2].set_title(f"{nm} nm; filled: the model pulses", fontsize="small")
    axes[2].set(xlabel="transparency of the attenuator", xlim=(0.4, 1.02), ylim=(4, 7.5))
    axes[2].legend(frameon=False, fontsize="small", loc="lower left")
    return picture


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    figure(Path(sys.argv[1])).savefig(sys.argv[2] if len(sys.argv) > 2 else "measured_bistability.png", dpi=220)
