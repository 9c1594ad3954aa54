"""Thermal models as versioned JSON: readable by eye, checked when written and when read.

    {"format": "thermofem thermal model", "schema": 1, "kind": "Foster",
     "inputs": ["core"], "outputs": ["core"], "thermal_resistance": 7784.2,
     "poles": [{"R": 1997.6, "tau": 5.58e-08}, {"R": 5786.6, "tau": 1.2e-06}],
     "units": {"thermal_resistance": "K/W", "R": "K/W", "tau": "s"},
     "provenance": {...}}

docs/models.md describes every field. A kind of model joins by its methods ``to_json`` and ``from_json`` and one line in
`KINDS`.
"""

import json
import logging
from collections.abc import Mapping
from dataclasses import fields, replace
from operator import methodcaller
from pathlib import Path
from typing import Any

from .. import checks
from ..data import files
from ..data.files import digest_tree, write_whole
from .cauer import Cauer
from .contract import HasModel, ThermalModel, bare
from .foster import Foster, OutputMap
from .identified_network import Network
from .nonlinear_models import Quadratic
from .state_space import StateSpace

FORMAT = "thermofem thermal model"
SCHEMA = 1
HASH = "content_hash"  # in the provenance
CLAIMS = ("error_bound", "static_error", "residual_K", "relative_residual")  # of the provenance: how good the model is
_log = logging.getLogger("thermofem")

KINDS: dict[str, Any] = {kind.__name__: kind for kind in (Cauer, Foster, Network, OutputMap, Quadratic, StateSpace)}


def save_model(model: ThermalModel, path: str | Path, *, provenance: Mapping[str, Any] | None = None) -> Path:
    """Write a model as JSON, whole or not at all.

    Parameters
    ----------
    model : ThermalModel
        of a kind listed in docs/models.md, or a fit or reduction that holds one.
    path : str or Path
    provenance : mapping
        where the model comes from, anything that JSON can hold; default the ``.provenance`` of a fit or reduction,
        or the ``.origin`` of a model.

    Returns
    -------
    Path
        the file written.

    Raises
    ------
    InputError
        a kind that has no JSON form (the FEM itself: reduce it first), an unphysical model, provenance that JSON
        cannot hold, or a folder that does not exist or cannot be written.
    """
    if provenance is None:
        provenance = model.provenance if isinstance(model, HasModel) else getattr(model, "origin", None)
    kind: Any = model if type(model) in KINDS.values() else bare(model)
    name = type(kind).__name__
    if KINDS.get(name) is not type(kind):
        raise checks.InputError(f"a {name} has no JSON form; the kinds that have one: {', '.join(sorted(KINDS))}")
    provenance = {**checks.mapping("provenance", provenance, hint="such as the .provenance of a fit")}
    provenance.pop(HASH, None)
    content = {
        "format": FORMAT,
        "schema": SCHEMA,
        "kind": name,
        "inputs": list(kind.inputs),
        "outputs": list(kind.outputs),
        **kind.to_json(),
        "provenance": provenance,
    }
    with checks.prefixed("provenance cannot be written as JSON", AttributeError, TypeError, ValueError, RecursionError):
        # NumPy's numbers and arrays have tolist; what is written is read, which raises where it could not be read back
        read = files.from_json(json.dumps(content, allow_nan=False, default=methodcaller("tolist")))
        provenance[HASH] = _signature(read, sorted(read["provenance"]))
        text = json.dumps(content, indent=2, default=methodcaller("tolist"))
    return write_whole(path, lambda p: p.write_text(text + "\n", encoding="utf-8"))


def load_model(path: str | Path) -> Any:
    """Read the model of a file written by `save_model`.

    Where its numbers or its provenance were changed after `save_model` wrote them, the log says so, and the ``.origin``
    of the model claims no error. Entries may be added to the provenance.

    Raises
    ------
    InputError
        no such file, not JSON, not a model, of a newer version, incomplete, or unphysical.
    """
    content, changed = _content(path)
    with checks.prefixed(str(path)):
        kind = checks.choice("kind", str(content.get("kind")), KINDS)
        model = KINDS[kind].from_json(content)
        written = model.to_json()
        units = checks.mapping("units", content.get("units"))
        for name, unit in written["units"].items():
            checks.choice(f"unit of {name}", units.get(name), (unit,), default=unit, hint="model files hold SI")
        _check_static(content.get("thermal_resistance"), written.get("thermal_resistance"), kind)
    if changed:
        _log.warning(
            "%s was changed after thermofem wrote it: values or provenance are not those of then; error unknown",
            path,
        )
    provenance = content.get("provenance")
    keeps = any(field.name == "origin" for field in fields(model))
    return replace(model, origin=provenance) if keeps and isinstance(provenance, dict) and provenance else model


def _check_static(stated: Any, found: float | None, kind: str) -> None:
    """Raise InputError where the thermal resistance that the file states is not that of the model it describes."""
    if stated is None or found is None:
        return
    stated = checks.positive("thermal_resistance", stated, unit="K/W")
    # 1e-9 of R_th with what is stated: 17 digits are written, a person may keep 10
    # 1e-3: the same of a `Network`, see `gate`
    if abs(stated - found) > (1e-3 if kind == "Network" else 1e-9) * stated:
        raise checks.InputError(
            f"thermal_resistance = {stated:.10g} K/W, but the model's own numbers make it {found:.10g}; was a "
            "number edited or lost?"
        )


def load_provenance(path: str | Path) -> dict[str, Any]:
    """Where the model of a file comes from: training drive, parameters, geometry; as given to `save_model`.

    Parameters
    ----------
    path : str or Path
        of `save_model`.

    Returns
    -------
    dict
        numbers in SI; of a file that was changed since, without its error bound and misfit; empty where none is there.

    Raises
    ------
    InputError
        no file, or none of a thermal model.
    """
    return checks.mapping(f"{path}: provenance", _content(path)[0].get("provenance"))


def _signature(content: dict[str, Any], entries: list[str]) -> dict[str, Any]:
    """Hash of a model file, and the provenance entries that it covers; 1 and 1.0 count as one number."""
    covered = {**content, "provenance": {key: content["provenance"].get(key) for key in entries}}
    return {"hash": digest_tree(json.loads(json.dumps(covered), parse_int=float)), "entries": entries}


def _is_changed(content: dict[str, Any], written: Any) -> bool:
    """Whether the content of a file differs from that which its `HASH` was made of; False without a hash."""
    if written is None:
        return False
    entries = written.get("entries") if isinstance(written, dict) else None
    return not isinstance(entries, list) or bool(written != _signature(content, list(map(str, entries))))


def _content(path: str | Path) -> tuple[dict[str, Any], bool]:
    """JSON object of a model file with format and version checked, and whether it was changed after it was written.

    The hash is removed and, from a changed file, the claims on its accuracy.
    """
    tree = files.read_json(path, "model")
    with checks.prefixed(f"{path} is not a thermal model that this version reads"):
        content = checks.mapping("the file", tree)
        checks.choice("format", content.get("format"), (FORMAT,))
        checks.integer("schema", content.get("schema"), 1, SCHEMA, hint="update thermofem")
    found = content.get("provenance")
    provenance: dict[str, Any] = found if isinstance(found, dict) else {}
    written = provenance.pop(HASH, None)
    changed = _is_changed(content, written)
    for claim in CLAIMS if changed else ():
        provenance.pop(claim, None)
    return content, changed
