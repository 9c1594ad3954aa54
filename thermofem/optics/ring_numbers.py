"""What the light of a cross-section says about its ring: the numbers from which the rates and shifts are made.

n_eff, n_g, thermo_optic, index_confinement, core fractions and volumes of the mode (`shape.ABOUT`), radius [m],
wavelength [m], index of the core, loss [1/m], radiated [1/s] and, of every bus, "kappa 0", "kappa 1": kappa^2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from scipy.constants import c

from ..checks import InputError
from .coupler import of_buses
from .modes import Light
from .shape import ABOUT, numbers

if TYPE_CHECKING:
    from ..fem import HeatProblem
    from .mode import Mode

TIGHT = 20.0  # exponent of a bend's tunnelling; beyond it Q_rad is above 1e9 and not computed
LEAST = 1e5  # 1/s; a ring that radiates less is none that radiates


def ring_numbers(mode: Mode, loss: float | None, powers: Sequence[float], **rules: bool) -> dict[str, float]:
    """The numbers of a ring by name, but what it radiates; powers: kappa^2 of every bus."""
    own = dict(zip(ABOUT, numbers(mode, **rules).tolist(), strict=False))
    own |= {"radius": mode.radius, "wavelength": mode.wavelength, "index": mode.light.core_index}  # type: ignore[union-attr]
    own |= {} if loss is None else {"loss": loss}
    return own | {f"kappa {k}": power for k, power in enumerate(powers)}


def section_numbers(heat: HeatProblem) -> dict[str, float]:
    """Those of a cross-section with [light], and kappa^2 of its [[bus]] tables; "loss" where [light] has it.

    Raises InputError: as `Light.mode`, `coupler.of_buses` and `radiation_rate`.
    """
    section = heat.geometry
    mode, given = Light.of(heat).mode(), section.light
    powers = [one.power for one in of_buses(mode, section.buses)]
    found = ring_numbers(mode, given.loss if given else None, powers)
    return found | {"radiated": radiation_rate(mode)}


def radiation_rate(mode: Mode) -> float:
    """Amplitude rate w/(2 Q_rad) in 1/s; 0 where a bend is so wide that Q_rad is above 1e9.

    Raises InputError: Q_rad below 1e3.
    """
    clad = mode.light.cladding_index  # type: ignore[union-attr]
    decay = mode.k0 * math.sqrt(mode.n_eff**2 - clad**2)
    if 2 / 3 * mode.radius * 1e6 * decay**3 / mode.square > TIGHT:
        return 0.0
    quality = mode.q_radiation
    if quality < 1e3:
        raise InputError(
            f"the bend of {mode.radius * 1e6:g} um radiates: Q = {quality:.3g}", "take a larger radius or a wider core"
        )
    rate = math.pi * c / mode.wavelength / quality
    return rate if rate > LEAST else 0.0
