"""The promised accuracy where two parts touch in a corner only, with another material or a void between them.

    python tests/audit/corners.py [count [first [accuracy]]]

There dividing triangles or adding cubic functions finds little of the error (`thermofem.fem.singular`). The exact
values are extrapolated: as a function of x = h^(2 lambda), h the size at the corner, Z is (a + b x)/(1 + c x), as that
of a line with one wave in either direction.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))

import truth

import thermofem as th
from thermofem.fem.assembly import meshed
from thermofem.fem.heat_problem import HeatProblem
from thermofem.fem.mesh_refinement import refined
from thermofem.mesh.triangles import Mesh

AT_CORNER = 10  # divisions there, the last `FITTED` of which are extrapolated
FITTED = 5


def cross_section(seed: int) -> th.CrossSection:
    """A random core and a neighbour that touches one of its corners; in some, a void lies between them."""
    rng = np.random.default_rng([seed, 7])

    def log(low: float, high: float) -> float:
        return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.4g}")

    around = th.Material("around", log(0.3, 3), 2200, 700)
    ratio = log(0.3, 3) if rng.random() < 0.3 else 1.0
    k_z = around.conductivity * ratio
    around = th.Material("around", around.conductivity, 2200, 700, conductivity_z=k_z)
    contrast = log(6, 2000)
    good = [th.Material(name, contrast * around.conductivity * log(0.7, 1.5), 2330, 700) for name in ("one", "two")]
    inner, width, height = log(3e-6, 10e-6), log(200e-9, 800e-9), log(80e-9, 400e-9)
    outer, above, below = inner + width, height + log(0.3e-6, 3e-6), log(0.5e-6, 3e-6)
    right, high = rng.random() < 0.6, rng.random() < 0.5
    reach, thick = log(0.3e-6, 2.5e-6), log(0.1, 1.0)
    start, stop = (outer, outer + reach) if right else (inner - reach, inner)
    bottom, tall = (height, thick * (above - height)) if high else (-thick * below, thick * below)
    angle = math.radians(rng.uniform(60, 90)) if rng.random() < 0.3 and not high else math.pi / 2
    core = th.Part("core", "one", inner, outer, 0.0, height, heated=True)
    lean = tall / math.tan(angle) if angle < math.pi / 2 else 0.0  # the top is narrower: its corner stays at the core's
    parts = [core, th.Part("other", "two", start - lean * right, stop + lean * (not right), bottom, tall, angle)]
    if rng.random() < 0.25:
        parts.append(th.Part("void", "void", start, stop, 0.0, height if high else log(0.1, 0.9) * above))
    return th.CrossSection(
        "corner",
        5 * (outer + reach),
        (
            th.Layer("substrate", "Si", 20e-6),
            th.Layer("box", "around", below, datum=True),
            th.Layer("cladding", "around", above),
        ),
        tuple(parts),
        materials=(around, *good),
    )


def static_and_shifted(heat: HeatProblem, shifts: NDArray[np.float64]) -> NDArray[np.float64]:
    """c^T (K + s M)^-1 c of the heated part."""
    d = heat.discretization
    c = d.means[heat.heated[0]][d.free]
    return np.array([float(c @ d.factors.solve(s, 1.0, c)) for s in shifts])


def extrapolated(heat: HeatProblem, mesh: Mesh, shifts: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same without any mesh error at the most singular corner, and with cubic elements elsewhere."""
    corners = heat.estimate().corners
    exponent, found = min(corners.values()), []
    for _ in range(AT_CORNER):
        at = np.any([(mesh.points == point).all(axis=1) for point in corners], axis=0)
        mesh = refined(mesh, at[mesh.triangles].any(axis=1))[0]
        found.append(static_and_shifted(truth.cubic(heat.geometry, mesh), shifts))
    z = np.array(found[-FITTED:])
    x = 4.0 ** (-exponent * np.arange(FITTED))
    return np.array(
        [np.linalg.lstsq(np.column_stack([x**0, x, -x * own / own[0]]), own, rcond=None)[0][0] for own in z.T]
    )


def audit(geometry: th.CrossSection, accuracy: float) -> tuple[float, float, float]:
    """Smallest exponent (1 where no corner is singular), largest true and estimated errors, at the worst shift each."""
    heat, mesh = meshed(geometry, accuracy)
    estimate = heat.estimate()
    if not estimate.corners:
        return 1.0, 0.0, estimate.largest
    exact = extrapolated(heat, mesh, estimate.shifts)
    true = np.abs(exact / static_and_shifted(heat, estimate.shifts) - 1)
    return min(estimate.corners.values()), float(true.max()), estimate.largest


def main() -> None:
    count, first, accuracy = (
        float(sys.argv[k]) if len(sys.argv) > k else default for k, default in ((1, 40), (2, 0), (3, 1e-2))
    )
    ratios, lost = [], 0
    for seed in range(int(first), int(first + count)):
        exponent, true, estimated = audit(cross_section(seed), accuracy)
        lost += true > max(accuracy, estimated)
        note = "  BROKEN" if true > max(accuracy, estimated) else ""
        ratios.append(true / estimated)
        print(f"{seed}: exponent {exponent:.3f}, true {true:.2e}, estimated {estimated:.2e}{note}", flush=True)
    low, middle, high = np.quantile(ratios, [0, 0.5, 1])
    print(f"{len(ratios)} corners at accuracy {accuracy:g}: {lost} broken")
    print(
        f"true/estimated {low:.2f} / {middle:.2f} / {high:.2f} (smallest, median, largest); thermofem {th.__version__}"
    )
    sys.exit(lost > 0)


if __name__ == "__main__":
    main()
