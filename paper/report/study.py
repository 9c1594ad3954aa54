"""Results, figures and expected numbers of the scripts; a function takes the results that its parameters name."""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field

STUDIES, FIGURES = {}, {}  # by name
PAPER, OTHER = {}, {}  # "study/path/to/number": lowest and highest that agree with the paper, or with another code


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
