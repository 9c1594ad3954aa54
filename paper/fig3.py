"""Fig. 3, Section 3 and Appendix B: how carriers made by a short pulse recombine, and whether traps hold them."""

import numpy as np
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
def fig3a(carriers):
    ax = panel()
    for name, (_, style, colour) in LAWS.items():
        time, N = carriers.data[name]["time"].values * 1e9, carriers.data[name]["carriers"].values * 1e-6
        ax.semilogy(time, N, style, color=colour, label=f"lifetimes {name}")
    for which, colour in (("slow", SKY), ("fast", ORANGE)):  # of those exchanged
        tau, middle = carriers.numbers["exchanged"][f"{which}_s"] * 1e9, 1e9 * np.mean(WINDOWS[which])
        line = np.interp(middle, time, N) * np.exp(-(time - middle) / tau)
        ax.semilogy(time, line, color=colour, linewidth=0.9, label=f"τ = {tau:.0f} ns")
    ax.set(xlabel="time after the pump pulse (ns)", ylabel="excess carriers (cm$^{-3}$)", xlim=(0, 300))
    ax.set_ylim(N.min() / 2, 2 * N.max())
    return legend(ax)


@figure
def fig3b(carriers):
    ax = panel()
    for name, (_, style, colour) in LAWS.items():
        data = carriers.data[name]
        ax.semilogx(data["carriers"] * 1e-6, data["lifetime"] * 1e9, style, color=colour, label=f"lifetimes {name}")
    ax.axhspan(20, 60, color=SKY, alpha=0.15, linewidth=0, label="the paper's bounds")
    ax.set(xlabel="excess carriers (cm$^{-3}$)", ylabel="carrier lifetime (ns)", ylim=(0, 70))
    return legend(ax, "lower right")
