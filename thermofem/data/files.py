"""Files: bounded reading, JSON and TOML as trees of bounded depth, whole writes, hashes, locked folders.

A tree holds objects, lists, text, finite numbers, true, false and null, nested at most `DEPTH` deep.

`write_whole` writes a temporary file in the target's folder and renames it (`os.replace`). Nothing that belongs to the
whole process is touched: no umask, no signal handler. A killed run leaves its temporary file; `own_folder` deletes
those of the folder that it locks.
"""

import contextlib
import hashlib
import json
import math
import os
import re
import secrets
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import filelock
import tomli_w

from .. import checks
from ..checks import InputError
from . import quantity

T = TypeVar("T")

LARGEST_FILE = 200_000_000  # bytes of a file that is read whole; a StateSpace of 500 states has 30 million
LARGEST_TOML = 1_000_000  # characters; tomllib takes microseconds for each
DEPTH = 40  # of tables and lists in one another; our own files reach 8
IMAGES = (".png", ".pdf", ".svg", ".jpg")
_TEMPORARY = re.compile(r"\..*-[0-9a-f]{16}(\.\w+)?")  # names that `write_whole` gives
_WORD = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_DOTTED = re.compile(rf"(?<![\w\\-]){_WORD}(?:[ \t]*+\.[ \t]*+{_WORD}){{{DEPTH}}}")  # tomllib's memory is its square

# kinds of the values of a table beside SI units, see `read_table`
TEXT, FLAG, NUMBER, TABLE, ANY = "text", "true or false", "a number", "a table", "anything"
TABLES = "tables, each opened by its name in double brackets, [[name]]"
_KINDS: dict[str, Any] = {TEXT: str, FLAG: bool, NUMBER: float, TABLE: dict, TABLES: list, ANY: object}


def regular(path: str | Path, kind: str = "") -> Path:
    """The path of a regular file; InputError for what does not exist, a folder, a pipe or a device."""
    path = checks.path("path", path)
    what = f"{kind} file {str(path)!r}" if kind else str(path)
    with checks.prefixed(f"{what} cannot be read", OSError):
        there = path.exists()
        if path.is_file():
            return path
    raise InputError(f"{what} {'cannot be read: it is a folder or a device' if there else 'does not exist'}")


def read_bytes(path: str | Path, kind: str, *, most: int = LARGEST_FILE) -> bytes:
    """Content of a file of a kind such as "geometry"; InputError where there is none, or more than ``most`` bytes."""
    path = regular(path, kind)
    with checks.prefixed(f"{kind} file {str(path)!r} cannot be read", OSError):
        checks.integer("its number of bytes", path.stat().st_size, 0, most)
        return path.read_bytes()


def read_text(path: str | Path, kind: str, *, most: int = LARGEST_FILE) -> str:
    """Text of a UTF-8 file, with or without a byte order mark; raises as `read_bytes`."""
    content = read_bytes(path, kind, most=most)
    with checks.prefixed(f"{kind} file {str(path)!r} cannot be read", UnicodeDecodeError, hint="it must be UTF-8"):
        return content.decode("utf-8-sig")


def read_json(path: str | Path, kind: str) -> Any:
    """Tree of a JSON file, see `from_json`; errors begin with the name of the file."""
    text = read_text(path, kind)
    with checks.prefixed(f"{path} cannot be read"):
        return from_json(text)


def read_toml(path: str | Path, kind: str, read: Callable[[str], T]) -> T:
    """Result of ``read`` for the text of a TOML file; its InputErrors begin with the name of the file."""
    text = read_text(path, kind)
    with checks.prefixed(str(path), text=True):
        return read(text)


def from_json(text: str) -> Any:
    """Parse a JSON text to a tree of dicts, lists and plain values.

    Raises InputError: no JSON, nested deeper than `DEPTH`, a number that is not finite.

    >>> from_json('{"R": [1e3, 2]}')
    {'R': [1000.0, 2]}
    """
    with checks.prefixed("it is not JSON", ValueError, RecursionError, hint="is it complete?"):
        tree = json.loads(text)
    _check_tree(tree)
    return tree


