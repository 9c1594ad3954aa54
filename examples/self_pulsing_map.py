"""Newton, the second-order equation and the reduced FEM: where a ring self-pulses, how fast, and for how long a cycle.

python examples/self_pulsing_map.py [picture.png]
"""

import sys

import numpy as np

import coupled
import surrogate
import thermofem as th
from coupled.plot import plot_maps

ring, powers, detunings = coupled.borghi2021(), 1e-3 * 10 ** np.linspace(0.3, 1, 29), np.linspace(-30e9, 30e9, 36)
cases = {
    "Newton, 275 ns": (ring.with_lumped_fcd(), surrogate.newton(tau_th=275e-9)),
    "second order, as printed": (ring, surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)),
    "FEM, reduced": (ring, surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3).model),
}
maps = {name: coupled.pulsing_map(*case, powers, detunings, duration=60e-6) for name, case in cases.items()}
hopf = {name: coupled.hopf_curves(*case, powers, detunings) for name, case in cases.items()}
folds = {name: coupled.fold_curves(*case, powers, detunings) for name, case in cases.items()}
figure = plot_maps(maps, hopf=hopf, folds=folds)[0, 0].figure
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "self_pulsing_map.png", dpi=200)
