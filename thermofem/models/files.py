"""Thermal models as versioned JSON: readable by eye, checked when written and when read.

    {"format": "thermofem thermal model", "schema": 1, "kind": "Foster",
     "inputs": ["core"], "outputs": ["core"], "thermal_resistance": 7784.2,
     "poles": [{"R": 1997.6, "tau": 5.58e-08}, {"R": 5786.6, "tau": 1.2e-06}],
     "units": {"thermal_resistance": "K/W", "R": "K/W", "tau": "s"},
     "provenance": {...}}

docs/models.md describes every field. A kind of model joins by two functions and one line in `KINDS`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks, trees
from ..dataset import write_whole
from ..files import read_bytes
from ..names import check_names
from .contract import ThermalModel
from .foster import Foster
from .network import Network, gate
from .output_map import OutputMap
from .quadratic import Quadratic
from .state_space import StateSpace

FORMAT = "thermofem thermal model"
SCHEMA = 1
AGREEMENT = 1e-9  # thermal_resistance against the sum of R: 17 digits are written, a person may keep 10


@dataclass(frozen=True)
class Kind:
    """How one kind of model becomes a JSON object and is made from one again."""

    type: type
    write: Callable[[Any], dict[str, Any]]
    read: Callable[[Mapping[str, Any]], Any]


def save_model(model: ThermalModel, path: str | Path, *, provenance: Mapping[str, Any] | None = None) -> Path:
    """Write a model as JSON, whole or not at all.

    Parameters
    ----------
    model : Foster, or another kind listed in docs/models.md
    path : str or Path
    provenance : mapping
        where the model comes from: ``fit.provenance`` or ``rom.provenance``, or anything JSON can hold.

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
    name = next((name for name, kind in KINDS.items() if type(model) is kind.type), None)
    if name is None:
        hint = "; save its .model" if hasattr(model, "model") else ""
        raise checks.InputError(f"a {type(model).__name__} has no JSON form; known: {', '.join(sorted(KINDS))}{hint}")
    checks.has("provenance", provenance or {}, "items", hint="a mapping is needed, such as the .provenance of a fit")
    content = {
        "format": FORMAT,
        "schema": SCHEMA,
        "kind": name,
        "inputs": list(model.inputs),
        "outputs": list(model.outputs),
        **KINDS[name].write(model),
        "provenance": dict(provenance or {}),
    }
    try:
        text = json.dumps(content, indent=2, allow_nan=False, default=_plain)
        trees.from_json(text)  # what is written can be read
    except (TypeError, ValueError, RecursionError) as error:
        raise checks.InputError(f"provenance cannot be written as JSON: {error}") from None
    return write_whole(path, lambda p: p.write_text(text + "\n", encoding="utf-8"))


def load_model(path: str | Path) -> Any:
    """Read the model of a file written by `save_model`.

    Raises
    ------
    InputError
        no such file, not JSON, not a model, of a newer version, incomplete, or unphysical.
    """
    content = _content(path)
    try:
        return KINDS[checks.choice("kind", str(content.get("kind")), KINDS)].read(content)
    except KeyError as error:
        raise checks.InputError(f"{path} has no {error.args[0]!r}; docs/models.md lists the fields") from None
    except (TypeError, AttributeError) as error:
        raise checks.InputError(f"{path} is not laid out as docs/models.md says: {error}") from None
    except checks.InputError as error:
        raise checks.InputError(f"{path}: {error}") from None


def load_provenance(path: str | Path) -> dict[str, Any]:
    """Where the model of a file comes from: training drive, parameters, geometry; as given to `save_model`."""
    provenance = _content(path).get("provenance", {})
    if not isinstance(provenance, dict):
        raise checks.InputError(f"{path}: provenance is a {type(provenance).__name__}; an object is needed")
    return provenance