def from_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text; raises as `from_json`, with line and column where it is no TOML."""
    with checks.prefixed("not valid TOML", ValueError, RecursionError):
        if len(text) > LARGEST_TOML or _DOTTED.search(text):
            raise InputError(f"more than {LARGEST_TOML} characters, or nested more than {DEPTH} deep")
        tables = tomllib.loads(text)
    _check_tree(tables)
    return tables


def _check_tree(tree: Any, where: str = "", depth: int = 0) -> None:
    """InputError where a tree is too deep, or holds anything but text, finite numbers, true, false and null."""
    items: Any = ()
    if isinstance(tree, dict):
        items = tree.items()
    elif isinstance(tree, list):
        items = enumerate(tree)
    for key, value in items:
        nested = isinstance(value, dict | list)
        if nested and depth < DEPTH:
            _check_tree(value, f"{where}{key}.", depth + 1)
            continue
        finite = not isinstance(value, float) or math.isfinite(value)
        if not finite or not isinstance(value, str | int | float | None):
            rule = f"more than {DEPTH} deep" if nested else "neither text, finite number, true nor false"
            raise InputError(f"{where}{key}: {checks.shown(value)} is {rule}")


def read_table(table: Any, keys: Mapping[str, str], where: str, *, required: Sequence[str] = ()) -> dict[str, Any]:
    """The values of one TOML table, quantities in SI; ``keys`` gives the SI unit of each, or a kind such as `TEXT`.

    Raises InputError: no table, a key that is unknown or missing, a value of another kind or unit.
    """
    checks.instance(where, table, dict, hint="a table is needed")
    for key in table:
        checks.choice(f"{where}: key", key, keys)
    for key in required:
        if key not in table:
            hint = f"add [[{key}]] tables" if keys[key] == TABLES else ""
            raise InputError(f"{where}: {key} is missing", hint)
    return {key: _value(f"{where}: {key}", value, keys[key]) for key, value in table.items()}


def _value(name: str, value: Any, kind: str) -> Any:
    if kind not in _KINDS:
        return quantity.parse(value, kind, name=name)
    if kind == NUMBER:
        return checks.finite(name, value)
    fits = isinstance(value, _KINDS[kind])
    if fits and kind == TABLES:
        fits = all(isinstance(table, dict) for table in value)
    if not fits:
        raise InputError(f"{name} = {checks.shown(value)} must be {kind}")
    return value


def to_toml(tables: Mapping[str, Any]) -> str:
    """TOML text of tables of text, numbers, true and false."""
    return tomli_w.dumps(tables)


def plain(value: Any) -> Any:
    """A value as JSON holds it: arrays as lists, keys as text; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def digest(content: bytes | Path) -> str:
    """Hash of bytes, or of the content of a file: 32 hexadecimal digits of SHA-256."""
    if isinstance(content, Path):
        content = content.read_bytes()
    return hashlib.sha256(content).hexdigest()[:32]


def digest_tree(tree: Any) -> str:
    """Hash of a tree of JSON, whatever the order of its keys."""
    return digest(json.dumps(tree, sort_keys=True).encode())


def lines_of(text: str) -> list[str]:
    """Text as printable ASCII lines for a comment in any program's file.

    No line ends in a backslash, which some programs read as a continuation.

    >>> lines_of("a\\r.include b\\x00")
    ['a', '.include b\\\\x00']
    """
    pieces = str(text).splitlines() or [""]
    lines = [checks.one_line(piece, most=4000) for piece in pieces]
    ascii_lines = (line.encode("ascii", "backslashreplace").decode() for line in lines)
    return [f"{line} ." if line.endswith("\\") else line for line in ascii_lines]


def check_target(path: str | Path) -> Path:
    """Path at which a file will be written, links followed; InputError where no file can be written."""
    path = Path(os.path.realpath(checks.path("path", path)))
    folder = path.parent
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder; make it first to write {path.name}")
    there = path.exists()
    writable = os.access(path if there else folder, os.W_OK)
    if not writable or (there and not path.is_file()):
        raise InputError(f"{path} is a folder or a device, or write-protected; give the name of a file")
    return path


def check_image(path: str | Path) -> None:
    """InputError unless the name ends as one of `IMAGES`."""
    ending = checks.path("path", path).suffix.lower()
    checks.choice(f"ending of {path}", ending, IMAGES, hint="it chooses the kind")


def write_whole(path: str | Path, write: Callable[[Path], Any]) -> Path:
    """Call ``write`` on a temporary file beside ``path`` and rename it: a reader sees the whole file or none.

    A file that is replaced keeps its permissions. Raises InputError: it cannot be written.
    """
    path = check_target(path)
    mark = secrets.token_hex(8)
    temporary = path.with_name(f".{path.stem[:40]}-{mark}{path.suffix}")
    try:
        with checks.prefixed(f"{path} cannot be written", OSError):
            temporary.touch(exist_ok=False)
            write(temporary)
            if path.exists():
                shutil.copymode(path, temporary)
            temporary.replace(path)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
    return path


def make_folder(path: str | Path) -> Path:
    """Make a folder to write into where it does not exist; InputError when that is not possible."""
    path = checks.path("path", path)
    with checks.prefixed(f"folder {path} cannot be made", OSError):
        path.mkdir(parents=True, exist_ok=True)
    return path


@contextlib.contextmanager
def locked(path: Path, what: str) -> Iterator[None]:
    """Hold a lock on the file ``path`` as long as the with-block runs; the file is made where there is none.

    what: which thing the lock guards, as the error calls it.
    Raises InputError: another run holds the lock, or the file cannot be written. A killed process gives its lock back.
    """
    lock = filelock.FileLock(path, timeout=0)
    with checks.prefixed(f"{what} cannot be written", OSError):
        try:
            lock.acquire()
        except filelock.Timeout:
            raise InputError("it is in use by another run", "wait for it, or take another one") from None
    with lock:
        yield


@contextlib.contextmanager
def own_folder(folder: Path, inner: Sequence[str]) -> Iterator[None]:
    """Make the folder of a store and those in it, lock it, and delete half-written files of a killed run.

    inner: names of the folders in it.
    Raises InputError: it cannot be made or written, or another run is using it.
    """
    folder = make_folder(folder)
    with locked(folder / ".lock", f"folder {folder}"):
        folders = [make_folder(folder / name) for name in inner]
        for place in (folder, *folders):
            for path in place.iterdir():
                if _TEMPORARY.fullmatch(path.name):
                    path.unlink(missing_ok=True)
        yield
