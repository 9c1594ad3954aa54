"""The temperature that detunes a ring: the mean over its core, or that of its mode, the output "light".

    dw/w = -(G/n_g)(dn/dT) dT,    dT: "core" for the dn/dT of a material, "light" for that of a whole section

The two differ where light or heat reach beyond the core. `check_read` compares them for a model that has only one.
"""

import functools
import logging
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.constants import c

from .arrays import Array
from .checks import InputError
from .fem import HeatProblem, assemble, light
from .geometry import CrossSection
from .geometry.section_parts import LIGHT
from .solving import solve
from .waveforms import Constant

log = logging.getLogger("thermofem")

CORE = "core"
READS = (CORE, LIGHT)
TIMES: Array = np.geomspace(1e-9, 1e-3, 61)  # s; steps are compared from 1 ns on
REFUSED = 0.2  # largest difference of the two steps, relative
COARSE = 1e-2  # accuracy of the mesh for the ratio of two steps
MILLIWATT = 1e-3  # W


class ReadsTemperature(Protocol):
    """What a ring states about itself: `coupled.RingResonator` has it."""

    @property
    def name(self) -> str:
        """Label for messages."""
        ...

    @property
    def frequency(self) -> float:
        """Cold resonance in Hz."""
        ...

    @property
    def read(self) -> str:
        """The temperature that goes with its dn/dT, "core" or "light"."""
        ...


class Ratio(NamedTuple):
    """Smallest and largest ratio of two step responses from 1 ns on."""

    least: float
    most: float

    @property
    def deviation(self) -> float:
        """Largest distance from 1."""
        return max(abs(self.least - 1), abs(self.most - 1))


def detuning_output(wanted: str, heated: str, outputs: tuple[str, ...]) -> str:
    """The output of a model that detunes a ring, by default.

    wanted: "core" or "light", as the ring reads.
    heated: the input that its light heats; its own mean stands for "core" under any name.
    """
    if wanted == LIGHT and LIGHT in outputs:
        return LIGHT
    means = [name for name in outputs if name != LIGHT] or list(outputs)
    alone = len(means) == 1 and heated not in means
    return means[0] if alone else heated


def check_read(
    ring: ReadsTemperature, geometry: str, heated: str, read: str, *, chosen: bool = False
) -> dict[str, Any]:
    """Compare the output ``read`` of a model with the temperature that a ring reads; log a warning where they differ.

    Parameters
    ----------
    ring : ReadsTemperature
    geometry : str
        text of the geometry of the model; "" where it is not known.
    heated, read : str
        the channel of the model that drives the ring.
    chosen : bool
        whether the caller named ``read``: then nothing is refused.

    Returns
    -------
    dict
        attributes of a result: read, and where the ring reads another temperature read_ratio (least and greatest ratio
        of the steps of both from 1 ns on, where the geometry is known) and warning.

    Raises
    ------
    InputError
        the two steps differ by more than 20 %.
    """
    if (ring.read == LIGHT) == (read == LIGHT):
        return {"read": read}
    text = f"ring {ring.name!r} reads the temperature {ring.read!r}, and the thermal model gives {read!r}"
    ratio = _ratio(geometry, heated, read, c / ring.frequency) if geometry else None
    if ratio is None:
        warning = f"{text}; how far they differ is not known, as the model does not hold its geometry"
        _log_once(warning)
        return {"read": read, "warning": warning}
    text += f": {ratio.least:.3g} to {ratio.most:.3g} times the wanted step, from 1 ns on"
    if ratio.deviation > REFUSED and not chosen:
        raise InputError(text, HINTS[ring.read])
    log.warning("%s; %s", text, HINTS[ring.read])
    return {"read": read, "read_ratio": np.array(ratio), "warning": text}


HINTS = {
    LIGHT: "reduce heat.system of a geometry with [light], or heat.with_light(mode), whose models have this output",
    CORE: "a ring of this geometry is made by `thermofem ring`, coupled.ring_from in Python; or read the heated part",
}


@functools.lru_cache(1000)
def _log_once(warning: str) -> None:
    """Log a warning unless it was logged before: a search runs a ring on thousands of models without a geometry."""
    log.warning("%s", warning)


@functools.lru_cache(64)
def _ratio(geometry: str, heated: str, read: str, wavelength: float) -> Ratio | None:
    """Ratio of the step of ``read`` to that of the other temperature; None where no mode can be computed."""
    try:
        heat = lit(assemble(CrossSection.from_toml_text(geometry), COARSE), wavelength)
    except InputError:
        return None
    section = heat.geometry
    guide = section.light
    own = guide.part if guide is not None else CORE if CORE in section.heated else section.heated[0]
    source = heated if heated in section.heated else own
    mean = read if read in heat.readable and read != LIGHT else source
    rises = solve(heat, Constant(MILLIWATT), TIMES, heated=source, read=(mean, LIGHT), rtol=1e-4).delta_T
    ratio = rises.sel(probe=mean).values / rises.sel(probe=LIGHT).values
    ratio = 1 / ratio if read == LIGHT else ratio
    return Ratio(float(ratio.min()), float(ratio.max()))


def lit(heat: HeatProblem, wavelength: float) -> HeatProblem:
    """The problem with the output "light": its own, or that of the mode at a wavelength (m) without [light].

    Raises InputError: no guided mode, a material without an index.
    """
    return heat if heat.light is not None else heat.with_light(light(heat, wavelength=wavelength).mode())
