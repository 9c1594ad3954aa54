"""A ring as a neuron: below the onset of self-pulsing, a short pulse on a bias fires one large pulse, or nothing.

(a) the drop power after pulses of 10 ns on a bias of 6 dBm, (b) the largest temperature rise against the energy of the
pulse, for three biases, (c) the response to a second, equal pulse: while the ring is hot it does not fire, and then its
ringing helps or hinders.
The heat is the FEM's certified reduction; nothing is fitted.

python examples/excitability.py [picture.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th

ring, detuning, width, start = coupled.borghi2021(), 25e9, 10e-9, 0.5e-6
model = surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3).model


def at_rest(bias):
    """The ring after 60 us under the bias alone."""
    return coupled.simulate(ring, model, power=bias, detuning=detuning, duration=60e-6, times=[60e-6])


def answer(rest, *pulses, duration=4e-6):
    """The run from there with pulses on the bias."""
    bias = rest.attrs["input_power"]
    return coupled.simulate(ring, model, power=[bias, *pulses], detuning=detuning, duration=duration, initial=rest)


def pulse(energy, at=start):
    """A pulse of this energy in J."""
    return th.Pulse(power=energy / width, width=width, start=at)


def rise(run, after=0.0):
    """How far the temperature rises above where the run began, in K."""
    return float(run.delta_T.values[run.time.values >= after].max() - run.delta_T[0])


figure, (a, b, c) = plt.subplots(3, 1, figsize=(5.7, 7.4), layout="constrained")
colours, dashes = ("#56B4E9", "#0072B2", "#D55E00"), ((0, (1, 1)), (0, (4, 1)), "-")
rest = at_rest(1e-3 * 10**0.6)
for energy, colour, dash in zip((15e-12, 22e-12, 30e-12), colours, dashes, strict=True):
    run = answer(rest, pulse(energy))
    a.plot(run.time * 1e6, run["drop"] * 1e3, color=colour, linestyle=dash, label=f"{energy * 1e12:.0f} pJ")
a.set(xlabel="time (µs)", ylabel="drop power (mW)", xlim=(0.3, 2.5))
a.legend(title="pulse energy", frameon=False)

energies = np.linspace(2, 60, 59) * 1e-12
for dbm, colour, dash in zip((4, 5, 6), colours, dashes, strict=True):
    quiet = at_rest(1e-3 * 10 ** (dbm / 10))
    rises = [rise(answer(quiet, pulse(energy))) for energy in energies]
    b.plot(energies * 1e12, rises, color=colour, linestyle=dash, label=f"{dbm} dBm")
b.set(xlabel="pulse energy (pJ)", ylabel="largest temperature rise (K)", xlim=(0, 60), ylim=(0, None))
b.legend(title="bias", frameon=False, fontsize="small", loc="upper left")

delays = np.linspace(0.4, 4, 55) * 1e-6  # the first pulse is over by then
second = []
for delay in delays:
    run = answer(rest, pulse(30e-12), pulse(30e-12, start + delay), duration=start + delay + 2e-6)
    before = float(np.interp(start + delay, run.time, run.delta_T))
    second.append(rise(run, start + delay) + float(run.delta_T[0]) - before)
c.plot(delays * 1e6, np.array(second) / rise(answer(rest, pulse(30e-12))), color=colours[2])
c.set(xlabel="delay of the second pulse (µs)", ylabel="second response over the first", xlim=(0, 4), ylim=(0, None))
for ax, letter in zip((a, b, c), "abc", strict=True):
    ax.set_title(f"({letter})", loc="left", fontsize="medium")
    ax.spines[["top", "right"]].set_visible(False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "excitability.png", dpi=200)
