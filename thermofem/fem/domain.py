"""Error of a thermal resistance caused by the finite domain, relative to a stack that continues beyond it.

See `parts.Boundary`, "open".
"""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING

from .beyond import FAR, LEFT, wider

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from .problem import HeatProblem

log = logging.getLogger("thermofem")

CLOSED = 'if the chip goes on there, say bottom = "open", outer = "open" in [boundary], or geometry.opened()'
OPEN = "heat that runs along a layer or one axis of a material is still felt at its open sides: move them outwards"
NOTABLE = 1e-2  # of R_th: a domain that moves it by more is worth a warning, by less a line of information
AGAIN = 2.0  # times the largest error that the log told of a domain: one as much larger is told, too
_told: dict[tuple[str, str, float, float], float] = {}


def domain_error(heat: HeatProblem, heated: str, read: str) -> float:
    """Relative change of R_th if the stack continued beyond its bottom and outer side, see `beyond`.

    Sides with convection are mounts, not cuts, and stay as they are. Of open sides it is what 1/d does not describe,
    such as heat that runs along a layer. Where much is left beyond the far ends they are moved outwards once more, and
    what is left then counts as error, too: where heat leaves along a plate alone, no domain is wide enough. For a
    straight section it includes the heat that leaves through the ends of the guide.
    """
    if heat.wider is None:
        return 0.0
    here = heat.thermal_resistance(heated, read)
    there, left = heat.wider.resistance(heat, heated, read)
    if left <= LEFT * here or (farther := wider(heat, FAR**2)) is None:
        return abs(there - here) / here
    there, left = farther.resistance(heat, heated, read)
    return (abs(there - here) + left) / here


def warn_of_domain(geometry: CrossSection, domain: float, accuracy: float, what: str = "R_th") -> None:
    """Log that the end of the domain changes R_th, or ``what``, by more than the accuracy, and the remedy.

    A warning above `NOTABLE`, information below: a ring on a finite chip or on a mount is no mistake. Of geometries of
    one name and size the first is told, and what errs `AGAIN` times as much or is the first above `NOTABLE`.
    """
    size = geometry.name, what, geometry.outer_radius, geometry.bottom_z
    told = _told.get(size, 0.0)
    if domain <= min(AGAIN * told, NOTABLE if told <= NOTABLE else math.inf):
        return
    _told[size] = domain
    log.log(
        logging.WARNING if domain > NOTABLE else logging.INFO,
        "%s: the domain ends %.3g um below and %.3g um beside the axis, which moves %s by %.1e (accuracy = %g); %s",
        geometry.name,
        -geometry.bottom_z * 1e6,
        geometry.outer_radius * 1e6,
        what,
        domain,
        accuracy,
        CLOSED if geometry.opened() != geometry else OPEN,
    )
