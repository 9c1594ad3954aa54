"""Checks over all options of a command: none writes over a file that is given, and none that is given is ignored."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from ..checks import InputError

OUTPUTS = frozenset({"output", "figure", "preview", "paraview", "animation", "map_", "resume", "folder"})


def check_apart(options: Mapping[str, Any]) -> None:
    """InputError where a command would write over a file that another of its options names.

    Every option but those in `OUTPUTS` counts as an input, so that no command has to list its own.
    """
    given = [item for name, value in options.items() if name not in OUTPUTS for item in _each(value)]
    taken = [item for item in given if isinstance(item, str | Path) and os.path.isfile(item)]
    for name in OUTPUTS & options.keys():
        for path in filter(None, _each(options[name])):
            if any(writes(path, item) for item in taken):
                raise InputError(f"{path} would be read and written at once; give it another name")


def writes(output: str | Path, other: str | Path) -> bool:
    """Whether a command that writes one file writes the other: the .vtu files beside a .pvd are written with it."""
    first, second = Path(os.path.realpath(output)), Path(os.path.realpath(other))
    step = re.fullmatch(rf"{re.escape(first.stem)}_\d{{4,}}\.vtu", second.name)
    return first == second or (first.suffix == ".pvd" and first.parent == second.parent and step is not None)


def _each(value: Any) -> Iterable[Any]:
    return value if isinstance(value, list | tuple) else [value]


def _pulses(options: Mapping[str, Any]) -> bool:
    """Whether light is asked for: a cycle, a range of pulsing or a map of it."""
    return any(options.get(name) for name in ("period", "swing", "range_", "map_"))


def _swept(options: Mapping[str, Any]) -> str | None:
    """Whether --sweep goes through "power" or "detuning"; None without it."""
    from .drives import kind

    return kind("--sweep", options["sweep"].split(",")[0].strip()) if options["sweep"] else None


def _meshes(options: Mapping[str, Any]) -> bool:
    """Whether a geometry is among the files, or the reference strip is taken."""
    given = [path for name in ("inputs", "files", "models") for path in options.get(name) or ()]
    return not given or any(path.suffix.lower() != ".json" for path in given)


_SOLVED = frozenset({"power", "pulse", "square", "duty", "periodic", "duration", "samples", "heated", "read", "rtol"})
_SOLVED |= {"figure", "field_times", "paraview", "animation", "output"}
Rule = tuple[frozenset[str], Callable[[Mapping[str, Any]], Any], str]
USED: Mapping[str, tuple[Rule, ...]] = {
    "solve": (
        (_SOLVED, lambda o: not o["no_solve"], "has no effect with --no-solve, which draws the --preview alone"),
        (frozenset({"duration"}), lambda o: not o["periodic"], "has no effect with --periodic: one period is solved"),
    ),
    "design": (
        (frozenset({"power", "detuning"}), _pulses, "goes with --period, --swing or --range"),
        (frozenset({"ring"}), lambda o: _pulses(o) or o["optics"], "goes with --period, --swing or --range"),
    ),
    "uncertainty": (
        (frozenset({"points"}), lambda o: o["map_"], "goes with --map"),
        (frozenset({"period"}), lambda o: not o["map_"], "and --map exclude each other"),
        (frozenset({"power", "detuning"}), _pulses, "goes with --period or --map"),
        (frozenset({"ring"}), lambda o: _pulses(o) or o["optics"], "goes with --period or --map"),
    ),
    "simulate": (
        (frozenset({"power"}), lambda o: _swept(o) != "power", "has no effect with a --sweep of the power"),
        (frozenset({"detuning"}), lambda o: _swept(o) != "detuning", "has no effect with a --sweep of the detuning"),
    ),
    "explore": ((frozenset({"accuracy"}), _meshes, "is that of a geometry's mesh; models have none"),),
    "validate": ((frozenset({"accuracy"}), _meshes, "is that of a geometry's mesh; models have none"),),
}
"""For each command: options, whether they count beside the other options, and what to say where they do not."""


def check_used(command: Callable[..., Any], options: Mapping[str, Any]) -> None:
    """InputError where an option differs from its default and would be ignored, by the rules of `USED`."""
    defaults = inspect.signature(command).parameters
    for names, used, words in USED.get(command.__name__, ()):
        for name in sorted(names & options.keys()):
            if options[name] != defaults[name].default and not used(options):
                shown = "" if options[name] is True else f" {_shown(options[name])}"
                raise InputError(f"--{name.strip('_').replace('_', '-')}{shown} {words}; leave it out")


def _shown(value: Any) -> str:
    return ", ".join(str(item) for item in _each(value))
