"""The options of a command: none that is given is ignored."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from thermofem.checks import InputError

from .values import each


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
        (frozenset({"power", "detuning", "optics", "ring"}), _pulses, "goes with --period, --swing or --range"),
    ),
    "uncertainty": (
        (frozenset({"points"}), lambda o: o["map_"], "goes with --map"),
        (frozenset({"period"}), lambda o: not o["map_"], "and --map exclude each other"),
        (frozenset({"power", "detuning", "optics", "ring"}), _pulses, "goes with --period or --map"),
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
    return ", ".join(str(item) for item in each(value))
