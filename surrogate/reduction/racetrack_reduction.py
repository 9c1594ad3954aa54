"""The thermal model of one racetrack from the geometry file of its ring, with the temperature that its light sees.

Core and heaters are a layout of racetracks (`surrogate.reduction.layout_reduction`). The temperature that the mode sees
differs from the mean of the core only by the field in the section, so that by the power P_j of part j of length L_j

    H_light,j(s) = H_core,j(s) + [Z_light,j(s) - Z_core,j(s)]/L_j

with Z the rise by the power per length of the straight section, reduced with a certificate.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import CrossSection, InputError, StateSpace, assemble, light
from thermofem.arrays import Array
from thermofem.data import dataset
from thermofem.geometry.resistor import heater_sheet
from thermofem.geometry.section_parts import LIGHT, Guide
from thermofem.geometry.shapes import Shape, along_ring
from thermofem.optics.mode import Mode
from thermofem.waveforms import Waveform

from .array_reduction import ArrayReduction, diagonal_system
from .layout_reduction import reduce_layout
from .layout_sections import SECTION
from .reduce import reduce

log = logging.getLogger("thermofem")


def reduce_racetrack(
    ring: CrossSection, tolerance: float = 1e-3, heated: Sequence[str] = (), read: Sequence[str] = ()
) -> StateSpace:
    """Reduce a ring with ``straight`` to a thermal model, whose origin has its error_bound as of `reduce_layout`.

    Parameters
    ----------
    ring : CrossSection
        with ``straight``; its outer side does not count, the chip goes on in its plane.
    tolerance : float
        as of `reduce_layout`.
    heated, read : sequence of str
        inputs and outputs; default all heated parts, and as an output "light" where the ring has [light].

    Raises
    ------
    InputError
        bends below 3 um, a light whose part is not heated, other names; as `reduce_layout`.
    """
    shapes = along_ring(ring)
    layout = reduce_layout(shapes, tolerance)
    if ring.light is not None:
        layout = _with_light(layout, shapes, ring.light.part, tolerance)
    whole = layout.model
    model = whole.channels(heated or whole.inputs, read or whole.outputs)
    rows = [whole.outputs.index(name) for name in model.outputs]
    columns = [whole.inputs.index(name) for name in model.inputs]
    origin = {
        **(whole.origin or {}),
        "method": "racetrack reduction",
        "error_bound": float(layout.channel_bounds[np.ix_(rows, columns)].max()),
        "geometry": ring.to_toml(),
        "ports": list(model.inputs),
    }
    for of_layout in ("positions", "outlines", "half_times", "resistors"):  # the ring itself says what its heaters are
        del origin[of_layout]
    return replace(model, origin=origin)


def _with_light(layout: ArrayReduction, shapes: tuple[Shape, ...], guide: str, tolerance: float) -> ArrayReduction:
    """The same with the output "light" after those of the parts."""
    names = [shape.name for shape in shapes]
    if guide not in names:
        raise InputError(
            f"the light of a racetrack is read beside the mean of its core, and {guide!r} is not heated",
            "give that part heated = true",
        )
    core = names.index(guide)
    section = shapes[0].section
    heat = assemble(section, SECTION * tolerance)
    local = reduce(heat.channels(names, (guide, LIGHT)), SECTION * tolerance)
    straight: Any = local.model  # two outputs: a StateSpace
    whole = layout.model
    lengths = np.array([shape.length for shape in shapes])
    rate = -np.concatenate([whole.A.diagonal(), straight.A.diagonal()])
    heated = np.vstack([whole.B, straight.B * float(section.length or 1.0) / lengths])
    nothing = np.zeros((len(names), local.order))
    read = np.block([[whole.C, nothing], [whole.C[core], straight.C[1] - straight.C[0]]])
    model = diagonal_system(rate, heated, read, whole.inputs, (*whole.outputs, LIGHT))
    mesh = max(heat.mesh_error(name, LIGHT) for name in names)
    of_light = layout.channel_bounds[core] + local.error_bound + mesh
    bounds = np.vstack([layout.channel_bounds, of_light])
    return replace(layout, model=replace(model, origin=whole.origin), channel_bounds=bounds)


def solve_racetrack(
    ring: CrossSection,
    wave: Waveform,
    times: Array,
    heated: Sequence[str] = (),
    read: Sequence[str] = (),
    *,
    periodic: bool = False,
) -> xr.Dataset:
    """Rises under a wave as of `thermofem.solve`, or as of `solve_periodic` at `waveforms.period_times`.

    heated: at most one part, default the first; read: default the same.
    Raises InputError: several heated parts; as `reduce_racetrack`.
    """
    if len(heated) > 1:
        raise InputError(f"heated = {', '.join(heated)}: one part of a racetrack carries the power", "give one")
    heated = heated or ring.heated[:1]
    model = reduce_racetrack(ring, heated=heated, read=read or heated)
    channels = [model.channel(read=name).dynamics for name in model.outputs]
    rises = []
    for channel in channels:
        rises.append(channel.periodic_response(wave, times.size) if periodic else channel.response(wave, times))
    resistances = [channel.thermal_resistance for channel in channels]
    about = model.origin or {}
    attributes: dict[str, Any] = {key: about[key] for key in ("method", "error_bound", "geometry")}
    attributes |= {"heated": model.inputs[0], "thermal_resistance": resistances[0]}
    if len(channels) > 1:
        attributes["thermal_resistances"] = resistances
    delta_T = rises[0] if len(rises) == 1 else np.transpose(rises)
    return dataset.build(times, delta_T, wave, periodic=periodic, read=model.outputs, attributes=attributes)


def racetrack_sheets(ring: CrossSection, mode: Mode | None = None) -> dict[str, dict[str, float]]:
    """Data sheets of the heaters along a racetrack, as of `HeatProblem.heater_sheet`; {} without light or heaters.

    mode: the light, by default that of [light]. The log warns where its temperature is not read: of a core that is not
        heated, and of a mode that is not fundamental.
    """
    core = mode.core if mode else getattr(ring.light, "part", None)
    heaters = [name for name in ring.heated if name != core]
    if core is None or not heaters:
        return {}
    if core not in ring.heated:
        hint = "give that part heated = true"
        log.warning("no data sheet of heaters: the light is read beside the heat of %r; %s", core, hint)
        return {}
    mode = mode or light(ring).mode()
    if not mode.name.endswith("0"):
        hint = "a racetrack reads the temperature of TE0 or TM0 alone"
        log.warning("no data sheet of heaters: the light is %s; %s", mode.name, hint)
        return {}
    lit = replace(ring, light=Guide(mode.wavelength, core, polarisation=mode.name[:2]))
    gain = reduce_racetrack(lit, heated=heaters, read=[*heaters, LIGHT]).gain
    sheets = {}
    for column, name in enumerate(heaters):
        to_light = float(gain[-1, column])
        sheets[name] = heater_sheet(ring, mode, name, to_light, float(gain[column, column]))
    return sheets
