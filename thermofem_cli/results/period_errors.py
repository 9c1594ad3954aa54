"""Period errors of models as ``validate`` prints and draws them, of square waves and of a ring."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from rich.table import Table

import coupled
import surrogate
import thermofem as th
from coupled.maps.hopf_plane import hopf_plane, period_points
from surrogate.judging.validate import valid_range
from thermofem import InputError, checks
from thermofem.models import NonlinearSystem

from ..console import bar, note, say, show, working, written
from ..inputs.command_files import expect
from ..inputs.ring_drives import plane_words

POWER_IS_ALIKE = "no material depends on temperature: the same at every power"


class Judged(NamedTuple):
    """A reference, the models that it judges, by name, and their period errors."""

    reference: Any
    models: Mapping[str, Any]
    curves: dict[str, xr.Dataset]


def judged_models(
    models: list[Path], reference: Path | None, heated: str | None, read: str | None, wave: dict[str, Any]
) -> Judged:
    """Return the period errors of models from files against the reference; ``heated``, ``read`` select the channel."""
    if reference is None:
        raise InputError("models are judged by a --reference, e.g. from `reduce`; or give one geometry (.toml)")
    names = [path.stem for path in models]
    checks.unique("MODELS", names, hint="curves are named after the files")
    channels: list[Any] = []
    for path in (reference, *models):
        expect(path, "model")
        model: Any = surrogate.load_model(path)
        if len(model.inputs) > 1 or len(model.outputs) > 1:
            heat = checks.choice("--heated", heated, model.inputs)
            model = model.channel(heat, checks.choice("--read", read or heat, model.outputs))
        channels.append(model)
    curves = {}
    for name, model in zip(names, channels[1:], strict=True):
        curves[name] = surrogate.period_error(model, channels[0], **wave)
        say(f"{name}: {curves[name].attrs['validity']}")
    return Judged(channels[0], dict(zip(names, channels[1:], strict=True)), curves)


def judged_geometry(
    path: Path, accuracy: float, heated: str | None, read: str | None, wave: dict[str, Any]
) -> tuple[Judged, str, dict[str, Any]]:
    """Train the usual kinds of model on a geometry; return their period errors against its FEM, a title and advice."""
    from surrogate.judging.ladder import judge_geometry, verdict

    expect(path, "geometry")
    geometry = th.CrossSection.from_toml(path)
    with working("solving, training models, judging"):
        heat = th.assemble(geometry, accuracy)
        ladder, errors = judge_geometry(heat, heated=heated, read=read, **wave)
        lines = [verdict(errors, within=within).splitlines()[0] for within in (0.1, 0.01)]
        lines += _against_power(ladder.reference) if heat.nonlinear else [POWER_IS_ALIKE]
    whole = errors.squeeze("power").rename(period_error="relative_error")
    found = {name: whole.sel(model=name) for name in whole["model"].values.tolist()}
    by = "its FEM with k(T)" if heat.nonlinear else "its FEM"
    title = f"{geometry.name}: square waves of {wave['power'] * 1e3:g} mW, {wave['duty']:.0%} duty, against {by}"
    show(_table(found, ladder.refused, title))
    for line in lines:
        say(line)
    judged = Judged(ladder.reference, ladder.models, found)
    return judged, title, {"refused": dict(ladder.refused), "advice": lines}


def ring_points(ring: coupled.RingResonator, judged: Judged) -> dict[str, xr.Dataset]:
    """Return the periods of a ring with the reference and with each model, and print their errors."""
    if isinstance(judged.reference, NonlinearSystem):
        raise InputError(
            "--ring needs a reference that drives a ring at many points; the FEM with k(T) does not: give models with "
            "--reference"
        )
    plane = hopf_plane(ring, judged.reference)
    if plane is None:
        raise InputError(f"--ring: {ring.name!r} does not self-pulse with the reference, so there is no period")
    with bar("ring") as progress:
        points = {}
        for done, (name, model) in enumerate(judged.models.items()):
            progress(done, len(judged.models), name)
            points[name] = period_points(ring, judged.reference, model, plane)
    note(f"ring {ring.name!r}, loaded Q = {ring.loaded_q:.0f}: {plane_words(plane)}")
    for name, each in points.items():
        say(f"{name}, in the ring: {_point_words(each)}")
    return points


def point_numbers(points: xr.Dataset) -> dict[str, Any]:
    """Return the loaded Q, the number of points, and the mean and largest magnitude of their relative error."""
    error = np.abs(points["relative_error"].values)
    numbers = {"loaded_q": points.attrs["loaded_q"], "points": error.size, "missed": points.attrs["missed"]}
    if not error.size:
        return numbers | {"mean_error": None, "largest_error": None}
    return numbers | {"mean_error": float(error.mean()), "largest_error": float(error.max())}


def _point_words(points: xr.Dataset) -> str:
    """Return in words the period errors of a model in the ring."""
    numbers = point_numbers(points)
    least, largest = points.attrs["duties"]
    missed = f"; at {numbers['missed']} more the model does not pulse" if numbers["missed"] else ""
    if not numbers["points"]:
        return f"no point where both pulse with a duty of {least:g} to {largest:g}{missed}"
    low = float(points["period"].min())
    high = float(points["period"].max())
    periods = f"{numbers['points']} periods from {written(low, 's')} to {written(high, 's')}"
    errors = f"off by {100 * numbers['mean_error']:.2g} % on average, {100 * numbers['largest_error']:.2g} % at most"
    return f"{periods} (duty {least:g} to {largest:g}) {errors}{missed}"


def with_points(curves: xr.Dataset, points: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the curves with the points of the ring as variables ring_period, ring_error, ... over ``point``."""
    joined = xr.concat(list(points.values()), dim="point", combine_attrs="drop")
    joined = joined.rename({name: f"ring_{name}" for name in joined})
    names = np.repeat(list(points), [each.sizes["point"] for each in points.values()])
    return xr.merge([curves, joined.assign_coords(ring_model=("point", names))], combine_attrs="drop_conflicts")


