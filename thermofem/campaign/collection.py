"""The folder of a campaign, and all its geometries as one Dataset: the index and the training collection.

    plan.json             the geometries and their hashes, what is varied, the drives
    results/KEY.nc        one geometry each; results.sha256: a hash for each
    failures/KEY.json     why one has no result
    index.nc              every geometry; training.nc: the finished ones, ready for machine learning

Dimensions and variables, DRIVE being the name of a drive
    case; delta_T_DRIVE (K) over case, time_DRIVE and probe; power_DRIVE (W) over time_DRIVE; thermal_resistance (K/W)
    over case and probe; unknowns, discretization_error and domain_error (relative) over case; the varied
    quantities and ``key`` (the name of the file) over case.
    The index holds every geometry, nan where there is no result, with ``status`` ("finished", "failed" or "waiting")
    and ``reason``. The training collection holds the finished ones and the matrix ``features`` over case and feature.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import xarray as xr

from .. import checks, waveforms
from ..arrays import Array, NDArray
from ..data import dataset, files, netcdf
from ..data.variables import describe
from ..errors import InputError
from .stored_tasks import Store

if TYPE_CHECKING:
    from .campaign import Campaign, Case

Row = dict[str, Array]  # thermal_resistance, delta_T_DRIVE and `NUMBERS` of one geometry

KEY = re.compile(r"[0-9a-f]{16}")
NUMBERS = {
    "unknowns": "unknowns of the mesh",
    "discretization_error": "relative error of R_th and of the step from 1 ns on by the mesh",
    "domain_error": "relative change of R_th if the stack went on beyond the domain",
}


@dataclass(frozen=True)
class Folder(Store):
    """The files of one campaign: the finished geometries, the plan, and why others failed."""

    ending: str = ".nc"

    @property
    def plan(self) -> Path:
        """File that lists the geometries."""
        return self.folder / "plan.json"

    def failure(self, key: str) -> Path:
        """File of the reason why one geometry has no result."""
        return self.folder / "failures" / f"{key}.json"

    def write_failure(self, key: str, reason: str, values: Mapping[str, Any]) -> None:
        """Store why one geometry has no result."""
        _write_json(self.failure(key), {"reason": reason, "values": values})

    def reason(self, key: str) -> str:
        """Reason why a geometry has no result; empty where none was written."""
        if not self.failure(key).is_file():
            return ""
        try:
            return str(files.read_json(self.failure(key), "reason")["reason"])
        except (InputError, KeyError, TypeError):
            return ""

    def status(self, keys: list[str]) -> list[str]:
        """Status of each geometry: "finished", "failed" or "waiting"."""
        finished = self.intact(keys)

        def word(key: str) -> str:
            if key in finished:
                return "finished"
            return "failed" if self.failure(key).is_file() else "waiting"

        return list(map(word, keys))

    def write_plan(self, campaign: Campaign, cases: list[Case]) -> None:
        """Write the plan of the campaign into its folder."""
        drives = []
        for drive in campaign.drives:
            waveform = waveforms.to_json(drive.wave)
            drives.append({"name": drive.name, "waveform": waveform, "times": drive.kept.tolist()})
        plan = {
            "name": campaign.name,
            "geometry": campaign.geometry,
            "variations": [{"name": v.name, "paths": v.paths, "unit": v.unit} for v in campaign.variations],
            "drives": drives,
            "cases": [[case.key, *case.values] for case in cases],
        }
        _write_json(self.plan, plan)

    def read_plan(self) -> dict[str, Any]:
        """The plan as `write_plan` stored it; InputError where the folder holds none, or one with invalid keys."""
        if not self.plan.is_file():
            raise InputError(f"{self.folder} holds no campaign", "thermofem campaign makes one")
        plan = checks.mapping("plan", files.read_json(self.plan, "plan"))
        if not all(KEY.fullmatch(str(case[0])) for case in plan["cases"]):  # keys become names of files
            raise InputError(f"{self.plan} was changed", "run the campaign again, which takes over its results")
        return plan


def _write_json(path: Path, content: dict[str, Any]) -> None:
    text = json.dumps(content)
    files.write_whole(path, lambda temporary: temporary.write_text(text))


def open_campaign(directory: str | Path) -> xr.Dataset:
    """Open the index of a campaign: every geometry, finished or not, as one Dataset.

    It is made from the results that are there, also after a run that was killed; the folder is not written.

    Parameters
    ----------
    directory : str or Path

    Returns
    -------
    Dataset
        see `thermofem.campaign.collection`.

    Raises
    ------
    InputError
        no campaign in the folder.
    """
    folder = Folder(Path(directory))
    return _index(folder, folder.read_plan())


def write_collections(folder: Folder) -> None:
    """Write index and training collection of a campaign, each whole or not at all."""
    plan = folder.read_plan()
    index = _index(folder, plan)
    netcdf.save(index, folder.folder / "index.nc")
    names = [variation["name"] for variation in plan["variations"]]
    netcdf.save(_training(index, names), folder.folder / "training.nc")


def _index(folder: Folder, plan: dict[str, Any]) -> xr.Dataset:
    """All geometries of a plan as one Dataset."""
    keys = [case[0] for case in plan["cases"]]
    status = folder.status(keys)
    rows: list[Row | None] = []
    probes: list[str] = []
    for key, state in zip(keys, status, strict=True):
        row = None
        if state == "finished":
            path = folder.path(key)
            row = _read(path, plan["drives"])
            probes = probes or _probes(path)
        rows.append(row)
    coords: dict[str, Any] = {
        "probe": _words("probe", probes, "part whose mean is read"),
        "key": _words("case", keys, "content hash, the name of the file"),
    }
    for k, variation in enumerate(plan["variations"], 1):
        values = [case[k] for case in plan["cases"]]
        word = any(isinstance(value, str) for value in values)
        attrs = {"long_name": ", ".join(variation["paths"])}
        if not word:
            attrs["units"] = variation["unit"] or "1"
        coords[variation["name"]] = ("case", np.array(values, dtype=object if word else float), attrs)
    reasons = [folder.reason(key) for key in keys]
    data: dict[str, Any] = {
        "status": _words("case", status, "whether there is a result"),
        "reason": _words("case", reasons, "why not"),
    }

    def over_case(name: str, dims: tuple[str, ...], shape: tuple[int, ...], attrs: dict[str, Any]) -> None:
        none = np.full(shape, np.nan)
        values = [none if row is None else row[name] for row in rows]
        data[name] = (("case", *dims), np.array(values), attrs)

    for drive in plan["drives"]:
        name = drive["name"]
        times = np.array(drive["times"])
        wave = waveforms.from_json(drive["waveform"])
        time = f"time_{name}"
        coords[time] = (time, times, describe("time"))
        data[f"power_{name}"] = (time, wave(times), {**describe("power"), "waveform": drive["waveform"]})
        over_case(f"delta_T_{name}", (time, "probe"), (times.size, len(probes)), describe("delta_T"))
    resistance = {"units": "K/W", "long_name": "thermal resistance"}
    over_case("thermal_resistance", ("probe",), (len(probes),), resistance)
    for name, long_name in NUMBERS.items():
        over_case(name, (), (), {"units": "1", "long_name": long_name})
    attrs = {**dataset.stamp("campaign"), "campaign": plan["name"], "geometry": plan["geometry"]}
    return xr.Dataset(data, coords, attrs)


def _words(dimension: str, values: list[str], long_name: str) -> tuple[str, NDArray[Any], dict[str, str]]:
    """Variable of texts in a Dataset."""
    return dimension, np.array(values, dtype=object), {"long_name": long_name}


def _training(index: xr.Dataset, names: list[str]) -> xr.Dataset:
    """Training collection: finished geometries, with the varied quantities as a matrix in SI.

    A word becomes its index in the sorted list of words.
    """
    data = index.isel(case=np.flatnonzero(index["status"].values == "finished")).drop_vars(["status", "reason"])
    columns = []
    for name in names:
        values = data[name].values
        if values.dtype == object:
            _, values = np.unique(values.astype(str), return_inverse=True)
        columns.append(values)
    units = [str(data[name].attrs.get("units", "1")) for name in names]
    matrix = np.array(columns, dtype=float).reshape(len(names), data.sizes["case"]).T
    return data.assign(
        features=(("case", "feature"), matrix, {"long_name": "varied quantities in SI"}),
        feature_unit=_words("feature", units, "its unit"),
    ).assign_coords(feature=_words("feature", names, "varied quantity"))


def _probes(path: Path) -> list[str]:
    """Names of the parts that were read, from the file of one result."""
    with h5py.File(path, "r") as file:
        return str(file.attrs["read"]).split(", ")


def _read(path: Path, drives: list[dict[str, Any]]) -> Row:
    """Values of one result for the index, from its file."""
    with h5py.File(path, "r") as file:
        row = {name: np.asarray(np.ravel(file.attrs.get(name, np.nan))[0]) for name in NUMBERS}
        row["thermal_resistance"] = np.ravel(file.attrs["thermal_resistances"])
        for name in (drive["name"] for drive in drives):
            group = file if file.attrs["drive"] == name else file[name]
            rise = group["delta_T"][()]
            row[f"delta_T_{name}"] = rise[:, None] if rise.ndim == 1 else rise
    return row
