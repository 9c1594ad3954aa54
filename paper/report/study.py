"""Results and figures of the scripts; a function takes the results that its parameters name."""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field

STUDIES, FIGURES = {}, {}  # by name


@dataclass(frozen=True)
class Result:
    """Numbers (any JSON value), datasets and thermal models by name; once stored, CPU seconds and its files."""

    numbers: Mapping
    data: Mapping = field(default_factory=dict)
    models: Mapping = field(default_factory=dict)
    seconds: float = 0.0
    files: list[str] = field(default_factory=list)


def needs(function):
    """Names of the results that a study or figure takes."""
    return list(inspect.signature(function).parameters)


def study(words, quick=False):
    """Register a study: words of the progress bar, and whether the short version has it."""

    def register(function):
        function.words, function.quick = words, quick
        STUDIES[function.__name__] = function
        return function

    return register


def figure(function, name=None):
    """Register a function that draws a panel and returns its Axes."""
    FIGURES[name or function.__name__] = function
    return function
