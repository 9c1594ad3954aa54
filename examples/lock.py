"""Lock a ring to a laser: a PI controller on the drop power moves the heater. Needs python-control.

The plant, from heater to drop power, is the linear ring with the light's feedback. python-control designs on it, and
the full equations then run in windows of 1 us with the heater held between: against steps of the package's temperature,
and from a hot start. The figure shows where the linear answer ends. Writes lock.png.
"""

from dataclasses import replace

import control
import numpy as np
from matplotlib import pyplot as plt

import coupled
import surrogate
import thermofem as th

POWER, DETUNING, HEATER = 1e-3, -12e9, 2e-3  # W, Hz, W
WINDOW = 1e-6  # s, between two settings of the heater
CROSSOVER = 8e3  # Hz
WINDOWS = 150
STEPS = (0.05, 1.5)  # K, of the package
HOT = 0.5  # K, of a hot start

heat = th.assemble(th.heated_ring())
model = surrogate.reduce(heat.channels(("core", "heater"), "core"), tolerance=1e-3).model
ring = coupled.borghi2021()
# the detuning counts from the ring that the heater has moved
warm = ring.thermal_shift / (2 * np.pi) * model.channel("heater", "core").thermal_resistance * HEATER
light = {"power": POWER, "detuning": DETUNING - warm, "heated": "core"}
linear = coupled.linearize(ring, model, heaters={"heater": HEATER}, **light)
setpoint = float(linear.state["drop"])

# ---- design: C(z) = k (1 + w T/(z - 1)), with unit gain of C G at the crossover ----------------
sampled = control.sample_system(linear.to_control(balanced=True), WINDOW)
plant = sampled["drop", "heater"]
zero = 2 * np.pi * CROSSOVER / 2  # rad/s, an octave below the crossover
shape = control.tf([1, zero * WINDOW - 1], [1, -1], WINDOW)
delay = control.tf([1], [1, 0], WINDOW)  # the drop power of a window sets the heater of the next one
z = np.exp(2j * np.pi * CROSSOVER * WINDOW)
at_crossover = plant(z) * shape(z) * delay(z)
gain = np.sign(linear.static[0, linear.inputs.index("heater")]) / abs(at_crossover)  # W/W
loop = plant * control.ss(gain * shape * delay)
omega = 2 * np.pi * np.geomspace(1e2, 0.49 / WINDOW, 2000)
gain_margin, phase_margin, _, crossing = control.margin(control.frd(loop, omega))
print(f"R_eff {linear.thermal_resistance / 1e3:.3g} K/mW, drop {setpoint * 1e6:.3g} uW")
print(f"crossover {crossing / 2 / np.pi / 1e3:.3g} kHz, margins {phase_margin:.3g} degrees and {gain_margin:.3g}")


def locked(ambient, initial):
    """Drop power at the end of every window, by the full equations, with the package ``ambient`` (K) warmer."""
    error = total = 0.0
    drops = []
    for _ in range(WINDOWS):
        watts = HEATER + gain * (error + zero * WINDOW * total)
        heater = min(max(watts, 0.0), 10 * HEATER)
        run = coupled.simulate(
            ring, model, duration=WINDOW, times=[WINDOW], heaters={"heater": heater}, ambient=ambient,
            initial=initial, **light,
        )  # fmt: skip
        initial = coupled.State.end_of(run)
        drops.append(float(run["drop"][-1]))
        total += error
        error = setpoint - drops[-1]
    return np.array(drops)


def predicted(ambient):
    """The same by the linear ring: from ambient to drop power with the loop closed."""
    closed = control.feedback(control.ss([], [], [], 1.0, WINDOW), loop) * sampled["drop", "ambient"]
    return control.forced_response(closed, T=times, U=np.full(WINDOWS, ambient)).outputs


times = np.arange(WINDOWS) * WINDOW
at_rest = coupled.State.end_of(
    coupled.simulate(ring, model, duration=300e-6, heaters={"heater": HEATER}, times=[300e-6], **light)
)
share = np.asarray(at_rest.thermal) / np.sum(at_rest.thermal)
hot = replace(at_rest, thermal=np.asarray(at_rest.thermal) + HOT * share)

figure, ax = plt.subplots(figsize=(5.7, 3.8), layout="constrained")
for step, colour in zip(STEPS, ("#0072B2", "#D55E00"), strict=True):
    drops = locked(step, at_rest)
    ax.plot((times + WINDOW) * 1e6, drops * 1e6, color=colour, label=f"package {step:g} K warmer")
    ax.plot(times * 1e6, (setpoint + predicted(step)) * 1e6, color=colour, linestyle=":", label="linear")
    print(f"package {step:g} K warmer: {abs(drops - setpoint).max() / setpoint:.1%} at most", end="")
    print(f", {abs(drops[-1] - setpoint) / setpoint:.2%} at the end")
drops = locked(0.0, hot)
ax.plot((times + WINDOW) * 1e6, drops * 1e6, color="#009E73", label=f"hot start, {HOT:g} K")
print(f"hot start of {HOT:g} K: {abs(drops[-1] - setpoint) / setpoint:.2%} at the end")
ax.axhline(setpoint * 1e6, color="#222222", linewidth=0.6)
ax.set(xlabel="time (µs)", ylabel="drop power (µW)", xlim=(0, times[-1] * 1e6))
ax.legend(frameon=False, fontsize="small")
figure.savefig("lock.png", dpi=200)
