"""Shape of ``plan.json``, checked before anything of it is used: keys are names of files."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from .. import checks
from ..checks import InputError, check_name, shown

KEY = re.compile(r"[0-9a-f]{16}")


def check_plan(tree: Any) -> dict[str, Any]:
    """The plan, unchanged; InputError unless it has the layout that `Store.write_plan` writes."""
    plan = _table(tree, "the plan", {"name": str, "geometry": str, "variations": list, "drives": list, "cases": list})
    for k, item in enumerate(plan["variations"]):
        variation = _table(item, f"variations[{k}]", {"name": str, "paths": list, "unit": str})
        check_name("variation", variation["name"])
        if not all(isinstance(path, str) for path in variation["paths"]):
            raise InputError(f"variations[{k}].paths = {shown(variation['paths'])} must be texts")
    for k, item in enumerate(plan["drives"]):
        drive = _table(item, f"drives[{k}]", {"name": str, "waveform": str, "times": list})
        check_name("drive", drive["name"])
        checks.array(f"drives[{k}].times", np.array(_numbers(drive["times"], f"drives[{k}].times")), increasing=True)
    width = 1 + len(plan["variations"])
    for k, case in enumerate(plan["cases"]):
        if not isinstance(case, list) or len(case) != width or not _is_key(case[0]):
            raise InputError(f"cases[{k}] = {shown(case)} must be a key and {width - 1} values")
        if not all(isinstance(value, str) or _is_number(value) for value in case[1:]):
            raise InputError(f"cases[{k}] = {shown(case)} holds what is neither a number nor a word")
    return plan


def _table(tree: Any, where: str, keys: dict[str, type]) -> dict[str, Any]:
    if not isinstance(tree, dict):
        raise InputError(f"{where} is a {type(tree).__name__}; an object is needed")
    for key, kind in keys.items():
        if not isinstance(tree.get(key), kind):
            raise InputError(f"{where}: {key} = {shown(tree.get(key))} must be a {kind.__name__}")
    return tree


def _is_key(value: Any) -> bool:
    return isinstance(value, str) and KEY.fullmatch(value) is not None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _numbers(values: list[Any], where: str) -> list[float]:
    if not all(map(_is_number, values)):
        raise InputError(f"{where} must be numbers")
    return values
