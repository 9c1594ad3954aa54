"""Files of any origin: text and bytes of bounded size, hashes that say whether a file is still the one written, locks.

What is no regular file is refused, for every reader: a pipe would be waited for and a device has no end, and most
readers look at a file twice. ``thermofem show /dev/stdin < model.json`` works, a pipe into it does not.

`digest` is the one hash of the project's stores: the folder of a campaign and that of a reproduction keep it beside
each result and believe no result without it.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import re
import signal
import stat
import threading
import time
import unicodedata
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .. import checks
from ..checks import InputError
from . import trees

WRITTEN = (".nc", ".json", ".npz", ".sha256", ".lock")  # endings of files in the project's stores
IMAGES = (".png", ".pdf", ".svg", ".jpg")
DATED = (".pdf", ".svg")  # images that hold a date
DATE = "SOURCE_DATE_EPOCH"  # where Matplotlib takes it from
_TEMPORARY = re.compile(r"\..*-[0-9a-f]{16}(\.\w+)?")  # names that `write_whole` gives
_STREAMS = re.compile(r"/dev/fd|/proc/\d+(/task/\d+)?/fd")  # folders of a process's open files
DELETED = "the current folder was deleted; change into one that exists"
LINKS = 40  # in a row; Linux follows no more
FRESH = 60.0  # s; a temporary file that was touched within is left alone, locked or not
LARGEST_TEXT = 400_000_000  # bytes


def regular(path: str | Path, kind: str = "") -> Path:
    """The path of a regular file, links followed; InputError for what does not exist, a folder, a pipe or a device."""
    path = checks.path("path", path)
    what = f"{kind} file {str(path)!r}" if kind else str(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise InputError(f"{what} does not exist") from None
    except OSError as error:
        raise InputError(f"{what} cannot be read: {error.strerror}") from None
    if stat.S_ISDIR(mode):
        raise InputError(f"{what} cannot be read: it is a folder; give a file in it")
    if not stat.S_ISREG(mode):
        raise InputError(f"{what} cannot be read: it is a pipe or a device; write its content into a file first")
    return path


def read_bytes(path: str | Path, kind: str, *, most: int = LARGEST_TEXT) -> bytes:
    """Content of a file of a kind such as "geometry"; InputError where there is none, or more than ``most`` bytes."""
    path = regular(path, kind)
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        raise InputError(f"{kind} file {str(path)!r} cannot be read: {error.strerror}") from None
    if len(content) > most:
        raise InputError(f"{kind} file {str(path)!r} has more than {most} bytes")
    return content


def read_text(path: str | Path, kind: str, *, most: int = LARGEST_TEXT) -> str:
    """Text of a UTF-8 file, with or without a byte order mark; raises as `read_bytes`."""
    try:
        return read_bytes(path, kind, most=most).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{kind} file {str(path)!r} cannot be read: it is not UTF-8 text") from None


def read_json(path: str | Path, kind: str) -> Any:
    """Tree of a JSON file (`trees.from_json`); the error begins with the file."""
    text = read_text(path, kind)
    try:
        return trees.from_json(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def digest(content: bytes | Path) -> str:
    """Hash of bytes, or of the content of a file: 32 hexadecimal digits of SHA-256."""
    import hashlib

    return hashlib.sha256(content.read_bytes() if isinstance(content, Path) else content).hexdigest()[:32]


def digest_tree(tree: Any) -> str:
    """Hash of what JSON can hold, whatever the order of its keys."""
    return digest(json.dumps(tree, sort_keys=True).encode())


def lock(handle: int) -> bool:
    """Whether an open file could be locked for this process; systems without file locks trust their user.

    The lock ends with the handle, also when the process is killed.
    """
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def named(path: str | Path) -> Path:
    """The path of what will be written; InputError for a name that no list of one name a line can hold."""
    path = checks.path("path", path)
    if any(unicodedata.category(c) in ("Cc", "Zl", "Zp") for c in path.name):
        raise InputError(f"path = {checks.shown(path.name)} holds a line break or control character; leave it out")
    return path


def open_locked(path: Path, what: str) -> int:
    """Open a file for this process alone, making it where it does not exist; returns the handle.

    Raises InputError: it cannot be opened, or another run uses it.
    """
    try:
        handle = os.open(named(path), os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise InputError(f"{what} cannot be written: {error.strerror}") from None
    if not lock(handle):
        os.close(handle)
        raise InputError(f"{what} is in use by another run; wait for it, or take another one")
    return handle


@contextlib.contextmanager
def folder_locked(folder: Path) -> Iterator[None]:
    """Keep a folder for this process alone; InputError where another run uses it, and as `sweep` raises it."""
    check_entries(folder)
    handle = open_locked(folder / ".lock", f"folder {folder}")
    try:
        yield
    finally:
        os.close(handle)  # a killed process gives its lock back, too


@contextlib.contextmanager
def own_folder(folder: Path, inner: Sequence[str], whose: str, check: Callable[[], None]) -> Iterator[None]:
    """Make the folder of a store and those in it, lock it, and delete half-written files of a killed run.

    inner: names of the folders in it.
    whose: "a campaign".
    check: raises InputError where the locked folder holds files of others; nothing is made or deleted before.

    Raises InputError: it cannot be made or written, another run is using it, or an inner folder is a link.
    """
    folders = [make_folder(folder) / name for name in inner]
    for one in folders:
        if one.is_symlink():
            raise InputError(f"{one} is a link; {whose} writes into its own folders: link {folder}")
    with folder_locked(folder):
        check()
        for one in (folder, *folders):
            sweep(make_folder(one))
        yield


def check_own(paths: Iterable[Path], written: Container[Path], whose: str) -> None:
    """InputError where a store would write over a file that is not among those it has written."""
    for path in paths:
        if path not in written and path.exists():
            raise InputError(f"{path} is no file of {whose}; move it, or take another folder")


def sweep(folder: Path) -> None:
    """Delete what killed runs left half-written in a folder that is locked.

    Raises InputError: a link to a file, a pipe or a device in it; what is written there would go elsewhere.
    """
    check_entries(folder)
    for path in folder.iterdir():
        if _TEMPORARY.fullmatch(path.name):
            path.unlink(missing_ok=True)


def check_entries(folder: Path) -> None:
    """InputError unless a folder, of any origin, holds only regular files, folders and links to folders.

    A folder with the name of a file that a store writes is refused, too.
    """
    with os.scandir(folder) as entries:
        for entry in entries:
            what = "a link to a file" if entry.is_symlink() else "a pipe or a device"
            if entry.is_dir() and entry.name.endswith(WRITTEN):
                what = "a folder where a file is written"
            elif entry.is_dir() or entry.is_file(follow_symlinks=False):
                continue
            raise InputError(f"{Path(entry.path)} is {what}; take it out of the folder, or take another folder")


def check_target(path: str | Path) -> Path:
    """Where a file will be written, links followed; InputError without a folder, or where no file could be.

    A name of an open stream is refused, such as /dev/stdout: the file behind it would be replaced.
    """
    path = named(path)
    try:
        if _is_stream(path):
            raise InputError(f"{path} leads to an open file of a process; give the name of a file")
        if path.is_symlink():
            path = _end_of_links(path)
        if not path.parent.is_dir():
            raise InputError(f"{path.parent} is not a folder; make it first to write {path.name}")
        _check_folder(path.parent)
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is a folder or a device; give the name of a file")
        if path.exists() and not os.access(path, os.W_OK):
            raise InputError(f"{path} is write-protected; make it writable, or give another name")
    except OSError as error:  # a name that is too long
        if isinstance(error, FileNotFoundError):
            check_here()
        raise InputError(f"{str(path)[:60]}... cannot be written: {error.strerror}") from None
    return path


def check_here() -> None:
    """InputError where the current folder was deleted: relative names and new processes need one."""
    try:
        os.getcwd()
    except FileNotFoundError:
        raise InputError(DELETED) from None


def _end_of_links(path: Path) -> Path:
    """Where a link leads, to what is there or not; InputError for one that leads back to itself."""
    end = Path(os.path.realpath(path))
    if end.is_symlink():  # without an error: realpath stops at a loop
        raise InputError(f"{path} is a link that leads back to itself; delete it, or give another name")
    return end


def _check_folder(folder: Path) -> None:
    """InputError unless files can be made in a folder: its mode, or a file system that is read-only, forbids that."""
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"folder {folder} cannot be written; make it writable, or take another folder")


def _is_stream(path: Path) -> bool:
    """Whether a path leads to an open file of a process, such as /proc/1/fd/1, itself or by links."""
    for _ in range(LINKS):
        folder = Path(os.path.realpath(path.parent))
        if _STREAMS.fullmatch(str(folder)):
            return True
        if not path.is_symlink():
            break
        path = folder / path.readlink()
    return False


def check_image(path: str | Path) -> None:
    """InputError unless the name ends as one of `IMAGES`, or where the environment sets no date to put into it."""
    ending = checks.path("path", path).suffix.lower()
    if ending not in IMAGES:
        raise InputError(f"{path} does not say what kind of image it is; end it with {', '.join(IMAGES)}")
    if ending in DATED and (given := os.environ.get(DATE)):
        try:
            datetime.fromtimestamp(int(given), UTC)
        except (ValueError, OverflowError, OSError):
            rule = "must be a whole number of seconds since 1970, before the year 10000; mend it, or unset it"
            raise InputError(f"{DATE} = {checks.shown(given)} of the environment {rule}") from None


def write_whole(path: str | Path, write: Callable[[Path], Any]) -> Path:
    """Call ``write`` on a temporary file beside ``path`` and rename it: a reader sees the whole file or none.

    The temporary file goes with an exception, and with SIGTERM where this is the main thread. SIGKILL leaves it; it is
    locked while it is written, so that the next process that writes ``path`` knows and deletes it. A file that is
    replaced keeps its permissions.
    """
    path = check_target(path)
    _delete_leftovers(path)
    temporary = path.with_name(f".{path.stem[:40]}-{os.urandom(8).hex()}{path.suffix}")  # known before it is there
    try:
        with _without(temporary):
            handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
            try:
                lock(handle)
                write(temporary)
            finally:
                os.close(handle)
            temporary.chmod(stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o666 & ~_umask())
            temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):  # a file system that is read-only has an error of its own for this
            temporary.unlink(missing_ok=True)
    return path


@functools.lru_cache(maxsize=64)
def _temporaries(folder: Path) -> tuple[Path, ...]:
    """Temporary files in a folder.

    The folder is listed once per process, because a campaign writes many files.
    """
    with os.scandir(folder) as entries:
        return tuple(Path(entry.path) for entry in entries if _TEMPORARY.fullmatch(entry.name))


def _delete_leftovers(path: Path) -> None:
    """Delete temporary files of an output whose writers no longer live: nobody locks them, or has touched them."""
    name = re.compile(rf"\.{re.escape(path.stem[:40])}-[0-9a-f]{{16}}{re.escape(path.suffix)}")
    for other in _temporaries(path.parent.resolve()):
        with contextlib.suppress(OSError, ImportError):
            import fcntl  # noqa: F401 - without it no lock tells

            if name.fullmatch(other.name) and time.time() - other.lstat().st_mtime > FRESH:
                handle = os.open(other, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
                try:
                    if lock(handle):
                        other.unlink()
                finally:
                    os.close(handle)


@contextlib.contextmanager
def _without(temporary: Path) -> Iterator[None]:
    """Have SIGTERM delete a file before it ends the process, unless the caller handles that signal."""
    main = threading.current_thread() is threading.main_thread()  # no other thread may set a handler
    if not main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(number: int, frame: Any) -> None:
        temporary.unlink(missing_ok=True)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _umask() -> int:
    """The process's file mode mask, which only setting it tells."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def make_folder(path: str | Path) -> Path:
    """Make a folder to write into where it does not exist; InputError when that or writing is not possible."""
    path = named(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"folder {path} cannot be made: {error.strerror}") from None
    _check_folder(path)
    return path
