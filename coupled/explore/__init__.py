"""The HTML page that computes the dynamics of a ring: one file with its script, style, ring and thermal models."""

import html
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from thermofem import __version__, checks
from thermofem.data.files import check_target, write_whole
from thermofem.fem import HeatProblem
from thermofem.models import ThermalModel
from thermofem.ring_temperature import check_read, detuning_output

from ..inputs import check_detuning, check_power, check_ring
from ..resistive_heaters import at_rest
from ..resonator import RingResonator
from ..thermal import Heaters, check_geometry, geometry_of, mode_of
from . import bundle, contents
from .contents import family_of
from .section import section_of

MOVED = ("loadedQ", "intrinsicQ", "absorbed", "lifetime", "volume", "thermoOptic", "resistance")  # None until they are
STEP_TIMES = np.geomspace(1e-9, 1e-4, 26)  # s, at which the FEM's own step response is drawn


@dataclass(frozen=True)
class Page:
    """HTML page that computes the dynamics of a ring; a notebook displays it.

    Attributes
    ----------
    html : str
        the whole file.
    path : Path, optional
        where it was written.
    """

    html: str
    path: Path | None = None

    def __repr__(self) -> str:
        where = f"written to {self.path}" if self.path else "not written"
        return f"Page({len(self.html) / 1e3:.0f} kB, {where})"

    def _repr_html_(self) -> str:
        """HTML for notebooks: the page in a frame."""
        text = html.escape(self.html, quote=True)
        return f'<iframe srcdoc="{text}" style="width:100%;height:900px;border:0" title="ring"></iframe>'


def explore(
    ring: RingResonator,
    models: ThermalModel | Mapping[str, ThermalModel] | None = None,
    path: str | Path | None = None,
    *,
    power: float | None = None,
    detuning: float = 0.0,
    heat: HeatProblem | None = None,
    family: Any = None,
    heaters: Heaters = None,
    heated: str | None = None,
    read: str | None = None,
) -> Page:
    """Write one HTML file that computes the dynamics of a ring in the browser, without a network or a server.

    The page runs the kernel of `simulate`, compiled to WebAssembly; it finds fixed points, their stability, Hopf and
    fold curves as `steady_states`, `stability_map`, `hopf_curves` and `fold_curves` do, and settled cycles by Newton's
    method on the return map. Curves of `cycle_fold_curves` are computed when the page is written, and are shown for the
    ring and model that it opens with. The first reduction among the models is the reference for the period errors of
    the others.

    Parameters
    ----------
    ring : RingResonator
    models : ThermalModel, or mapping from names to 1 to 6 of them
        Foster networks, small linear models, an OutputMap over one, or reductions; the first one is shown first.
    path : str or Path, optional
        the file to write; without it the page is only returned.
    power, detuning : float, W and Hz
        of the laser when the page opens; by default 8 dBm, or the end of the plotted range that is nearest to it.
    heat : HeatProblem, optional
        adds the FEM's step response, and with a result of `surrogate.reduce` among the models the cross-section.
    family : surrogate.family.Family, optional
        adds sliders for its first three parameters, whose member is the thermal model shown first. Its step
        response is interpolated linearly between members on a grid of the parameters; the page states the error.
        Without a reduction among the models this member is the reference for their period errors.
    heaters : mapping of name to float, W; or to `Volts` or `Amperes`; optional
        powers of heaters when the page opens, those at rest in the dark under a voltage or a current. Every input of a
        model but the one that the light heats gets a slider.
    heated, read : str, optional
        the input of such a model that the light heats, by default its first, and the output that detunes it.

    Returns
    -------
    Page
        with the text of the file; a notebook shows it.

    Raises
    ------
    InputError
        a ring, a model, a power or a detuning that the page cannot take, or a file that cannot be written.

    Tested in Chromium and Node against `simulate`, `steady_states`, `hopf_curves` and settled cycles on a hundred
    random rings and models: within 1e-6.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[2e3, 2e3], tau=[100e-9, 15e-6])
    >>> coupled.explore(coupled.borghi2021(), {"two poles": model}).html.startswith("<!doctype html>")
    True
    """
    detuning = check_detuning(detuning)
    if path is not None:
        check_target(path)
    if models is None and family is None:
        raise checks.InputError("models is missing; give a thermal model, several by name, or a family")
    if heat is not None:
        checks.instance("heat", heat, HeatProblem, hint="th.assemble(geometry) makes the HeatProblem")
    named: Mapping[str, Any] = {}
    if isinstance(models, Mapping):
        named = models
    elif models is not None:
        order = getattr(models, "order", None)
        named = {f"{type(models).__name__}{f', {order} poles' if order else ''}": models}
    check_ring(ring)
    parts = contents.Parts(heated, read, ring.read)
    shown = [] if models is None else contents.models_of(named, parts)
    every = [*named.values()] if family is None else [family, *named.values()]
    check_geometry(ring, every[0] if heat is None else heat)
    compacts = [contents.channels_of(_middle(model) if model is family else model, parts).model for model in every]
    for model, small in zip(every, compacts, strict=True):
        check_read(
            ring, geometry_of(model), *small.inputs, *small.outputs, mode=mode_of(model), chosen=read is not None
        )
    reductions = [k for k, model in enumerate(named.values()) if hasattr(model, "basis")]
    judge: Any = reductions[0] if reductions else None
    resistance = abs(sum(shown[0]["R"])) if shown else contents.RESISTANCE
    rings = contents.rings_of(ring, resistance, compacts[0])
    window = rings[0]["window"]
    low, high = window["power"]
    level = min(max(8.0, low), high) if power is None else 10 * math.log10(check_power(power) / 1e-3)
    start = {
        "ring": 0, "model": 0, "power": round(level, 6), "detuning": round(detuning / 1e9, 9),
        **dict.fromkeys(MOVED), "duration": 20, "view": "cycle", "units": "GHz",
    }  # fmt: skip
    sliders = contents.heaters_of(shown, rings[0], ring.thermal_shift)
    start |= _heater_powers(sliders, heaters, next(iter(named.values()), None))
    grid = None
    borders: list[Any] = []
    if family is None:
        borders = contents.curves_of(ring, compacts[0], window)
    else:
        grid = family_of(family, compacts[0].outputs[0])
        moved = [p for p in grid["parameters"] if p["moved"]]
        start |= {f"p{k}": p["scale"] * (p["low"] + p["high"]) / 2 for k, p in enumerate(moved)}
        member = {"name": "member of the family", "R": grid["R"][0], "tau": grid["tau"]}
        shown.append(member | {"coefficient": 0.0, "family": True})
        last = len(shown) - 1
        start["model"] = last
        judge = last if judge is None else judge
    section = None
    if heat is not None and reductions:
        section = section_of(heat, [*named.values()][reductions[0]], parts)
    everything = shown + contents.paper_models()
    data = {
        "title": rings[0]["name"],
        "rings": rings,
        "models": everything,
        "judge": judge,
        "heaters": sliders,
        "start": start,
        "presets": contents.presets(rings, everything, start),
        "kernel": bundle.kernel(),
        "reference": None if heat is None else _step(heat, parts),
        "section": section,
        "borders": borders,
        "family": grid,
    }
    text = _filled(data)
    written = None
    if path is not None:
        written = write_whole(path, lambda target: target.write_text(text, encoding="utf-8"))
    return Page(text, written)


