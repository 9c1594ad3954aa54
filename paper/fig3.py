"""Fig. 3, Section 3 and Appendix B: how carriers made by a short pulse recombine, and whether traps hold them."""

import numpy as np
import xarray as xr
from scipy.constants import c, h
from scipy.integrate import solve_ivp

import coupled
from thermofem.plot import INK, ORANGE, SKY, VERMILION

from .printed import RING, legend, panel
from .report.study import Result, figure, study

START = 1e23  # 1/m^3, left by the pump pulse; the paper is concerned with 1e15 to 1e18 cm^-3
WINDOWS = {"slow": (0.0, 50e-9), "fast": (250e-9, 300e-9)}  # s, in which the paper takes its two slopes
TIMES = np.linspace(0, 300e-9, 601)
LAWS = {"printed": (RING.carriers, "-", INK), "exchanged": (RING.with_swapped_srh().carriers, "--", VERMILION)}
TRAPS = (0.01, 0.1, 1.0)  # over the holes at equilibrium
SPIRAL, PEAK, PULSE, PUMPED = 7.1e-3, 1.5, 40e-12, 1.55e-6  # m, W, s (full width at half height) and m: of the pump
SQUARED = PULSE * np.sqrt(np.pi / (8 * np.log(2)))  # s: the integral of a Gaussian pulse squared, over its peak squared
REPEATED = 1e-6  # s between pulses


@study("Fig. 3(b): carrier lifetime", quick=True)
def carriers():
    """Decay with the lifetimes as printed and exchanged; mean lifetimes as the paper's dashed lines."""
    data, numbers = {}, {}
    for name, (law, _, _) in LAWS.items():
        data[name] = coupled.carriers.carrier_decay(law, START, TIMES)
        N = data[name]["carriers"].values
        numbers[name] = {"low_injection_s": law.tau0, "high_injection_s": law.tau0 * law.a / law.b}
        numbers[name]["dropped_by"] = float(N[0] / np.interp(WINDOWS["fast"][0], TIMES, N))
        for which, (begin, end) in WINDOWS.items():
            inside = (begin <= TIMES) & (end >= TIMES)
            numbers[name][f"{which}_s"] = -1 / np.polyfit(TIMES[inside], np.log(N[inside]), 1)[0]
    return Result(numbers, data)


@study("Fig. 3(a): pump and probe", quick=True)
def probe(elements):
    """Probe power behind the spiral after a pump pulse, normalised to that without pump.

        dP/dz = -b P^2,  b = beta (n_g/n0)^2 Gamma/A;    N0 = b P^2 S/(2 h nu A),    T(t) = exp(-sigma int N(z, t) dz)

    P is the peak power, S the integral of the squared pulse over its peak squared, A = V_FCA/L the mode's area of
    Table 2. Linear loss is left out, as in the paper's inset.
    """
    area = RING.fca_volume / elements.numbers["perimeter_m"]
    per_power = RING.tpa_coefficient * (RING.group_index / RING.refractive_index) ** 2 * RING.fca_confinement / area
    z = np.linspace(0, SPIRAL, 41)
    power = PEAK / (1 + per_power * PEAK * z)
    made = per_power * power**2 * SQUARED / (2 * h * c / PUMPED * area)
    times = np.linspace(0, REPEATED, 1001)
    law = RING.with_swapped_srh().carriers
    carriers = np.array([coupled.carriers.carrier_decay(law, start, times)["carriers"].values for start in made])
    transmission = np.exp(-RING.fca_cross_section * np.trapezoid(carriers, z, axis=0))
    numbers = {
        "front_per_m3": made[0], "end_per_m3": made[-1], "mean_per_m3": np.trapezoid(made, z) / SPIRAL,
        "least": transmission.min(),
    }
    return Result(numbers, {"transmission": xr.Dataset({"through": ("time", transmission)}, {"time": times})})


