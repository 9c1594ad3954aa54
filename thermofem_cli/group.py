"""Commands that are imported and built only when they are called, so that the command line starts quickly.

`Commands` is the group that does so. `convert_plainly` reads options without pydantic, which typer imports for that.
`take_over_imports` leaves out modules that other libraries import and that no command uses, and keeps the settings of
the working folder, which may be somebody else's, from Matplotlib and Numba: they can name programs and folders of code.
"""

from __future__ import annotations

import contextlib
import inspect
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator, MutableMapping
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from thermofem.checks import InputError

from .output import speaking

# SciPy copies every name of NumPy, f2py and testing among them (.1 CPU s); numba reads settings from YAML, if any
UNUSED = ("numpy.f2py", "numpy.testing", "yaml")
CONFIGURED = {"matplotlib": "matplotlibrc", "numba": ".numba_config.yaml"}  # settings read from the working folder
SETTINGS = Path(__file__).with_name("settings")  # those of the commands; Matplotlib's own besides
_NUMBERS = {
    int: re.compile(r"[+-]?[0-9]{1,15}"),
    float: re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?"),
}


class Entry(NamedTuple):
    """A command: its heading in --help, its module beside this one, its function there."""

    heading: str
    module: str
    function: str

    def load(self) -> Callable[..., Any]:
        """The function."""
        found: Callable[..., Any] = getattr(import_module(f".{self.module}", __package__), self.function)
        return found


class Commands(TyperGroup):
    """The commands of ``table``; --help lists them under their headings."""

    table: dict[str, Entry]

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Built(self.table)

    def get_params(self, ctx: Any) -> list[Any]:
        """Options of the group, with those of tab completion that typer adds at the end."""
        return convert_plainly(super().get_params(ctx))

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of the table."""
        return list(self.table)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """One section for each heading: names, and the first sentence of each function."""
        width = max(map(len, self.table))
        for heading in dict.fromkeys(entry.heading for entry in self.table.values()):
            rows = [
                (name.ljust(width), (inspect.getdoc(entry.load()) or "").partition("\n\n")[0].replace("\n", " "))
                for name, entry in self.table.items()
                if entry.heading == heading
            ]
            with formatter.section(heading):
                formatter.write_dl(rows)


# names that options had before, which --help does not list: command, old name, new name
FORMER: dict[str, dict[str, str]] = {
    "uncertainty": {"--layer": "--interpolate"},
    "cosimulate": {"--tolerance": "--max-discrepancy"},
}


class _Command(TyperCommand):
    """One command; an option that takes one value is given once, as the parser would forget the others."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Values of arguments and options; InputError for an option that is given twice."""
        former = FORMER.get(self.name or "", {})
        args = [former.get(head := arg.partition("=")[0], head) + arg[len(head) :] for arg in args]
        given = Counter(self.make_parser(ctx).parse_args(args=list(args))[2])
        for option, count in given.items():
            single = option.param_type_name == "option" and not option.multiple
            if count > 1 and single and not getattr(option, "is_flag", False):
                raise InputError(f"{max(option.opts, key=len)} is given {count} times; give it once")
        rest: list[str] = super().parse_args(ctx, args)
        return rest

    def get_params(self, ctx: Any) -> list[Any]:
        """Its arguments and options, --help among them."""
        return convert_plainly(super().get_params(ctx))


class _Built(MutableMapping[str, Any]):
    """Commands by name, built at the first use."""

    def __init__(self, table: dict[str, Entry]) -> None:
        self.table, self.built = table, dict[str, Any]()

    def __getitem__(self, name: str) -> Any:
        if name not in self.built:
            self.built[name] = _build(name, self.table[name])
        return self.built[name]

    def __contains__(self, name: object) -> bool:
        return name in self.table

    def __iter__(self) -> Iterator[str]:
        return iter(self.table)

    def __len__(self) -> int:
        return len(self.table)

    def __setitem__(self, name: str, command: Any) -> None:
        self.built[name] = command

    def __delitem__(self, name: str) -> None:
        del self.built[name]


def _build(name: str, entry: Entry) -> Any:
    """The command as typer makes it, with the options that every command takes."""
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    single.command(name, cls=_Command)(speaking(entry.load()))
    return typer.main.get_command(single)


def convert_plainly(parameters: list[Any]) -> list[Any]:
    """Give parameters `_Plain`, in versions of typer that convert through pydantic, which takes .15 CPU s."""
    for parameter in parameters:
        if getattr(parameter, "_runtime_param", parameter) is None and hasattr(parameter, "type_descriptor"):
            parameter._runtime_param = _Plain()
    return parameters


class _Plain:
    """Conversion of an option's text; what is not plainly a value of its type goes to typer's own, errors included."""

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """The value of the option's type."""
        info, wanted = param.type_descriptor.parameter_info, param.type_descriptor.annotation
        several = param.multiple or param.nargs == -1
        if value is None:
            return () if several else None
        if several and getattr(wanted, "__origin__", None) is list and isinstance(value, tuple | list):
            found = [_plain(one, wanted.__args__[0], info) for one in value]
        else:
            found = [_plain(value, wanted, info)]
        if any(one is None for one in found):
            param._runtime_param = None
            return param.get_runtime_param().coerce(value, param=param, ctx=ctx)
        return found if several else found[0]


def _plain(value: Any, wanted: Any, info: Any) -> Any:
    """Text as str, Path, int or float, or a default as it stands; None for what needs a closer look."""
    if info.min is not None or info.max is not None or info.parser is not None or info.exists:
        return None
    if wanted in (str, Path, int, float) and type(value) is not bool and isinstance(value, wanted):
        return value
    if wanted is Path and isinstance(value, str):
        return Path(value)
    if wanted in _NUMBERS and isinstance(value, str) and _NUMBERS[wanted].fullmatch(value):
        return wanted(value)
    return None


class _Finder:
    """A finder that loads the modules of `UNUSED` at their first use, and those of `CONFIGURED` by themselves."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """The usual place of such a module, with a loader of its own."""
        if name not in (*UNUSED, *CONFIGURED):
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            own: Any = LazyLoader if name in UNUSED else _Elsewhere
            spec.loader = own(spec.loader)
        return spec


class _Elsewhere:
    """A loader that leaves the working folder where that has settings for the module."""

    def __init__(self, loader: Any) -> None:
        self.loader = loader

    def __getattr__(self, name: str) -> Any:
        return getattr(self.loader, name)

    def exec_module(self, module: ModuleType) -> None:
        """Load the module; Numba looks for its file again at every compilation, and finds none from then on."""
        found = os.path.exists(CONFIGURED[module.__name__])
        with contextlib.chdir(SETTINGS) if found else contextlib.nullcontext():
            self.loader.exec_module(module)
        if module.__name__ == "numba":
            sys.modules["numba.core.config"]._config_fname = ""  # type: ignore[attr-defined]


def take_over_imports() -> None:
    """Have `_Finder` find modules from now on; figures are files, whatever a notebook or the user's settings say."""
    os.environ.update(MPLBACKEND="agg", MATPLOTLIBRC=str(SETTINGS))
    if _Finder not in sys.meta_path:
        sys.meta_path.insert(0, _Finder)
