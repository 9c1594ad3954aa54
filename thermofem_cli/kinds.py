"""The kind of an input file; report a file of the wrong kind, with the command that takes it."""

from __future__ import annotations

from pathlib import Path

from thermofem.checks import InputError
from thermofem.data import files

# kind -> what it is, and what takes it
KINDS = {
    "geometry": ("a geometry", "thermofem solve, reduce, validate, cosimulate and explore take it"),
    "ring": ("the optics of a ring", "thermofem simulate, cosimulate, map, stability and explore take it with --ring"),
    "campaign": ("a campaign", "thermofem campaign takes it"),
    "model": ("a thermal model", "thermofem simulate, map, stability, validate, explore, export and cite take it"),
    "family": ("a family of rings", "thermofem design, uncertainty, calibrate and explore take it"),
    "data": ("data (netCDF)", "thermofem fit and cite take it"),
    "result": ("a result (netCDF) that trains no model", "th.load and coupled.plot take it, in Python"),
    "table": ("a table of numbers", "thermofem fit takes it"),
}
# what is needed, what was given -> the command that makes the one of the other
MAKES = {
    ("model", "geometry"): "thermofem reduce {} -o model.json",
    ("model", "data"): "thermofem fit {} -o model.json",
    ("model", "table"): "thermofem fit {} --power '1 mW' -o model.json",
    ("data", "geometry"): "thermofem solve {} -o heat.nc",
}
OPTICS = {"base", "wavelength", "frequency", "loaded_q", "intrinsic_q", "bus_rate", "carriers", "dispersion"}


def expect(path: Path | None, *wanted: str) -> None:
    """Raise InputError for a file of the wrong type; a file of unknown type passes, and its reader decides."""
    found = kind_of(path) if path else None
    if path is None or found is None or found in wanted:
        return
    what, takes = KINDS[found]
    made = [MAKES[kind, found].format(path) for kind in wanted if (kind, found) in MAKES]
    hint = f"`{made[0]}` makes it from this" if made else takes
    needed = " or ".join(KINDS[kind][0] for kind in wanted if kind != "result")
    raise InputError(f"{path} holds {what}, not {needed}; {hint}")


def kind_of(path: Path) -> str | None:
    """Type of a file, one of `KINDS`; None where the file is unreadable, damaged or of another type."""
    try:
        with files.regular(path).open("rb") as file:
            first = file.read(6)
        if first == b"\x89HDF\r\n":
            return _of_netcdf(path)
        if first[:4] == b"PK\x03\x04" and path.suffix.lower() == ".json":
            return "family"
        if path.suffix.lower() == ".toml":
            return _of_toml(set(files.from_toml(files.read_text(path, "TOML"))))
        if path.suffix.lower() == ".json":
            loaded = files.read_json(path, "JSON")
            return "model" if isinstance(loaded, dict) and "format" in loaded else None
    except (OSError, InputError):
        return None
    return "table" if any(b"0" <= bytes([c]) <= b"9" for c in first) or path.suffix.lower() not in (".msh", ".py") else None


def _of_netcdf(path: Path) -> str | None:
    """Kind of a netCDF file: data where there is heat over time; runs with light, maps and indices are results."""
    import h5py

    from thermofem.data.netcdf import DAMAGE

    try:
        with h5py.File(path, "r") as file:
            names = set(file)
    except DAMAGE:
        return None
    return "data" if "time" in names and "carriers" not in names else "result"


def _of_toml(keys: set[str]) -> str | None:
    if keys & {"vary", "drive", "geometry"}:
        return "campaign"
    if keys & {"layer", "part", "outer_radius"}:
        return "geometry"
    return "ring" if keys & OPTICS else None
