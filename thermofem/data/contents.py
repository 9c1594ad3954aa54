"""What a Dataset must hold where a function takes one.

Users select, join, rename and rescale Datasets. What a function needs is checked before it computes, so that the error
names the variable and not a line of NumPy's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .. import checks
from ..checks import InputError
from . import netcdf


def takes(name: str, value: Any, *needed: str, what: str) -> Any:
    """``value`` if it has the needed variables (of a Dataset) or attributes; InputError with what is taken if not.

    >>> takes("data", 3, "data_vars", what="a Dataset of th.solve")
    Traceback (most recent call last):
    thermofem.errors.InputError: data is an int; this function takes a Dataset of th.solve
    """
    variables = getattr(value, "variables", None)
    inside: Any = variables if hasattr(variables, "keys") else {}
    # a method of a Dataset, such as xarray's own `drop`, is not the variable of that name
    missing = [one for one in needed if one not in inside and (not hasattr(value, one) or _method(inside, value, one))]
    if not missing and not isinstance(value, type):
        return value
    raise _other(name, value, missing[0] if inside and missing else "", what)


def _method(inside: Any, value: Any, name: str) -> bool:
    """Whether a name that a Dataset holds no variable of is a method of it."""
    return bool(inside) and callable(getattr(value, name, None))


def _other(name: str, value: Any, missing: str, what: str) -> InputError:
    kind = value.__name__ if isinstance(value, type) else type(value).__name__
    article = "an" if kind[:1].lower() in "aeiou" else "a"
    lacks = f" without {missing!r}" if missing else ""
    return InputError(f"{name} is {article} {kind}{lacks}; this function takes {what}")


def contents(
    name: str,
    data: Any,
    dims: Mapping[str, str],
    *,
    what: str,
    fewest: int = 1,
    words: Sequence[str] = (),
    attrs: Sequence[str] = (),
) -> Any:
    """``data`` in SI if it is a Dataset that holds variables over these dimensions, real numbers all of them.

    dims: for each variable its dimensions in their order, as "time" or "model period"; one in brackets may be missing.
    fewest: values along each dimension but those in brackets.
    words: variables that hold text or True and False.
    attrs: attributes that must be finite numbers.
    what: what this function takes, for the message.
    Raises InputError: something else, a variable missing or over other dimensions, too few values, no real numbers.
    """
    variables: Any = getattr(data, "variables", None)
    if isinstance(data, type) or not hasattr(variables, "keys"):
        raise _other(name, data, "", what)
    for variable, shape in dims.items():
        if variable not in variables:
            raise _other(name, data, variable, what)
        _check(f"{name}[{variable!r}]", variables[variable], shape, fewest, what, variable in words)
        if variable in words and shape == variable:  # the names along a dimension
            checks.unique(f"{name}[{variable!r}]", variables[variable].values.tolist())
    for attribute in attrs:
        if attribute not in data.attrs:
            raise InputError(f"{name} has no attribute {attribute!r}; this function takes {what}")
        checks.finite(f"{name}.attrs[{attribute!r}]", data.attrs[attribute])
    return in_si(name, data)


def in_si(name: str, data: Any) -> Any:
    """A Dataset with its known variables in SI, whatever units their attributes state."""
    try:
        return netcdf.in_si(data)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _check(name: str, held: Any, shape: str, fewest: int, what: str, words: bool) -> None:
    """InputError unless a variable has these dimensions, enough values, and values of the right kind."""
    given, possible = tuple(held.dims), shape.split()
    wanted = [one.strip("[]") for one in possible if not one.startswith("[") or one.strip("[]") in given]
    if list(given) != wanted:
        has, needs = (f"({', '.join(map(str, some))})" for some in (given, [one.strip("[]") for one in possible]))
        raise InputError(f"{name} has the dimensions {has}, and {needs} is needed; this function takes {what}")
    for one, size in zip(given, held.shape, strict=True):
        least = 1 if f"[{one}]" in possible else fewest
        if size < least:
            raise InputError(f"{name} holds {size} values along {one!r}; at least {least} are needed")
    if not words and held.dtype.kind not in "fiub":
        raise InputError(f"{name} holds values of the type {held.dtype}; real numbers are needed")


def label(values: Any, name: str) -> str:
    """Name of a variable for an axis and its unit, where the Dataset has kept them."""
    unit = values.attrs.get("units")
    return str(values.attrs.get("long_name", name)) + (f" ({unit})" if unit else "")
