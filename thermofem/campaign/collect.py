"""All geometries of a campaign as one Dataset: the index, and the training collection of the finished ones.

Dimensions and variables, DRIVE being the name of a drive
    case; delta_T_DRIVE (K) over case, time_DRIVE and probe; power_DRIVE (W) over time_DRIVE; thermal_resistance (K/W)
    over case and probe; unknowns, discretization_error and domain_error (relative) over case; the varied
    quantities and ``key`` (the name of the file) over case.
    The index holds every geometry, nan where there is no result, with ``status`` ("finished", "failed" or "waiting")
    and ``reason``. The training collection holds the finished ones and the matrix ``features`` over case and feature.

Both are filled one chunk of geometries at a time; what they hold, compressed, is all that is kept in memory.
"""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks, waveforms
from ..arrays import Array
from ..checks import InputError
from ..data import dataset, netcdf
from .store import ResultStore, write_file

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("thermofem")

Row = dict[str, Array]  # thermal_resistance, delta_T_DRIVE and `NUMBERS` of one geometry

INDEX, TRAINING = "index.nc", "training.nc"
ROWS = 64  # geometries of one chunk in the file
NUMBERS = {
    "unknowns": "unknowns of the mesh",
    "discretization_error": "relative error of R_th and of the step from 1 ns on by the mesh",
    "domain_error": "relative change of R_th if the stack went on beyond the domain",
}


def open_campaign(directory: str | Path) -> xr.Dataset:
    """Open the index of a campaign: every geometry, finished or not, as one Dataset.

    Arrays are read when they are used. After a run that was killed, or where somebody changed the index, it is made
    anew from the results that are there (in memory; the folder is not written).

    Parameters
    ----------
    directory : str or Path

    Returns
    -------
    Dataset
        see `thermofem.campaign.collect`.

    Raises
    ------
    InputError
        no campaign in the folder.
    """
    import xarray as xr

    store = ResultStore(checks.path("directory", directory))
    plan = store.read_plan()
    keys = [case[0] for case in plan["cases"]]
    path = store.directory / INDEX
    if path.is_file():
        try:
            netcdf.check(path)
            index = xr.open_dataset(path, engine="h5netcdf", **netcdf.OPEN)
            if index["key"].values.tolist() == keys and index["status"].values.tolist() == store.status(keys):
                if netcdf.unchanged(path) is not False:
                    return index
                log.warning("%s was changed after thermofem wrote it; what follows is made from the results", path)
            index.close()
        except netcdf.DAMAGE:
            pass  # damaged: made anew below
    return xr.open_dataset(io.BytesIO(_contents(store, plan, (INDEX,), verify=True)[INDEX]), engine="h5netcdf")


def write_collections(store: ResultStore, rows: Mapping[str, Row]) -> None:
    """Write index and training collection of a campaign, each whole or not at all.

    Parameters
    ----------
    store : ResultStore
    rows : mapping of key to Row
        results that are in memory already, by the key of their geometry.

    Raises
    ------
    InputError
        the folder cannot be written.
    """
    for name, content in _contents(store, store.read_plan(), (INDEX, TRAINING), rows).items():
        write_file(store.directory / name, content)


def domain_errors(directory: Path) -> Array:
    """The error by the finite domain of every geometry, from the index that a run has left; nan without a result."""
    import h5py

    with h5py.File(directory / INDEX, "r") as file:
        return np.asarray(file["domain_error"][()])


def _contents(
    store: ResultStore,
    plan: dict[str, Any],
    names: tuple[str, ...],
    rows: Mapping[str, Row] = MappingProxyType({}),
    *,
    verify: bool = False,
) -> dict[str, bytes]:
    """Contents of `INDEX` and `TRAINING`, built in memory: HDF5 may crash when a disk is full."""
    import h5netcdf

    keys = [case[0] for case in plan["cases"]]
    status = store.status(keys)
    if verify:  # nothing else has looked at the results of a killed run
        hashes = store.hashes()
        bad = [s == "finished" and not store.finished(key, hashes) for key, s in zip(keys, status, strict=True)]
        status = ["waiting" if damaged else s for s, damaged in zip(status, bad, strict=True)]
    there = np.array([each == "finished" for each in status], dtype=bool)
    probes = _probes(store.result(keys[int(np.argmax(there))])) if there.any() else []
    memory = {name: io.BytesIO() for name in names}
    with contextlib.ExitStack() as stack:
        variables, files = {}, {}
        for name in names:
            file = files[name] = stack.enter_context(h5netcdf.File(memory[name], "w"))
            chosen = [k for k in range(len(keys)) if there[k] or name == INDEX]
            variables[name] = _layout(file, plan, probes, chosen)
            if name == INDEX:
                reasons = [store.reason(key) if s == "failed" else "" for key, s in zip(keys, status, strict=True)]
                _text(file, "status", status, "whether there is a result")
                _text(file, "reason", reasons, "why not")
            else:
                _features(file, plan["variations"], [plan["cases"][k][1:] for k in chosen])
        for start in range(0, len(keys), ROWS):
            chunk = slice(start, start + ROWS)
            found = [
                (rows.get(key) or _read(store.result(key), plan["drives"])) if finished else None
                for key, finished in zip(keys[chunk], there[chunk], strict=True)
            ]
            _fill(variables, found, start, int(there[:start].sum()))
        for file in files.values():
            netcdf.sign(file)
    return {name: content.getvalue() for name, content in memory.items()}


