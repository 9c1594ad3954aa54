"""The test whether a drive can have caused the temperatures: a wrong duty, period or pulse width cannot.

The temperatures are fitted by poles on a grid of time constants, all at once. What this leaves is noise where the drive
is right, however few poles the model itself has. Noise has forgotten itself after a sixteenth of the time between two
edges; the misfit of a wrong drive has not. Over n lags of this length the autocorrelation of noise is 0 +- 1/sqrt(n).
"""

from __future__ import annotations

import numpy as np

from thermofem.data.dataset import Response

from .projection import FitProblem

PER_DECADE = 2  # time constants of the grid: with gains of either sign their sums follow a pole in between to 1e-3
BEYOND = 3.0, 10.0  # factors by which the grid exceeds the shortest and the longest time of the samples
LAGS = 16  # in the shortest time between two edges
FEWEST = 2  # samples in a lag: the noise of neighbouring samples may be one
SIGMAS = 3.0  # of the autocorrelation of noise
LARGE = 0.01  # of the swing: a smaller misfit moves the parameters by less than the choice of the model


def mismatch(response: Response) -> list[str]:
    """A sentence where no sum of poles, of gains of either sign, explains the temperatures under their drive."""
    problem = FitProblem([response])
    shortest, longest = problem.span
    low, high = shortest / BEYOND[0], longest * BEYOND[1]
    phi = problem.columns(-np.log(np.geomspace(low, high, int(PER_DECADE * np.log10(high / low)) + 2)))
    phi = phi[:, np.any(phi != 0, axis=0)]
    left = problem.target - phi @ problem.gains(phi)
    lag = max(FEWEST, _between_edges(response) // LAGS)
    if left.size <= 2 * lag:
        return []
    structure = float(np.mean(left[lag:] * left[:-lag]))
    if structure < LARGE**2 or structure < SIGMAS * np.sqrt(lag / left.size) * float(np.mean(left**2)):
        return []
    return [
        f"the drive does not match delta_T ({response.name}): whatever the poles, {np.sqrt(structure):.1%} of the "
        "swing remain and are not noise; check duty, period, width, start and edges of the power"
    ]


def _between_edges(response: Response) -> int:
    """Samples in the shortest interval between changes of the power; the first and the last may be cut off."""
    edges = response.wave.breakpoints(float(response.times[0]), float(response.times[-1]))
    counts = np.diff(np.concatenate([[0], np.searchsorted(response.times, edges), [response.times.size]]))
    return int(np.min(counts[1:-1] if counts.size > 2 else counts))
