"""Error against number of states: Newton, second order, SINDy, Foster 3..8 and the certified reduction of one ring.

python examples/compact_models.py [geometry.toml] [picture.png]
"""

import dataclasses
import sys

import numpy as np

import surrogate
import thermofem as th
from surrogate.plot import plot_error_against_states
from thermofem.plot import save_figure

ring = th.CrossSection.from_toml(sys.argv[1]) if len(sys.argv) > 1 else th.strip_ring()
shells = tuple(th.Probe(name=f"{d:g} um", part="core", shell=1e-6 * d) for d in (0.1, 0.3, 0.8, 1.8))
heat = th.assemble(dataclasses.replace(ring, probes=shells))
read = ("core", *(p.name for p in shells))
parts = [surrogate.reduce(heat.channels("core", name), 1e-5).model for name in read]
fem, telegraph, long = parts[0], th.Telegraph(2e-3, dwell=5e-7, duration=4e-5, seed=1), np.arange(20_000) * 2e-9
probed = th.dataset.build(long, np.stack([p.response(telegraph, long) for p in parts], axis=1), telegraph, read=read)
square = th.solve_periodic(heat, th.SquareWave(power=2e-3, period=1e-6, duty=1 / 3))
step = th.solve(heat, th.Constant(2e-3), np.geomspace(1e-9, 1e-3, 121), rtol=1e-6)
models = {"Newton": surrogate.fit_newton(square).model, "second order": surrogate.fit_second_order(square).model}
models["SINDy"] = surrogate.fit_sindy(probed, [p.thermal_resistance for p in parts]).model.poles
models |= {f"Foster, trained ({n})": surrogate.fit_foster(step, n).model for n in range(3, 9)}
models |= {
    f"certified reduction ({t:g})": surrogate.reduce(heat.system, t).model for t in (0.1, 0.03, 0.01, 0.003, 0.001)
}
error = surrogate.compare(models, fem, surrogate.square_waves())
save_figure(plot_error_against_states(error), sys.argv[2] if len(sys.argv) > 2 else "compact_models.png")