def _layout(file: Any, plan: dict[str, Any], probes: list[str], chosen: list[int]) -> dict[str, Any]:
    """Dimensions, keys, varied quantities, times and powers of the drives; returns the empty variables over case."""
    file.attrs.update({**dataset.stamp("campaign"), "campaign": plan["name"], "geometry": plan["geometry"]})
    file.dimensions = {"case": len(chosen), "probe": len(probes)}
    _text(file, "probe", probes, "part whose mean is read", over="probe")
    _text(file, "key", [plan["cases"][k][0] for k in chosen], "content hash, the name of the file")
    _varied(file, plan["variations"], [plan["cases"][k][1:] for k in chosen])
    variables = {}
    for drive in plan["drives"]:
        name, times, wave = drive["name"], np.array(drive["times"]), waveforms.from_json(drive["waveform"])
        time, rise = f"time_{name}", f"delta_T_{name}"
        file.dimensions[time] = times.size
        file.create_variable(time, (time,), data=times).attrs.update(dataset.describe("time"))
        power = file.create_variable(f"power_{name}", (time,), data=np.asarray(wave(times), dtype=float))
        power.attrs.update({**dataset.describe("power"), "waveform": drive["waveform"]})
        variables[rise] = _over_case(file, rise, (time, "probe"), dataset.describe("delta_T"))
    resistance = {"units": "K/W", "long_name": "thermal resistance"}
    variables["thermal_resistance"] = _over_case(file, "thermal_resistance", ("probe",), resistance)
    for name, long_name in NUMBERS.items():
        variables[name] = _over_case(file, name, (), {"units": "1", "long_name": long_name})
    return variables


def _over_case(file: Any, name: str, dimensions: tuple[str, ...], attributes: dict[str, str]) -> Any:
    """A variable over case, nan so far."""
    shape = [file.dimensions["case"].size, *(file.dimensions[d].size for d in dimensions)]
    chunks = (min(ROWS, shape[0]), *shape[1:]) if min(shape) else None
    variable = file.create_variable(
        name,
        ("case", *dimensions),
        dtype=float,
        fillvalue=np.nan,
        chunks=chunks,
        compression="gzip" if chunks else None,
    )
    variable.attrs.update(attributes)
    return variable


def _text(file: Any, name: str, words: list[str], long_name: str, *, over: str = "case") -> None:
    import h5py

    variable = file.create_variable(name, (over,), dtype=h5py.string_dtype())
    if words:
        variable[:] = np.array(words, dtype=object)
    variable.attrs["long_name"] = long_name


def _varied(file: Any, variations: list[dict[str, Any]], values: list[list[Any]]) -> None:
    """The varied quantities over case: numbers in SI, or words."""
    for column, variation in enumerate(variations):
        long_name = ", ".join(variation["paths"])
        listed = [row[column] for row in values]
        if any(isinstance(value, str) for value in listed):
            _text(file, variation["name"], listed, long_name)
            continue
        variable = file.create_variable(variation["name"], ("case",), data=np.array(listed, dtype=float))
        variable.attrs.update({"units": variation["unit"] or "1", "long_name": long_name})
    # xarray takes these as coordinates, so that they travel with every selection
    file.attrs["coordinates"] = " ".join(["key", *(v["name"] for v in variations if " " not in v["name"])])


def _features(file: Any, variations: list[dict[str, Any]], values: list[list[Any]]) -> None:
    """The varied quantities as a matrix in SI; a word is the number of its place in alphabetical order."""
    columns = []
    for column in range(len(variations)):
        listed = [row[column] for row in values]
        words = sorted({value for value in listed if isinstance(value, str)})
        columns.append([words.index(value) if words else value for value in listed])
    file.dimensions["feature"] = len(variations)
    _text(file, "feature", [v["name"] for v in variations], "varied quantity", over="feature")
    _text(file, "feature_unit", [v["unit"] or "1" for v in variations], "its unit", over="feature")
    matrix = np.array(columns, dtype=float).reshape(len(variations), len(values)).T
    file.create_variable("features", ("case", "feature"), data=matrix).attrs["long_name"] = "varied quantities in SI"


def _probes(path: Path) -> list[str]:
    """Names of what was read, from one result."""
    import h5py

    with h5py.File(path, "r") as file:
        return str(file.attrs["read"]).split(", ")


def _fill(variables: dict[str, dict[str, Any]], rows: list[Row | None], start: int, trained: int) -> None:
    """Write the rows of one chunk: into the index from ``start`` on, the finished ones into the training from
    ``trained`` on; where there is no result the row stays nan."""
    there = [row for row in rows if row is not None]
    if not there:
        return
    none = {name: np.full(np.shape(value), np.nan) for name, value in there[0].items()}
    for file, each in variables.items():
        chosen, first = (there, trained) if file == TRAINING else ([row or none for row in rows], start)
        for name, variable in each.items():
            variable[first : first + len(chosen)] = np.array([row[name] for row in chosen])


def _read(path: Path, drives: list[dict[str, Any]]) -> Row:
    """Values of one result for the index, from its file."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            row = {name: np.asarray(np.ravel(file.attrs.get(name, np.nan))[0]) for name in NUMBERS}
            row["thermal_resistance"] = np.ravel(file.attrs["thermal_resistances"])
            for name in (drive["name"] for drive in drives):
                group = file if file.attrs["drive"] == name else file[name]
                rise = group["delta_T"][()]
                row[f"delta_T_{name}"] = rise[:, None] if rise.ndim == 1 else rise
    except netcdf.DAMAGE as error:
        raise InputError(f"{path} cannot be read ({error}); remove it and run the campaign again") from None
    return row
