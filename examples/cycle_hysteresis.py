"""Where Newton's law pulses beside a stable point: a branch of cycles with its fold, and the borders of the map.

python examples/cycle_hysteresis.py [picture.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
from coupled.plot import plot_branch, plot_map

ring, newton, power = coupled.borghi2021().with_lumped_fcd(), surrogate.newton(tau_th=275e-9), 5e-3
figure, (above, below) = plt.subplots(2, 1, figsize=(5.7, 7.4), layout="constrained")

branch = coupled.continue_cycle(ring, newton, "detuning", (8e9, -2e9), power=power, detuning=-2e9)
fixed = coupled.transmission(ring, newton, power=power, detuning=(-2e9, 7e9))
plot_branch(branch, above, fixed=fixed)
steps = np.linspace(-1.5e9, 6.5e9, 41)
for name, values, marker in (("up", steps, ">"), ("down", steps[::-1], "<")):
    run, seen = None, []
    for nu in values:
        run = coupled.simulate(ring, newton, power=power, detuning=nu, duration=40e-6, rtol=1e-6, initial=run)
        late = run["drop"].values[run["time"].values > 36e-6] * 1e3
        seen.append((nu * 1e-9, late.min(), late.max()))
    x, low, high = np.array(seen[::2]).T
    style = {"marker": marker, "linestyle": "", "markersize": 4, "color": "#0072B2", "markerfacecolor": "none"}
    above.plot(x, high, label=f"integrated, laser stepped {name}", **style)
    above.plot(x, low, **style)
above.legend(frameon=False, fontsize="small", loc="center left", bbox_to_anchor=(0, 0.59))
above.set_title(f"{power * 1e3:g} mW", fontsize="small")

powers, detunings = np.geomspace(2e-3, 10e-3, 60), np.linspace(-20e9, 20e9, 80)
curves = coupled.cycles.cycle_folds.cycle_fold_curves(ring, newton, powers, detunings)
folds = [*coupled.fold_curves(ring, newton, powers, detunings), *curves]
hopf = coupled.hopf_curves(ring, newton, powers, detunings)
plot_map(coupled.stability_map(ring, newton, powers, detunings), ax=below, hopf=hopf, folds=folds)
below.set_title("linear stability, Hopf curve (dashed), folds of cycles (dash-dotted)", fontsize="small")

(fold,) = branch["detuning"].values[branch["special"].values == "fold"]
(first,) = branch["detuning"].values[branch["special"].values == "Hopf"]
print(f"at {power * 1e3:g} mW: pulses or rest between {first * 1e-9:.3f} and {fold * 1e-9:.3f} GHz")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "cycle_hysteresis.png", dpi=220)