@study("Section 3: trapping", quick=True)
def trapping():
    """Lifetime of the holes where electrons and traps have equations of their own, against Eq. 1.

        dn/dt = -R_n,  dp/dt = -R_p,  R_n = [n (Nt - m) - n1 m]/(tau_n Nt),  R_p = [p m - p1 (Nt - m)]/(tau_p Nt)

    with m filled traps, n + m - p conserved (Nomura and Blakemore, Phys. Rev. 112, 1607 (1958)), in units of p0.
    """
    law, off = RING.carriers, {}
    p0, boltzmann = law.hole_density, np.exp(law.trap_energy / law.thermal_energy)
    ni = law.intrinsic_density / p0
    n0, n1, p1 = ni**2, ni * boltzmann, ni / boltzmann
    for Nt in TRAPS:

        def rates(t, y, Nt=Nt, rest=Nt * n0 / (n0 + n1)):  # rest: filled traps in equilibrium
            n, p = y
            m = rest + (p - 1) - (n - n0)
            return -(n * (Nt - m) - n1 * m) / (law.tau_n * Nt), -(p * m - p1 * (Nt - m)) / (law.tau_p * Nt)

        found = []
        for start in (1e23 / p0, 1e24 / p0):
            times = np.linspace(10e-9, 600e-9, 1181)  # the traps have filled
            y = solve_ivp(rates, (0, 6e-7), (n0 + start, 1 + start), "LSODA", times, rtol=1e-9, atol=1e-12).y
            N = (y[0] - n0) * p0
            tau = -N / (np.array([rates(0, one)[0] for one in y.T]) * p0)
            found.append(np.abs(tau / law.lifetime(N) - 1)[(N > 1e21) & (N < 1e24)].max())
        off[f"{Nt:g}"] = max(found)
    return Result(off)


@figure
def fig3a(carriers, probe):
    ax = panel(4.6, 3.8)
    for name, (_, style, colour) in LAWS.items():
        time, N = carriers.data[name]["time"].values * 1e9, carriers.data[name]["carriers"].values * 1e-6
        ax.semilogy(time, N, style, color=colour, label=f"lifetimes {name}")
    for which, colour in (("slow", SKY), ("fast", ORANGE)):  # of those exchanged
        tau, middle = carriers.numbers["exchanged"][f"{which}_s"] * 1e9, 1e9 * np.mean(WINDOWS[which])
        line = np.interp(middle, time, N) * np.exp(-(time - middle) / tau)
        ax.semilogy(time, line, color=colour, linewidth=0.9, label=f"τ = {tau:.0f} ns")
    ax.set(xlabel="time after the pump pulse (ns)", ylabel="excess carriers (cm$^{-3}$)", xlim=(0, 300))
    ax.set_ylim(N.min() / 2, 2 * N.max())
    behind = probe.data["transmission"]
    pulses = np.arange(3)[:, None]
    time = (behind["time"].values + pulses * REPEATED).ravel() * 1e6
    inset = ax.inset_axes((0.6, 0.62, 0.37, 0.3))
    inset.plot(time, np.tile(behind["through"].values, pulses.size), color=INK, linewidth=0.9)
    inset.set(xlim=(0, 3), ylim=(0, 1.05), yticks=(0, 1))
    inset.set_title("probe power, time (µs)", fontsize="x-small")
    inset.tick_params(labelsize="x-small")
    return legend(ax, "lower left")


@figure
def fig3b(carriers):
    ax = panel()
    for name, (_, style, colour) in LAWS.items():
        data = carriers.data[name]
        ax.semilogx(data["carriers"] * 1e-6, data["lifetime"] * 1e9, style, color=colour, label=f"lifetimes {name}")
    ax.axhspan(20, 60, color=SKY, alpha=0.15, linewidth=0, label="the paper's bounds")
    ax.set(xlabel="excess carriers (cm$^{-3}$)", ylabel="carrier lifetime (ns)", ylim=(0, 70))
    return legend(ax, "lower right")
