"""Parts of a circuit that share neither light nor heat: each is integrated alone, with steps of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem.arrays import NDArray

from ..inputs import Input
from .circuit import Circuit
from .record import _origin

if TYPE_CHECKING:
    import xarray as xr

LABELS = {"ring": "names", "port": "ports"}


def parts_of(circuit: Circuit) -> list[Circuit]:
    """The circuits that no waveguide connects; only the whole where lasers of several frequencies make it beat.

    Rings that no laser reaches go with the first part.
    """
    owner = {name: k for k, name in enumerate([*circuit.names, *(splitter.name for splitter in circuit.splitters)])}
    group = list(range(len(owner)))

    def of(terminal: str) -> int:
        return group[owner[terminal.rpartition(".")[0]]]

    for way in circuit.waveguides:
        one, other = of(way.start), of(way.stop)
        group = [one if k == other else k for k in group]
    lit = list(dict.fromkeys(of(laser.stop) for laser in circuit.lasers))
    lit = [k for k in lit if any(group[owner[name]] == k for name in circuit.names)]
    if len(lit) < 2 or len({laser.offset for laser in circuit.lasers}) > 1:
        return [circuit]
    group = [k if k in lit else lit[0] for k in group]
    return [
        replace(
            circuit,
            rings={name: ring for name, ring in circuit.rings.items() if group[owner[name]] == k},
            waveguides=[way for way in circuit.waveguides if of(way.start) == k],
            lasers=[laser for laser in circuit.lasers if of(laser.stop) == k],
            detectors=[detector for detector in circuit.detectors if of(detector.start) == k],
            splitters=[splitter for splitter in circuit.splitters if group[owner[splitter.name]] == k],
        )
        for k in lit
    ]


def run_parts(
    parts: Sequence[Circuit],
    inputs: Mapping[str, Input],
    each: Callable[..., xr.Dataset],
    progress: Callable[[float], None] | None,
    duration: float,
) -> list[xr.Dataset]:
    """Run every part under its own lasers; ``progress`` hears of their shares of the whole."""
    found = []
    for k, part in enumerate(parts):
        told = (lambda t, k=k: progress((k * duration + t) / len(parts))) if progress else None
        own = {laser.name: inputs[laser.name] for laser in part.lasers if laser.name in inputs}
        found.append(each(part, inputs=own, progress=told))
    return found


def joined(circuit: Circuit, runs: Sequence[xr.Dataset]) -> xr.Dataset:
    """The runs of the parts at the same times as one of the circuit."""
    import xarray as xr

    orders = {
        dim: _order([name for run in runs for name in run[dim].values], getattr(circuit, LABELS[dim])) for dim in LABELS
    }
    orders["laser"] = _order([name for run in runs for name in run["laser"].values], [x.name for x in circuit.lasers])
    variables: dict[str, Any] = {}
    for name in dict.fromkeys(name for run in runs for name in run.data_vars):
        pieces = [run[name] if name in run else run["output"] for run in runs]  # detected, where nothing is slow
        dims, attributes = pieces[0].dims, next(run[name].attrs for run in runs if name in run)
        if name == "detuning":
            variables["detuning"] = pieces[0]
        elif dims == ("time",):
            variables[str(name)] = (dims, sum(piece.values for piece in pieces), attributes)
        else:
            values = np.concatenate([piece.values for piece in pieces])[orders[str(dims[0])]]
            variables[str(name)] = (dims, values, attributes)
    coordinates = {
        "time": runs[0]["time"], "ring": list(circuit.names), "port": list(circuit.ports),
        "laser": [laser.name for laser in circuit.lasers],
    }  # fmt: skip
    sizes = [run.sizes["ring"] for run in runs]
    states = [run.attrs["final_state"] for run in runs]
    light = np.concatenate([y[: 3 * n].reshape(n, 3) for y, n in zip(states, sizes, strict=True)])
    heat = np.concatenate([y[3 * n :].reshape(n, -1) for y, n in zip(states, sizes, strict=True)])
    attributes = _origin(circuit) | {
        key: runs[0].attrs[key] for key in ("duration", "rtol", "method", "detuning") if key in runs[0].attrs
    }
    attributes |= {key: sum(run.attrs[key] for run in runs) for key in ("steps", "rejected_steps")}
    attributes["final_state"] = np.concatenate([light[orders["ring"]].ravel(), heat[orders["ring"]].ravel()])
    tau = np.concatenate([run.attrs["model_tau"].reshape(n, -1) for run, n in zip(runs, sizes, strict=True)])
    attributes["model_tau"] = tau[orders["ring"]].ravel()
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)


def _order(labels: Sequence[Any], wanted: Sequence[str]) -> NDArray[np.int64]:
    return np.array([labels.index(name) for name in wanted], dtype=np.int64)
