"""Error against number of states: Newton, second order, SINDy, Foster 3..8, truncations and certified reductions.

python examples/compact_models.py [geometry.toml] [picture.png]
"""

import sys

import surrogate
import thermofem as th
from surrogate.plot import plot_error_against_states
from thermofem.plot import save_figure

ring = th.CrossSection.from_toml(sys.argv[1]) if len(sys.argv) > 1 else th.strip_ring()
ladder = surrogate.train_all(th.assemble(ring))
error = surrogate.compare(ladder.models, ladder.reference, surrogate.square_waves())
save_figure(plot_error_against_states(error), sys.argv[2] if len(sys.argv) > 2 else "compact_models.png")
print(surrogate.judge(ladder.models, ladder.reference).verdict)
