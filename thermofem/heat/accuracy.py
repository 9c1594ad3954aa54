"""Estimates of the mesh error of a thermal resistance and a step response.

For functionals c of the heated part and d of what is read, real s >= 0, u = (K + s M)^-1 c and w the same for d,

    Z(s) = d^T u,    Z_exact(s) - Z(s) = a(u_exact - u, w_exact - w),    a the bilinear form of K + s M

(a minimum principle where d = c: Z rises with every enrichment). The cubic functions that `enrichment` adds to u and w
on the same triangles stand for u_exact - u and w_exact - w, times `SATURATION`. As

    s Z(s) = int s^2 t exp(-s t) step(t) dt/t,    a kernel that is one decade wide in t around 1/s,

one s a decade sees the whole step response; s = 0 is R_th. The share of each triangle in a(u_3 - u, w_3 - w) says where
to refine, see `adaptive`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .matrices import properties

if TYPE_CHECKING:
    from .enrichment import Enrichment
    from .problem import HeatProblem

Array = NDArray[np.float64]

Channel = tuple[str, str]  # heated, read

SLOWEST, FASTEST = 5, 9  # powers of ten of the shifts in 1/s: of an ordinary chip, and of the step at 1 ns
FAINT = 1e-2  # of R_th: what another part feels less of is not worth a finer mesh
SATURATION = 2.0  # the exact energy over what the cubic functions add, at most (tests/audit/accuracy.py)
CROSS = 1.75  # for another part that is read: the most it took on 200 random cross-sections (there)
PEAK = 1.2  # between 0 and the last shift: what the error of the step may exceed its average over a decade by


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated errors of some channels at every shift, relative to their reference values.

    Attributes
    ----------
    shifts : array, shape (s,), 1/s
    errors : dict from (heated, read) to array, shape (s,)
    shares : dict from (heated, read) to array, shape (s, triangles)
        the same in every triangle, absolute values.
    weights : dict from (heated, read) to float
        what a channel counts when the mesh is judged: 1 where the heated part is read, else
        gain/(gain + `FAINT` R_th), as what is hardly felt is not worth a finer mesh.
    """

    shifts: Array
    errors: dict[Channel, Array]
    shares: dict[Channel, Array]
    weights: dict[Channel, float]

    @property
    def largest(self) -> float:
        """The largest of all errors, each times the weight of its channel."""
        return max(float(errors.max()) * self.weights[channel] for channel, errors in self.errors.items())


class MeshError:
    """Estimates the mesh error in the channels of one heat problem.

    Parameters
    ----------
    heat : HeatProblem
    """

    def __init__(self, heat: HeatProblem) -> None:
        self.heat = heat

    @cached_property
    def enrichment(self) -> Enrichment:
        """The cubic functions on the mesh."""
        from .enrichment import Enrichment

        return Enrichment.of(self.heat.discretization, *properties(self.heat.geometry, self.heat.mesh))

    @cached_property
    def shifts(self) -> Array:
        """One a decade from the slowest rate of the system to `FASTEST`, in 1/s; 0 last, as R_th comes next."""
        d = self.heat.discretization
        x = d.factors.solve(0.0, 1.0, d.E @ d.factors.solve(0.0, 1.0, d.means[self.heat.heated[0]][d.free]))
        slowest = float(x @ (d.K @ x)) / float(x @ (d.E @ x))  # Rayleigh's quotient after one inverse iteration
        first = min(SLOWEST, int(np.floor(np.log10(slowest))))
        return np.append(10.0 ** np.arange(FASTEST, first - 1, -1), 0.0)

    def estimate(self, channels: tuple[Channel, ...]) -> Estimate:
        """Estimate the errors of some channels: `SATURATION` (and `PEAK`) times |a(u_3 - u, w_3 - w)| / Z.

        Relative to Z(s) for a part that is heated and read. Where another part is read nothing has arrived early on,
        and the error is relative to its R_th; there each triangle counts with the root of its two energies, which is
        Cauchy's and Schwarz's inequality, times `CROSS`, as the parts may cancel in u_3 and not in the exact field.
        """
        heat, d = self.heat, self.heat.discretization
        names = list(dict.fromkeys(name for channel in channels for name in channel))
        means = np.column_stack([d.means[name] for name in names])
        load = np.column_stack([self.enrichment.mean(heat.geometry, heat.mesh, name) for name in names])
        values, totals, shares = [], [], []
        for s in self.shifts:
            found = np.zeros_like(means)
            found[d.free] = np.column_stack([d.factors.solve(s, 1.0, mean) for mean in means[d.free].T])
            values.append(means.T @ found)
            total, share = self.enrichment.added(s, found, load)
            totals.append(total)
            shares.append(share)
        between = (self.shifts > 0) & (self.shifts < self.shifts.max())
        factor = SATURATION * np.where(between, PEAK, 1.0)
        errors, local, weights = {}, {}, {}
        for heated, read in channels:
            i, j = names.index(heated), names.index(read)
            scale = np.array([v[j, i] for v in values]) if i == j else np.full(len(values), values[-1][j, i])
            pair = np.sqrt(np.abs([share[j, j] * share[i, i] for share in shares]))
            each = (factor if i == j else CROSS * factor)[:, None] * pair / np.abs(scale)[:, None]
            whole = factor * np.abs([total[j, i] for total in totals]) / np.abs(scale)
            errors[heated, read] = whole if i == j else each.sum(axis=1)
            local[heated, read] = each
            gain, own = abs(values[-1][j, i]), values[-1][i, i]
            weights[heated, read] = 1.0 if i == j else float(gain / (gain + FAINT * own))
        return Estimate(self.shifts, errors, local, weights)