def _middle(family: Any) -> Any:
    """The thermal model of the member in the middle of a family's ranges."""
    middle = (family.box.low + family.box.high) / 2
    return family.model(**dict(zip(family.names, middle, strict=True)))


def _heater_powers(sliders: list[dict[str, Any]], heaters: Heaters, model: Any) -> dict[str, float]:
    """Return the initial powers of the heaters in mW, with the keys "h0", "h1", ... of their sliders; default 0."""
    names = [slider["name"] for slider in sliders]
    drives = checks.mapping("heaters", heaters)
    for name in drives:
        checks.choice("heaters", name, names)
    powers = at_rest(model, drives).powers
    return {f"h{k}": 1e3 * powers.get(name, 0.0) for k, name in enumerate(names)}


def _step(heat: HeatProblem, parts: contents.Parts) -> dict[str, Any]:
    """Return the FEM's step response: its name, times in s, and rise in K/W at each, of the output that is read."""
    from thermofem import Constant, solve

    heated = parts.heated or heat.heated[0]
    read = parts.read or detuning_output(parts.wanted, heated, heat.system.outputs)
    answer = solve(heat, Constant(1e-3), times=STEP_TIMES, heated=heated, read=read, rtol=1e-4)
    rise = answer["delta_T"].values.ravel() / 1e-3
    return {"name": f"FEM, {heat.unknowns} unknowns", "times": STEP_TIMES.tolist(), "rise": rise.tolist()}


def _filled(data: dict[str, Any]) -> str:
    """Return the text of the page: the template filled with ``data``, escaped so that no text can inject HTML."""
    safe = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    section = data["section"]
    parts = {
        "generator": f"thermofem {html.escape(__version__)}",
        "title": html.escape(str(data["title"])),
        "style": bundle.text_of("page/page.css"),
        "modes": str(len(section["modes"]) if section else 0),
        "footer": f"Written by thermofem {html.escape(__version__)}. The equations are those of coupled.simulate; "
        "ticks by d3-scale (ISC licence, Mike Bostock). This file needs no network.",
        "data": safe,
        "library": bundle.text_of(bundle.LIBRARY),
        "code": bundle.script(),
    }
    return Template(bundle.text_of("page/page.html")).substitute(parts)
