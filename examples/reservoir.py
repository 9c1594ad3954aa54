"""One ring and three rings as a reservoir: delayed XOR and NARMA-10, with the heat of the FEM and with Newton's law.

The drop power, averaged over virtual nodes, is read out by a ridge regression. Needs scikit-learn, and reservoirpy
for the NARMA series and its error: pip install "thermofem[reservoir]".

python examples/reservoir.py [picture.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np
from reservoirpy.datasets import narma
from reservoirpy.observables import nrmse
from sklearn.linear_model import Ridge, RidgeClassifier

import coupled
import surrogate
import thermofem as th

BITS, WASHOUT, TRAINED, NODES, ORDER = 600, 50, 400, 12, 10
POWER = 1.5e-3  # W, of a one; a zero has 0.3 of it
COLOURS = ("#D55E00", "#56B4E9")
rng = np.random.default_rng(7)
bits = rng.integers(0, 2, BITS)
numbers = rng.uniform(0, 0.5, (BITS + ORDER, 1))
target = narma(BITS, order=ORDER, a1=0.3, a2=0.05, b=1.5, c=0.1, u=numbers)[1][:, 0]
mask = rng.uniform(0.2, 1.0, NODES)

ring = coupled.borghi2021()
positions = [(k * 20e-6, 0) for k in range(3)]
fem = surrogate.reduce_array(th.assemble(th.strip_ring(outer_radius=150e-6).opened()), positions, tolerance=1e-3)
laws = {"heat of the FEM": fem, "Newton's law, 275 ns": surrogate.newton(tau_th=275e-9)}
circuits = {"one ring": coupled.bus(ring), "three-ring SCISSOR": coupled.scissor([ring] * 3, phase=0.5)}


def features(circuit, law, stream):
    """Mean drop power of every node, one row for each symbol, scaled by mean and spread of the training."""
    heat = fem.channel(0, 0) if law is fem and len(circuit.names) == 1 else law
    run = coupled.simulate(
        circuit, heat, power={"in": stream}, detuning=-10e9, duration=stream.stop, rtol=1e-3,
        times=stream.samples(), average=True,
    )  # fmt: skip
    table = run.mean_output.sel(port=circuit.ports[-1]).values.reshape(-1, NODES)
    trained = table[WASHOUT:TRAINED]
    return (table - trained.mean(axis=0)) / (trained.std(axis=0) + 1e-12)


def xor_score(table, delay):
    """Share of untrained bits whose XOR with the one ``delay`` bits before is read right."""
    wanted, inputs = np.bitwise_xor(bits[delay:], bits[:-delay]), table[delay:]
    readout = RidgeClassifier(alpha=1e-3).fit(inputs[WASHOUT:TRAINED], wanted[WASHOUT:TRAINED])
    return readout.score(inputs[TRAINED:], wanted[TRAINED:])


def narma_error(table):
    """Root mean square error of untrained values, in units of the target's standard deviation."""
    readout = Ridge(alpha=1e-3).fit(table[WASHOUT:TRAINED], target[WASHOUT:TRAINED])
    rest = target[TRAINED:]
    return nrmse(rest[:, None], readout.predict(table[TRAINED:])[:, None], norm_value=rest.std())


delays, rates = np.arange(1, 6), (20e6, 5e6)
figure, axes = plt.subplots(3, 1, figsize=(5.7, 7.6), layout="constrained")
cases = [(c, law) for c in circuits for law in laws]
for rate, ax in zip(rates, axes, strict=False):
    stream = th.Symbols(bits, rate=rate, power=POWER, bias=0.3 * POWER, mask=np.ones(NODES), noise=0.005, seed=1)
    for name, law in cases:
        table = features(circuits[name], laws[law], stream)
        scores = [xor_score(table, delay) for delay in delays]
        print(f"XOR at {rate / 1e6:3.0f} Mbit/s, {name}, {law}: " + " ".join(f"{s:.2f}" for s in scores), flush=True)
        style = ("o" if name == "one ring" else "s") + "-"
        colour = COLOURS[list(laws).index(law)]
        ax.plot(delays, scores, style, color=colour, label=f"{name}, {law}", lw=1)
    ax.axhline(0.5, color="0.6", lw=0.6, ls=":")
    ax.set(xlabel="delay of the second bit (bits)", ylabel="share of bits read right", ylim=(0.35, 1.05), xticks=delays)
    ax.set_title(f"delayed XOR, {rate / 1e6:g} Mbit/s", fontsize="small", loc="left")

for k, (name, law) in enumerate(cases):
    errors = []
    for rate in rates:
        stream = th.Symbols(
            2 * numbers[ORDER:, 0], rate=rate, power=POWER, bias=0.3 * POWER, mask=mask, noise=0.005, seed=1
        )
        errors.append(narma_error(features(circuits[name], laws[law], stream)))
    print(f"NARMA-10, {name}, {law}: " + ", ".join(f"{e:.2f}" for e in errors), flush=True)
    hatch = None if name == "one ring" else "//"
    colour = COLOURS[list(laws).index(law)]
    axes[2].bar(np.arange(2) + 0.2 * k - 0.3, errors, 0.18, color=colour, hatch=hatch, ec="white")
axes[2].set_xticks([0, 1], [f"{rate / 1e6:g} Mvalues/s" for rate in rates])
axes[2].set_title("NARMA-10", fontsize="small", loc="left")
axes[2].set(ylabel="error / standard deviation", ylim=(0, 1.1))
figure.legend(
    *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize="small"
)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "reservoir.png", dpi=200)
