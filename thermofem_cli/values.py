"""The values of options that may be given several times."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from typing import Any

from thermofem.checks import InputError


def each(value: Any) -> Iterable[Any]:
    """The values of an option that may be given several times."""
    return value if isinstance(value, list | tuple) else [value]


def assigned(option: str, texts: Iterable[str], example: str) -> dict[str, str]:
    """Names and values of a repeatable option 'NAME=VALUE'; InputError for another form, or a name given twice.

    Spaces around a name, and around a stroke in it, are no part of it: names are compared without them.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        name = "/".join(part.strip() for part in name.split("/"))
        if not (name and equals and value):
            raise InputError(f"{option} {text!r} is not of the form NAME=VALUE, such as {example!r}")
        if name in found:
            raise InputError(f"{option} {name!r} is given twice; give it once")
        found[name] = value
    return found


@contextlib.contextmanager
def naming(options: str) -> Iterator[None]:
    """Say which options a refusal is about, where it speaks of the numbers that they gave."""
    try:
        yield
    except InputError as error:
        if error.rule.startswith(options.split(" = ")[0]):
            raise
        raise InputError(f"{options}: {error.for_text()}") from None
