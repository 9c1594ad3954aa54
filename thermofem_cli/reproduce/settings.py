"""Size of a reproduction: the whole paper, the one-minute version, or the smallest, for tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thermofem.arrays import Array

HEATING = 2e-3  # W, the paper's heating in Figs. 5 and 7
CENTRE = (8.0, 0.0)  # dBm and GHz: the point of the paper's Fig. 5(b)
MARKED = ((7.0, -10.0), CENTRE, (8.0, 20.0))  # dBm and GHz: points (1), (2), (3), whose places the paper only draws


@dataclass(frozen=True)
class Settings:
    """Sizes of the stages; every field that a stage uses is part of what its result is kept under.

    accuracy: of the mesh.
    grid [(int, int)]: powers (3 to 10 dBm) and detunings (-30 to 30 GHz) of a map.
    duration [s]: of every run of a map.
    scan: free-carrier dispersions and time constants tried for Newton's law, each.
    fitted: FEM-in-the-loop traces that Newton's law is fitted to, one by one.
    run [s]: of a FEM-in-the-loop run.
    loop_every: every how many powers and detunings of a map the FEM itself is put in the loop.
    runs: independent trainings of the second-order equation on traces, for its standard deviations.
    cycle: samples of the absorbed power that Fig. 5(b) hands to the FEM.
    repeats: timed runs, of which the median counts.
    quick: leaves out every stage and figure that needs maps or the FEM in the loop.
    """

    accuracy: float = 1e-3
    grid: tuple[int, int] = (29, 36)
    duration: float = 60e-6
    scan: int = 6
    fitted: int = 12
    run: float = 20e-6
    loop_every: int = 5
    runs: int = 4
    cycle: int = 151
    repeats: int = 15
    quick: bool = False

    @property
    def powers(self) -> Array:
        """W."""
        return np.asarray(1e-3 * 10 ** np.linspace(0.3, 1.0, self.grid[0]))

    @property
    def detunings(self) -> Array:
        """Hz."""
        return np.linspace(-30e9, 30e9, self.grid[1])


def watts(dbm: float) -> float:
    """Power in W of a power in dBm."""
    return float(1e-3 * 10 ** (dbm / 10))
