"""The promised accuracy on random cross-sections: `assemble` keeps it, or says that it does not.

    python tests/audit/accuracy.py [count [first [accuracy]]]

A third as many random strips follow, which take a committed mesh with moved vertices. Every channel that decides about
the mesh is compared with cubic elements on a mesh divided in four and graded further at all corners (`truth`). A
channel that errs more than the accuracy, where the estimate of its mesh does not say so, is a broken promise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

import channels
import truth

import thermofem as th
from thermofem.fem.assembly import meshed


def audit(geometry: th.CrossSection, accuracy: float) -> list[tuple[tuple[str, str], float, float]]:
    """Channel, true error and estimated error of every channel of one cross-section, as the mesh is judged by them."""
    heat, mesh = meshed(geometry, accuracy)
    estimate = heat.estimate()
    true = truth.errors(heat, mesh, tuple(estimate.errors))
    return [
        (c, true[c] * estimate.weights[c], float(e.max()) * estimate.weights[c]) for c, e in estimate.errors.items()
    ]


def broken(true: float, estimated: float, accuracy: float) -> bool:
    """Whether an error is larger than promised, and the mesh does not say so."""
    return true > accuracy >= estimated


def main() -> None:
    count, first, accuracy = (
        float(sys.argv[k]) if len(sys.argv) > k else default for k, default in ((1, 200), (2, 0), (3, 1e-3))
    )
    ratios, lost, said = [], 0, 0
    drawn = [(seed, channels.cross_section) for seed in range(int(first), int(first + count))]
    drawn += [(seed, channels.strip) for seed in range(int(first), int(first + count / 3))]
    for seed, draw in drawn:
        for channel, true, estimated in audit(draw(seed), accuracy):
            ratios.append(true / estimated)
            lost += broken(true, estimated, accuracy)
            said += estimated > accuracy
            note = "  BROKEN" if broken(true, estimated, accuracy) else ""
            print(
                f"{draw.__name__} {seed} {' -> '.join(channel)}: true {true:.2e}, estimated {estimated:.2e}{note}",
                flush=True,
            )
    low, middle, high = np.quantile(ratios, [0, 0.5, 1])
    print(
        f"{len(drawn)} cross-sections, {len(ratios)} channels at accuracy {accuracy:g}: {lost} broken, {said} flagged"
    )
    print(
        f"true/estimated {low:.2f} / {middle:.2f} / {high:.2f} (smallest, median, largest); thermofem {th.__version__}"
    )
    sys.exit(lost > 0)


if __name__ == "__main__":
    main()
