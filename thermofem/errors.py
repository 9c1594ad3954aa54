"""Errors that a caller reads: what is wrong, with what value, and what to do; and values as their text shows them."""

import contextlib
from collections.abc import Iterator
from typing import Any, Self

MESSAGE = 1200  # characters of an error message


def one_line(text: str, *, most: int = MESSAGE) -> str:
    """Text as one line that every terminal and file can hold: breaks and control characters become escapes.

    >>> one_line("a\\nb\\x1b[31m")
    'a\\\\nb\\\\x1b[31m'
    """
    line = text[: most + 1]
    if not line.isprintable():
        line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    return line if len(line) <= most else f"{line[: most - 3]}..."


def shown(value: Any) -> str:
    """``repr`` of any value, in one line of at most 80 characters.

    >>> shown(10**5000)
    'an int that is too long to print'
    """
    try:
        text = repr(value)
    except (ValueError, RecursionError, MemoryError):  # an integer of more digits than Python prints, deep nesting
        name = type(value).__name__
        return f"a{'n' if name[0] in 'aeio' else ''} {name} that is too long to print"
    return one_line(text, most=80)


class Hint(str):
    """Hint of an InputError in two spellings: SI numbers for Python, quantities with units (``text``) for files.

    >>> Hint("lengths are in metres (did you mean 450e-9?)", text='did you mean "450 nm"?').text
    'did you mean "450 nm"?'
    """

    text: str

    def __new__(cls, si: str, *, text: str = "") -> Self:
        """Make the hint from its spelling with SI numbers; ``text``: the spelling with units."""
        hint = super().__new__(cls, si)
        hint.text = text
        return hint


class InputError(ValueError):
    """An argument cannot be used; the message names the argument, the value, the rule and a hint.

    The message is one line of at most `MESSAGE` characters, whatever the value holds; rule, hint: its two parts.
    """

    def __init__(self, rule: str, hint: str = "") -> None:
        self.rule = one_line(str(rule))
        self.hint = hint if isinstance(hint, Hint) else one_line(str(hint))
        super().__init__(f"{self.rule}; {self.hint}" if hint else self.rule)

    def for_text(self) -> str:
        """The message for someone who wrote quantities with units: a file of TOML, an option of the command line."""
        hint = self.hint.text if isinstance(self.hint, Hint) else self.hint
        return f"{self.rule}; {hint}" if hint else self.rule

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        """Pickle rule and hint, from which another process makes the error again."""
        return type(self), (self.rule, self.hint)


@contextlib.contextmanager
def prefixed(prefix: str, *others: type[Exception], text: bool = False, hint: str = "") -> Iterator[None]:
    """Begin the InputErrors of a block with ``prefix``, such as a file's name, unless they begin so already.

    others: exceptions of other libraries that become InputErrors, too.
    text: take the hint for someone who wrote quantities with units.
    hint: of errors without one.

    >>> with prefixed("ring.toml", ValueError):
    ...     float("wide")
    Traceback (most recent call last):
    thermofem.errors.InputError: ring.toml: could not convert string to float: 'wide'
    """
    caught: tuple[type[Exception], ...] = (InputError, *others)
    try:
        yield
    except caught as error:
        rule = getattr(error, "strerror", None) or str(error) or type(error).__name__
        if isinstance(error, InputError):
            rule, hint = (error.for_text(), "") if text else (error.rule, error.hint or hint)
        begun = rule.startswith(prefix.split(" = ")[0])
        raise InputError(rule if begun else f"{prefix}: {rule}", hint) from None


class MissingLibraryError(ImportError):
    """A library that this call needs cannot be loaded; the message names it and how to install it."""
