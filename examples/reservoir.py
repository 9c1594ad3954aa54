"""One ring and three rings as a reservoir: delayed XOR of a bit stream, with the heat of the FEM and with Newton's law.

The drop power is sampled at virtual nodes; a ridge regression reads it out. Needs scikit-learn (it comes with pysindy).

python examples/reservoir.py [picture.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from sklearn.linear_model import RidgeClassifier

import coupled
import surrogate
import thermofem as th

BITS, WASHOUT, TRAINED, NODES = 1200, 100, 700, 12
bits = np.random.default_rng(7).integers(0, 2, BITS)
ring = coupled.borghi2021()
positions = [(k * 20e-6, 0) for k in range(3)]
fem = surrogate.reduce_array(th.assemble(th.strip_ring(outer_radius=150e-6)), positions, tolerance=1e-3)
laws = {"heat of the FEM": fem, "Newton's law, 275 ns": surrogate.newton(tau_th=275e-9)}
circuits = {"one ring": coupled.bus(ring), "three-ring SCISSOR": coupled.scissor([ring] * 3, phase=0.5)}


def score(features, delay):
    """Share of bits whose XOR with the one ``delay`` bits before is read right, on bits that were not trained on."""
    wanted = np.bitwise_xor(bits[delay:], bits[:-delay])
    inputs = features[delay:]
    scale = inputs[WASHOUT:TRAINED].mean(axis=0), inputs[WASHOUT:TRAINED].std(axis=0) + 1e-12
    inputs = (inputs - scale[0]) / scale[1]
    readout = RidgeClassifier(alpha=1e-3).fit(inputs[WASHOUT:TRAINED], wanted[WASHOUT:TRAINED])
    return readout.score(inputs[TRAINED:], wanted[TRAINED:])


delays = np.arange(1, 7)
figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for rate, ax in zip((40e6, 5e6), axes, strict=True):
    stream = th.Symbols(bits, rate=rate, power=2e-3, bias=1e-3, mask=np.ones(NODES), noise=0.01, seed=1)
    for (circuit_name, circuit), marker in zip(circuits.items(), "os", strict=True):
        for (law, model), colour in zip(laws.items(), ("#D55E00", "#56B4E9"), strict=True):
            heat = model if len(circuit.names) == 3 or law != "heat of the FEM" else fem.channel(0, 0)
            run = coupled.simulate_circuit(
                circuit, heat, inputs={"in": stream}, detuning=-8e9, duration=stream.stop, rtol=1e-4,
                times=stream.samples(), average=True,
            )  # fmt: skip
            port = circuit.ports[-1]  # drop
            features = run.mean_output.sel(port=port).values.reshape(BITS, NODES)
            scores = [score(features, delay) for delay in delays]
            print(f"{rate / 1e6:3.0f} Mbit/s, {circuit_name}, {law}: " + " ".join(f"{s:.2f}" for s in scores))
            ax.plot(delays, scores, marker + "-", color=colour, label=f"{circuit_name}, {law}", lw=1)
    ax.axhline(0.5, color="0.6", lw=0.6, ls=":")
    ax.set(xlabel="XOR with the bit so many bits before", ylabel="share read right", ylim=(0.45, 1.03))
    ax.set_title(f"{rate / 1e6:g} Mbit/s", fontsize="small", loc="left")
axes[0].legend(frameon=False, fontsize="small")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "reservoir.png", dpi=150)
