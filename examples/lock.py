"""Lock a ring to a laser: a PI controller on the drop power moves the heater. Needs python-control.

The plant, from heater to drop power, is the linear ring with the light's feedback. python-control designs on it. The
full equations then run in windows of 1 us with the heater constant in each: under a step of the package's temperature,
a step of the heater of the neighbouring ring, and from a hot start. A small dither of the heater measures the plant's
gain while the loop is closed: where it leaves the value of the linear ring, the linear answer ends. Writes lock.png.
"""

from dataclasses import replace

import control
import numpy as np
from matplotlib import pyplot as plt

import coupled
import surrogate
import thermofem as th

POWER, DETUNING, HEATER = 1e-3, -12e9, 2e-3  # W, Hz (from the resonance that the heater has moved), W
WINDOW, WINDOWS = 1e-6, 240  # s, between two settings of the heater
CROSSOVER = 20e3  # Hz
DITHER, PERIOD, FITTED = 20e-6, 4, 16  # W, windows, windows of a fit

heat = th.assemble(th.heated_ring().opened())
array = surrogate.reduce_array(heat, [(0, 0), (20e-6, 0)], tolerance=1e-2, heaters=["heater"])
model, ring = array.model, coupled.borghi2021()
turned = ring.thermal_shift / (2 * np.pi) * model.channel("heater 1", "ring 1").thermal_resistance * HEATER
ports = {"heated": "ring 1", "read": "ring 1"}
light = {"power": POWER, "detuning": DETUNING - turned, **ports}
idle = {"heater 1": HEATER, "heater 2": 0.0}
linear = coupled.linearize(ring, model, heaters=idle, **light)
setpoint = float(linear.state["drop"])
print(f"R_eff {linear.thermal_resistance / 1e3:.3g} K/mW, drop {setpoint * 1e6:.3g} uW")

# ---- design: C(z) = gain (1 + zero T/(z - 1)), with |C G| = 1 at the crossover --------------------------------------
# the drop power at the end of a window sets the heater of the next one: the sampled plant has that delay
sampled = control.sample_system(linear.to_control(balanced=True), WINDOW)
plant = sampled["drop", "heater 1"]
zero = 2 * np.pi * CROSSOVER / 2  # rad/s, an octave below the crossover
shape = control.tf([1, zero * WINDOW - 1], [1, -1], WINDOW)
z = np.exp(2j * np.pi * CROSSOVER * WINDOW)
sign = np.sign(linear.static[0, linear.inputs.index("heater 1")])
gain = sign / abs(plant(z) * shape(z))  # W/W
loop = plant * control.ss(gain * shape)
omega = 2 * np.pi * np.geomspace(1e2, 0.49 / WINDOW, 2000)
gain_margin, phase_margin, _, crossing = control.margin(control.frd(loop, omega))
print(f"crossover {crossing / 2 / np.pi / 1e3:.3g} kHz, margins {phase_margin:.3g} degrees and {gain_margin:.3g}")


def locked(initial, ambient=0.0, neighbour=0.0):
    """Drop power (W) at the end of every window by the full equations: package ``ambient`` (K), ``neighbour`` (W)."""
    error = total = 0.0
    drops = []
    for k in range(WINDOWS):
        watts = HEATER + gain * (error + zero * WINDOW * total) + dither[k]
        heaters = {"heater 1": min(max(watts, 0.0), 10 * HEATER), "heater 2": neighbour}
        run = coupled.simulate(
            ring, model, duration=WINDOW, times=[WINDOW], heaters=heaters, ambient=ambient, initial=initial, **light
        )
        initial = coupled.State.end_of(run)
        drops.append(float(run["drop"][-1]))
        total += error
        error = setpoint - drops[-1]
    return np.array(drops)


def predicted(ambient=0.0, neighbour=0.0):
    """The same by the linear ring in the closed loop; its samples are at the begin of every window."""
    closed = control.feedback(control.ss([], [], [], 1.0, WINDOW), loop)
    inputs = np.outer([ambient, neighbour, 1.0], np.ones(WINDOWS + 1))
    inputs[2, :WINDOWS] = dither
    disturbed = closed * sampled["drop", ["ambient", "heater 2", "heater 1"]]
    return setpoint + control.forced_response(disturbed, U=inputs).outputs[0, 1:]


def dithered(drops):
    """Response to the dither (W/W): a cubic drift, a cosine and a sine are fitted to the windows up to each."""
    angle = 2 * np.pi * np.arange(FITTED) / PERIOD
    drift = np.vander(np.linspace(-1, 1, FITTED), 4)
    basis = np.column_stack([np.cos(angle), np.sin(angle), drift])
    parts = np.linalg.lstsq(basis, np.lib.stride_tricks.sliding_window_view(drops, FITTED).T)[0]
    return np.hypot(parts[0], parts[1]) / DITHER


k = np.arange(WINDOWS)
dither = DITHER * np.cos(2 * np.pi * k / PERIOD)
before = coupled.simulate(ring, model, duration=300e-6, times=[300e-6], heaters=idle, **light)
rest = coupled.State.end_of(before)
share = np.asarray(rest.thermal) / np.sum(rest.thermal)
hot = replace(rest, thermal=np.asarray(rest.thermal) + 0.5 * share)
tests = {
    "package 0.05 K warmer": ({"ambient": 0.05}, rest),
    "package 2 K warmer": ({"ambient": 2.0}, rest),
    "neighbour's heater at 4 mW": ({"neighbour": 4e-3}, rest),
    "hot start, 0.5 K": ({}, hot),
}
figure, (above, below) = plt.subplots(2, 1, figsize=(5.7, 5.6), layout="constrained", sharex=True)
times = (k + 1) * WINDOW * 1e6
for colour, (name, (step, initial)) in zip(("#0072B2", "#D55E00", "#CC79A7", "#009E73"), tests.items(), strict=True):
    drops = locked(initial, **step)
    above.plot(times, drops * 1e6, color=colour, label=name)
    below.plot(times[FITTED - 1 :], dithered(drops), color=colour)
    if step:
        above.plot(times, predicted(**step) * 1e6, color=colour, linestyle=":")
    late = drops[-FITTED:].mean()
    farthest = abs(drops / setpoint - 1).max()
    print(f"{name}: drop power {farthest:.1%} away at most, {abs(late / setpoint - 1):.2%} at the end")
below.plot(times, np.full(WINDOWS, dithered(predicted())[-1]), color="#222222", linestyle=":", label="linear ring")
above.axhline(setpoint * 1e6, color="#222222", linewidth=0.6)
above.plot([], [], color="#222222", linestyle=":", label="linear ring")
above.set(ylabel="drop power (µW)")
below.set(xlabel="time (µs)", ylabel="dither to drop power (W/W)", xlim=(0, times[-1]))
for panel in (above, below):
    panel.legend(frameon=False, fontsize="small")
figure.savefig("lock.png", dpi=200)
