"""Section 7, the general remarks: where one exponential suffices, and what may be enlarged in place of c_p."""

from dataclasses import replace

import numpy as np

import coupled
import surrogate
import thermofem as th

from .printed import CENTRE, HEATING, HEAT_CAPACITY, NEWTON_MAPS, RING, at, describe
from .report.study import PAPER, Result, study

BITS = 2047
FACTORS = np.linspace(1, 8, 29)


@study("Section 7: on-off keying", 0.5, quick=True)
def keying(elements):
    """One exponential, silicon's c_p and tau_th = R_th m c_p so that the steady rise is the FEM's, under random bits.

    "off": rms difference from the FEM over the mean rise, in the periodic state; "ripple" of the FEM's own rise.
    """
    fem, numbers = elements.models["elements"], {}
    tau = fem.thermal_resistance * HEAT_CAPACITY
    newton = surrogate.newton(tau_th=tau, heat_capacity=HEAT_CAPACITY)
    bits = np.repeat(np.random.default_rng(7).integers(0, 2, BITS), 2) * 2.0 * HEATING
    for rate in (1e6, 1e9, 10e9, 25e9):
        edges = (np.arange(BITS)[:, None] + (0.05, 0.95)).ravel() / rate
        wave = th.Sampled(np.append(edges, BITS / rate), np.append(bits, bits[0]), repeat=True)
        rise, other = (model.periodic_response(wave, 32 * BITS + 1) for model in (fem, newton))
        off = {"off": np.std(other - rise) / rise.mean(), "ripple": np.std(rise) / rise.mean()}
        numbers[f"{rate * 1e-9:g}Gbps"] = off
    return Result(numbers | {"tau_th_s": tau})


@study("Section 7: c_p of silicon kept", 1, quick=True)
def kept(elements):
    """Newton's law with silicon's c_p and 275 ns at (8 dBm, 0 GHz): sigma_FCD, or tau_fc, times a factor.

    "least": from which factor on it pulses; "factor": where its period is nearest to the FEM-coupled ring's.
    """

    def pulses(ring, model):
        return describe(coupled.simulate(ring, model, **at(CENTRE), duration=20e-6))

    def dispersing(f):
        return replace(RING, fcd=tuple((f * sigma, exponent) for sigma, exponent in RING.fcd))

    def living(f):
        law = RING.carriers
        return replace(RING, carriers=replace(law, tau_n=f * law.tau_n, tau_p=f * law.tau_p))

    fem, numbers = pulses(RING, elements.models["reduction"]), {}
    for name, change in (("sigma", dispersing), ("lifetime", living)):
        found = {f: one for f in FACTORS if np.isfinite((one := pulses(change(f), NEWTON_MAPS))["period_s"])}
        numbers[name] = {"count": len(found), "least": min(found, default=None)}
        if found:
            near = min(found, key=lambda f: abs(found[f]["period_s"] - fem["period_s"]))
            numbers[name] |= {"factor": near, **found[near]}
    return Result(numbers | {"fem": fem, "tried": FACTORS.size, "most": FACTORS[-1]})


PAPER.update({
    "keying/1Gbps/off": (0, 0.1), "keying/10Gbps/off": (0, 0.05), "keying/25Gbps/off": (0, 0.05),
    "kept/sigma/least": (1.01, 8), "kept/lifetime/count": (1, 29),
})