def _content(path: str | Path) -> dict[str, Any]:
    """The JSON object of a model file, its format and version checked."""
    path = checks.path("path", path)
    if not path.exists():
        raise checks.InputError(f"{path} does not exist")
    raw = read_bytes(path, "model")
    try:
        content = trees.from_json(raw.decode("utf-8"))
    except UnicodeDecodeError:
        raise checks.InputError(f"{path} is not JSON (it is not UTF-8 text); is it complete?") from None
    except checks.InputError as error:
        raise checks.InputError(f"{path} is not JSON that can be read ({error}); is it complete?") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise checks.InputError(f'{path} is not a thermal model; its "format" must be "{FORMAT}"')
    schema = content.get("schema")
    if not isinstance(schema, int) or isinstance(schema, bool) or schema < 1:
        raise checks.InputError(f"{path} has schema {schema!r}; a whole number from 1 is needed")
    if schema > SCHEMA:
        raise checks.InputError(f"{path} has schema {schema}; this version reads up to {SCHEMA}, update thermofem")
    return content


def _plain(value: Any) -> Any:
    """NumPy numbers and arrays as JSON holds them."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__} is not JSON")


def _write_foster(model: Foster) -> dict[str, Any]:
    _check_passive(model)
    pairs = zip(np.asarray(model.R), np.asarray(model.tau), strict=True)
    return {
        "thermal_resistance": model.thermal_resistance,
        "poles": [{"R": float(R), "tau": float(tau)} for R, tau in pairs],
        "units": {"thermal_resistance": "K/W", "R": "K/W", "tau": "s"},
    }


def _read_foster(content: Mapping[str, Any]) -> Foster:
    poles = content["poles"]
    if not isinstance(poles, list) or not poles:
        raise checks.InputError("poles is empty; a Foster network has at least one")
    model = Foster(
        R=[checks.finite(f"poles[{i}].R", p["R"], unit="K/W") for i, p in enumerate(poles)],
        tau=[checks.finite(f"poles[{i}].tau", p["tau"], unit="s") for i, p in enumerate(poles)],
        inputs=_names(content, "inputs"),
        outputs=_names(content, "outputs"),
    )
    _check_passive(model)
    stated = content.get("thermal_resistance")
    if stated is not None:
        stated = checks.positive("thermal_resistance", stated, unit="K/W")
        if abs(stated - model.thermal_resistance) > AGREEMENT * stated:
            raise checks.InputError(
                f"thermal_resistance = {stated:.10g} K/W, but the poles' R add up to {model.thermal_resistance:.10g}; "
                "was a number edited or lost?"
            )
    return model


def _write_output_map(model: OutputMap) -> dict[str, Any]:
    content = _write_foster(model.linear)
    units = {**content.pop("units"), "coefficient": "1/K", "largest_rise": "K"}
    return {**content, "coefficient": model.coefficient, "largest_rise": model.largest_rise, "units": units}


def _read_output_map(content: Mapping[str, Any]) -> OutputMap:
    return OutputMap(_read_foster(content), content["coefficient"], content.get("largest_rise"))


def _write_quadratic(model: Quadratic) -> dict[str, Any]:
    _check_quadratic(model)
    arrays = {name: getattr(model, name).tolist() for name in ("A", "H", "G", "B", "C")}
    units = {"A": "1/s", "H": "1/(K s)", "G": "1/J", "B": "K/J", "C": "1", "largest_rise": "K"}
    return {**arrays, "largest_rise": model.largest_rise, "units": units}


def _read_quadratic(content: Mapping[str, Any]) -> Quadratic:
    model = Quadratic(
        A=content["A"],
        H=content["H"],
        G=content["G"],
        B=content["B"],
        C=content["C"],
        inputs=_names(content, "inputs"),
        outputs=_names(content, "outputs"),
        largest_rise=content.get("largest_rise"),
    )
    _check_quadratic(model)
    return model


def _check_quadratic(model: Quadratic) -> None:
    """Refuse a system that cools where it is heated, or whose H and G outweigh A and B at a rise of 1 mK already."""
    static = model.thermal_resistance
    if not static > 0:
        raise checks.InputError(f"the static gain -C A^-1 B = {static:g} K/W is not positive: heat would cool it")
    with np.errstate(all="ignore"):
        try:
            rise = float(model.steady_rise(1e-3 / static))
        except (checks.InputError, np.linalg.LinAlgError):
            rise = float("nan")
    if not abs(rise - 1e-3) <= 0.01 * 1e-3:  # k and c_p of no solid change by 1 % over 1 mK
        raise checks.InputError("H or G outweighs A at a rise of 1 mK; is a unit or an exponent wrong?")


def _write_network(model: Network) -> dict[str, Any]:
    units = {"A": "1/s", "b": "K/J", "thermal_resistance": "K/W", "largest_rise": "K"}
    return {
        "states": list(model.names),
        "A": model.A.tolist(),
        "b": model.b.tolist(),
        "thermal_resistance": model.thermal_resistance,
        "largest_rise": model.largest_rise,
        "units": units,
    }


def _read_network(content: Mapping[str, Any]) -> Network:
    names = _names(content, "states")
    try:
        A, b = np.array(content["A"], dtype=float), np.array(content["b"], dtype=float)
    except ValueError:
        raise checks.InputError("A and b must be tables of numbers") from None
    if A.shape != (len(names), len(names)) or b.shape != (len(names),):
        raise checks.InputError(f"A has shape {A.shape} and b {b.shape} for {len(names)} states")
    stated = checks.positive("thermal_resistance", content["thermal_resistance"], unit="K/W")
    poles = gate(checks.numbers("A", A), checks.numbers("b", b), stated, name=names[0])
    return Network(A, b, names, poles, checks.positive("largest_rise", content["largest_rise"], unit="K"))


def _check_passive(model: Foster) -> None:
    """Refuse a network that could give out heat it never took in; between two parts an R may be negative."""
    R = np.asarray(model.R)
    if model.inputs == model.outputs and not model.passive:
        raise checks.InputError(
            f"R = {R.min():g} K/W is negative: the network is not passive; fit_foster and reduce never give one"
        )
    if not np.any(R > 0):
        raise checks.InputError("every R is zero: the model never warms up")


def _write_state_space(model: StateSpace) -> dict[str, Any]:
    if model.order > 500:
        raise checks.InputError(f"a StateSpace of {model.order} states is not compact; surrogate.reduce it first")
    dense = {name: _dense(getattr(model, name)) for name in ("E", "A", "B", "C")}
    _check_definite(dense["E"], dense["A"])
    units = {"E": "J/K", "A": "W/K", "B": "1", "C": "1"}
    return {**{name: matrix.tolist() for name, matrix in dense.items()}, "units": units}


def _read_state_space(content: Mapping[str, Any]) -> StateSpace:
    try:
        E, A, B, C = (np.array(content[name], dtype=float) for name in ("E", "A", "B", "C"))
    except ValueError:
        raise checks.InputError("E, A, B and C must be rectangular tables of numbers") from None
    for name, matrix in (("E", E), ("A", A), ("B", B), ("C", C)):
        if matrix.ndim != 2:
            raise checks.InputError(f"{name} has {matrix.ndim} dimensions; a table of rows is needed")
    model = StateSpace(E, A, B, C, inputs=_names(content, "inputs"), outputs=_names(content, "outputs"))
    _check_definite(E, A)
    return model


def _check_definite(E: Any, A: Any) -> None:
    """Refuse matrices that are not those of a system whose every mode decays."""
    for name, matrix in (("E", E), ("-A", -A)):
        scale = float(np.abs(matrix).max())
        if not np.all(np.isfinite(matrix)) or np.abs(matrix - matrix.T).max() > 1e-9 * scale:
            raise checks.InputError(f"{name} is not a symmetric matrix of finite numbers")
        if np.linalg.eigvalsh(matrix)[0] <= 0:
            raise checks.InputError(f"{name} is not positive definite: some mode would not decay")


def _dense(matrix: Any) -> Any:
    return matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix, dtype=float)


def _names(content: Mapping[str, Any], which: str) -> tuple[str, ...]:
    return check_names(which, content[which])


KINDS: dict[str, Kind] = {
    "Foster": Kind(Foster, _write_foster, _read_foster),
    "Network": Kind(Network, _write_network, _read_network),
    "OutputMap": Kind(OutputMap, _write_output_map, _read_output_map),
    "Quadratic": Kind(Quadratic, _write_quadratic, _read_quadratic),
    "StateSpace": Kind(StateSpace, _write_state_space, _read_state_space),
}
