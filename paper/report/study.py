"""Results, figures and expected numbers of the scripts, and the size of a reproduction.

A study or figure takes the results that its parameters name; ``size`` stands for the sizes.
"""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

STUDIES, FIGURES = {}, {}  # by name
PAPER, OTHER = {}, {}  # "study/path/to/number": lowest and highest that agree with the paper, or with another code


@dataclass(frozen=True)
class Size:
    """How much is computed: fields of a small run differ.

    grid: powers (3 to 10 dBm) and detunings (-30 to 30 GHz) of a map; duration [s]: of each of its runs.
    scan: free-carrier dispersions and time constants tried for Newton's law, each.
    fitted: FEM-in-the-loop traces that Newton's law is fitted to; run [s]: of such a trace.
    loop_every: every how many powers and detunings of a map the FEM itself is put in the loop.
    runs: trainings on traces, for standard deviations; cycle: samples of the heat of Fig. 5(b); repeats: timed runs.
    """

    grid: tuple[int, int] = (29, 36)
    duration: float = 60e-6
    scan: int = 6
    fitted: int = 12
    run: float = 20e-6
    loop_every: int = 5
    runs: int = 4
    cycle: int = 151
    repeats: int = 15

    @property
    def powers(self):
        """W."""
        return 1e-3 * 10 ** np.linspace(0.3, 1.0, self.grid[0])

    @property
    def detunings(self):
        """Hz."""
        return np.linspace(-30e9, 30e9, self.grid[1])


@dataclass(frozen=True)
class Result:
    """Numbers (any JSON value), datasets and thermal models by name, and the CPU seconds that they took."""

    numbers: Mapping
    data: Mapping = field(default_factory=dict)
    models: Mapping = field(default_factory=dict)
    seconds: float = 0.0


def needs(function):
    """Names of the results that a study or figure takes."""
    return [name for name in inspect.signature(function).parameters if name != "size"]


def study(words, weight, quick=False):
    """Register a study: words of the progress bar, about how many s it takes, whether the short version has it."""

    def register(function):
        function.words, function.weight, function.quick = words, weight, quick
        STUDIES[function.__name__] = function
        return function

    return register


def figure(function, name=None):
    """Register a function that draws a panel and returns its Axes."""
    FIGURES[name or function.__name__] = function
    return function