def _against_power(system: Any) -> list[str]:
    """Return in words up to which power the steady rise of a linear model and an output map agree with that of k(T)."""
    from surrogate.judging.ladder import linear_reach

    found = linear_reach(system)
    lines = []
    power, rise, off = found["power"].values, found["rise"].values, np.abs(found["linear_error"].values)
    for share in (0.01, 0.1):
        crossing = min(share, float(off[-1]))  # off grows with power
        at = float(np.interp(crossing, off, power))
        warm = float(np.interp(crossing, off, rise))
        end = " and beyond" if at >= power[-1] else "; above, take an output map or a quadratic reduction"
        reach = f"up to {at * 1e3:.3g} mW, a rise of {warm:.3g} K"
        lines.append(f"k(T): the steady rise of linear models is within {100 * share:g} % {reach}{end}")
    error = float(abs(found["map_error"]).max())
    reach = f"within {100 * error:.2g} % up to {power[-1] * 1e3:.3g} mW, {rise[-1]:.3g} K"
    return [*lines, f"k(T): the steady rise of a linear model with output map is {reach}"]


def model_numbers(curve: xr.Dataset) -> dict[str, Any]:
    """Return the largest period error of a model, and the periods (s) over which it is below 1 and 10 %."""
    error = np.abs(curve["relative_error"].values)
    ranges = {f"within_{share:g}": sorted(valid_range(curve, within=share)) for share in (0.01, 0.1)}
    return {"largest_error": float(error.max()) if np.isfinite(error).all() else None, **ranges}


def draw_errors(curves: Mapping[str, xr.Dataset], points: Mapping[str, xr.Dataset], figure: Path, title: str) -> None:
    """Draw curves of period errors, and the points of a ring."""
    from surrogate.plot import plot_period_errors
    from thermofem.plot import save_figure

    save_figure(plot_period_errors(curves, points=points, title=title)[0], figure)


def _table(curves: Mapping[str, xr.Dataset], refused: Mapping[str, str], title: str) -> Table:
    """Return a table of the models with the periods over which their error is below 1 and 10 %."""
    table = Table("model", "states", "within 1 % (µs)", "within 10 % (µs)", "largest error", title=title)
    for name, curve in curves.items():
        found = model_numbers(curve)
        largest = found["largest_error"]
        words = "no such period" if largest is None else f"{float(f'{100 * largest:.2g}'):g} %"
        ranges = [", ".join(_range(*ends) for ends in found[f"within_{share:g}"]) or "nowhere" for share in (0.01, 0.1)]
        table.add_row(name, f"{curve['states'].item():.0f}", *ranges, words)
    for name, reason in refused.items():
        table.add_row(name, "", "not trained", "", reason.split(";")[0])
    return table


def _range(low: float, high: float) -> str:
    return f"{low * 1e6:.3g} to {high * 1e6:.3g}"
