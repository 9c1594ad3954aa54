"""The temperature that detunes a ring: the mean over its core, or that of its mode, the output "light".

    dw/w = -(G/n_g)(dn/dT) dT,    dT: "core" for the dn/dT of a material, "light" for that of a whole section

The two differ where light or heat reach beyond the core, and "light" differs from mode to mode. `check_read` compares
what a ring reads with what a model gives.
"""

import functools
import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.constants import c

from .arrays import Array
from .checks import InputError
from .data import quantity
from .fem import HeatProblem, assemble, light
from .geometry import CrossSection
from .geometry.section_parts import LIGHT, MODE, WAVELENGTH
from .solving import solve
from .waveforms import Constant

log = logging.getLogger("thermofem")

CORE = "core"
READS = (CORE, LIGHT)
TIMES: Array = np.geomspace(1e-9, 1e-3, 61)  # s; steps are compared from 1 ns on
SAME_WAVELENGTH = 1e-4  # relative difference; 1e-2 moved the step of a strip under a polymer by up to 17 %


class GuidedMode(NamedTuple):
    """The mode whose temperature is called "light": its name, such as "TM0", and its wavelength in m."""

    name: str
    wavelength: float

    @classmethod
    def of_origin(cls, origin: Mapping[str, Any] | None) -> "GuidedMode | None":
        """The mode that the origin of a model states; None where it states none."""
        origin = origin or {}
        return cls(str(origin[MODE]), float(origin[WAVELENGTH])) if {MODE, WAVELENGTH} <= origin.keys() else None

    def __str__(self) -> str:
        return f"{self.name} at {quantity.rounded(self.wavelength, 'm', 6)}"

    def is_close(self, other: "GuidedMode") -> bool:
        """Whether both are one mode at one wavelength."""
        change = abs(self.wavelength / other.wavelength - 1)
        return self.name == other.name and change < SAME_WAVELENGTH


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
    ring: Any,
    geometry: str,
    heated: str,
    read: str,
    *,
    mode: GuidedMode | None,
    chosen: bool = False,
) -> dict[str, Any]:
    """Compare the output ``read`` of a model with the temperature that a ring reads; log a warning where they differ.

    Parameters
    ----------
    ring : RingResonator of coupled
        its name, cold resonance (``frequency``), ``read`` and ``mode``.
    geometry : str
        text of the geometry of the model; "" where it is not known.
    heated, read : str
        the channel of the model that drives the ring.
    mode : GuidedMode
        whose temperature the output "light" of the model is; None where it is not known.
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
        the two steps differ by more than 20 %, or both are "light", of two modes.
    """
    ring_mode = ring.mode or GuidedMode("", c / ring.frequency)
    model_mode = mode or ring_mode
    if ring.read == LIGHT == read:
        if ring.mode is None or ring_mode.is_close(model_mode):
            return {"read": read}
        text = (
            f"ring {ring.name!r} reads {LIGHT!r} of {ring_mode}, and {LIGHT!r} of the thermal model is of {model_mode}"
        )
        hint = ANOTHER_MODE
        if ring_mode.name != model_mode.name and not chosen:
            raise InputError(text, hint)
    elif LIGHT in (ring.read, read):
        text = f"ring {ring.name!r} reads the temperature {ring.read!r}, and the thermal model gives {read!r}"
        hint = HINTS[ring.read]
    else:
        return {"read": read}
    of_model = model_mode if read == LIGHT else read
    of_ring = ring_mode if ring.read == LIGHT else heated
    ratio = _ratio(geometry, heated, of_model, of_ring) if geometry else None
    if ratio is None:
        warning = f"{text}; how far they differ is not known, as the model does not hold its geometry"
        _log_once(warning)
        return {"read": read, "warning": warning}
    least, most = ratio
    text += f": {least:.3g} to {most:.3g} times the wanted step, from 1 ns on"
    # a model whose step differs by more than 20 % is refused
    if np.abs(ratio - 1).max() > 0.2 and not chosen:
        raise InputError(text, hint)
    log.warning("%s; %s", text, hint)
    return {"read": read, "read_ratio": ratio.copy(), "warning": text}


HINTS = {
    LIGHT: "reduce heat.system of a geometry with [light], or heat.with_light(mode), whose models have this output",
    CORE: "a ring of this geometry is made by `thermofem ring`, coupled.ring_from in Python; or read the heated part",
}
ANOTHER_MODE = (
    "make the ring of the mode of [light], or give [light] the ring's polarisation and wavelength and reduce again; "
    "in Python heat.with_light(ring_from(...).mode)"
)


@functools.lru_cache(1000)
def _log_once(warning: str) -> None:
    """Log a warning unless it was logged before: a search runs a ring on thousands of models without a geometry."""
    log.warning("%s", warning)


@functools.lru_cache(64)
def _ratio(geometry: str, heated: str, of_model: str | GuidedMode, of_ring: str | GuidedMode) -> Array | None:
    """Least and greatest ratio of the step that a model reads to that of a ring; None where no mode can be computed."""
    try:
        # two temperatures differ by the field in the section: those of a racetrack as those of its bends
        bends = replace(CrossSection.from_toml_text(geometry), straight=0.0)
        heat = assemble(bends, accuracy=1e-2)
        ratio = _step(heat, heated, of_model) / _step(heat, heated, of_ring)
    except InputError:
        return None
    return np.array([ratio.min(), ratio.max()])


def _step(heat: HeatProblem, heated: str, output: str | GuidedMode) -> Array:
    """Rise (K) at `TIMES` after a step of power: of a region, of the heated part for any other name, or of a mode.

    Raises InputError: no guided mode, a material without an index.
    """
    section = heat.geometry
    source = heated
    if heated not in section.heated:
        core = CORE if CORE in section.heated else section.heated[0]
        source = core if section.light is None else section.light.part
    if isinstance(output, GuidedMode):
        mode = light(heat, wavelength=output.wavelength).mode(output.name or None)
        heat = heat.with_light(mode)
        read = LIGHT
    else:
        read = output if output in heat.readable else source
    milliwatt = Constant(1e-3)
    return solve(heat, milliwatt, TIMES, heated=source, read=read).delta_T.values
