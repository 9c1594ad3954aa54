"""Heating waveforms P(t): a waveform knows its own jumps and its exact mean.

Contract of a `Waveform` (anything that satisfies it can drive every model):

1. ``wave(t)`` is the power in W at time ``t`` in s (scalar or array), continuous from the right; those of this folder
   raise InputError where ``t`` is text or not finite.
2. ``wave.before(t)`` is the limit from the left; it differs from ``wave(t)`` only at jumps.
3. ``wave.breakpoints(start, stop)`` are the sorted times strictly inside (start, stop) where P jumps or has a kink;
   every integrator lands on them.
4. ``wave.mean(start, stop)`` is the exact mean of P over [start, stop].
5. ``wave.period`` is the period in s, or None.
6. ``wave.piecewise_linear`` says whether P is a straight line between breakpoints.
7. ``wave.time_scale``, optional, is the shortest time in s in which a smooth P changes. Models see a smooth P as cubics
   between times that are found by sampling (`adaptive.fitted`), and no step is longer than two of them; features
   narrower than 1e-4 of a stretch without breakpoints need a time scale or breakpoints to be found.
8. ``wave.cubics(start, stop)``, optional, returns those cubics where the waveform knows them exactly.
9. ``wave.words``, optional, is a short description: "pulse 2 mW, 20 us".

To add a waveform, write one file in this folder: a frozen dataclass that keeps the contract, with the decorator
`contract.stored` where its fields are numbers and arrays. It is found by itself: as ``th.Name`` and in files. One
instance of it goes into tests/test_every_waveform.py, which drives every model with it, and of which the tests of
readers damage every field.
"""

from __future__ import annotations

import pkgutil
from importlib import import_module
from typing import Any

from .chirp import Chirp
from .constant import Constant
from .contract import KINDS, Waveform, words
from .cubic import Cubic
from .files import from_json, storable, to_json
from .function import Function
from .pieces import (
    Pieces,
    bounds,
    check_heating,
    cubic_pieces,
    heating_pieces,
    hermite,
    knots,
    linear_pieces,
    period_times,
)
from .piecewise_cubic import PiecewiseCubic
from .pulse import Pulse
from .sampled import Sampled
from .square_wave import SquareWave
from .symbols import Symbols
from .telegraph import Telegraph

__all__ = [
    "KINDS", "Chirp", "Constant", "Cubic", "Function", "Pieces", "PiecewiseCubic", "Pulse", "Sampled", "SquareWave",
    "Symbols", "Telegraph", "Waveform", "bounds", "check_heating", "cubic_pieces", "from_json", "heating_pieces",
    "hermite", "knots", "linear_pieces", "period_times", "storable", "to_json", "words",
]  # fmt: skip

for _found in pkgutil.iter_modules(__path__):  # a new file in this folder joins by itself
    import_module(f"{__name__}.{_found.name}")


def __getattr__(name: str) -> Any:
    """Find a waveform that was added as a file of this folder."""
    if name in KINDS:
        return KINDS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
