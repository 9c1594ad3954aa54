"""The rings of a page: the given one and the published ones, told apart by their numbers and not by their names."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from ..arguments import check_ring
from ..parameters import borghi2021, vanvaerenbergh2012
from ..resonator import RingResonator
from ..ring_toml import write_text

Window = dict[str, tuple[float, float]]  # of powers in dBm and of detunings in GHz

ROUND_OFF = 1e-12  # relative; a ring file writes a temperature for kT and may change its last digit
OF_MAPS: Window = {"power": (3.0, 10.0), "detuning": (-30.0, 30.0)}  # the maps of Borghi et al.
OF_SMALL: Window = {"power": (-10.0, 6.0), "detuning": (-35.0, 10.0)}
RESISTANCE = 8e3  # K/W of the strips of the papers
LABELS = ("name", "window", "python", "toml")  # of a ring on the page; everything else is its numbers


def published() -> list[tuple[RingResonator, Window]]:
    """Return the rings of the papers, each with the window of its plane."""
    borghi = borghi2021()
    return [(borghi, OF_MAPS), (borghi.with_lumped_fcd(), OF_MAPS), (vanvaerenbergh2012(), OF_SMALL)]


def rings_of(ring: RingResonator, resistance: float) -> list[dict[str, Any]]:
    """Return the rings of the page, fields in SI: the given one first, then the published ones that it is not.

    A ring that bears the name of a published one but has other numbers is called "(changed)". resistance [K/W]: of the
    model that is shown first; far from that of the papers, a published ring gets a window of its own.
    """
    check_ring(ring)
    given = _as_taken(ring)
    known = [_as_taken(other) | {"window": window} for other, window in published()]
    usual = 0.3 < resistance / RESISTANCE < 3
    windows = [other["window"] for other in known if usual and same_numbers(given, other)]
    others = [other for other in known if not same_numbers(given, other)]
    taken = {other["name"] for other in others}
    label = f"{ring.name} (changed)" if ring.name in taken else ring.name
    return [given | {"name": label, "window": windows[0] if windows else window_of(ring, resistance)}, *others]


def _as_taken(ring: RingResonator) -> dict[str, Any]:
    """The fields of a ring, and the ring as Python and as a ring file have it, for what is copied from the page."""
    return asdict(ring) | {"python": repr(ring), "toml": write_text(ring, {})}


def place_of(ring: RingResonator, rings: list[dict[str, Any]]) -> int:
    """Return the place of a ring among those of the page."""
    return next(k for k, other in enumerate(rings) if same_numbers(asdict(ring), other))


def same_numbers(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether the fields of two rings have the same values; names and windows do not count."""
    first, second = ({key: value for key, value in ring.items() if key not in LABELS} for ring in (one, other))
    return _same(first, second)


def _same(a: Any, b: Any) -> bool:
    """Whether two values are equal, numbers within round-off."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a, b, rel_tol=ROUND_OFF)
    return bool(a == b)


def window_of(ring: RingResonator, resistance: float) -> Window:
    """Return where the plane of an unknown ring is likely to be of interest, in dBm and GHz.

    From the power P1 at which its heat moves the resonance by half a width, to twenty times that;
    from two and a half widths below the cold resonance to one above.
    """
    width = ring.linear_rate / math.pi
    share = 4 * ring.bus_rate * max(ring.loss_rate, 1e-3 * ring.linear_rate) / ring.linear_rate**2
    moved = max(abs(ring.thermal_shift), 1.0) * resistance * share  # rad/s per W
    first = 10 * math.log10(ring.linear_rate / moved / 1e-3)
    first = min(max(round(first), -38), 8)
    span = max(float(f"{width / 1e9:.2g}"), 0.1)
    return {"power": (first, first + 13.0), "detuning": (-2.5 * span, span)}
