"""Results on disk that a later run may trust: kept under what made them, and checked before they are believed.

    data/<stage>.json           the stage's key, its numbers, the hash of every file beside it, and a hash of all this;
                                written last
    data/<stage>.<name>.nc      its data
    data/<stage>.<name>.json    its models

A key is a hash of the stage's name, the settings it uses, the keys of its inputs, and the code and libraries that
computed it. Whatever has another key, another hash, or cannot be read is computed again.
"""

from __future__ import annotations

import functools
import hashlib
import json
import platform
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from thermofem.data import dataset, files

if TYPE_CHECKING:
    import xarray as xr

    from thermofem.models import ThermalModel

T = TypeVar("T")
FORMAT = 2
HASH = "content_hash"  # of a manifest
WORDS = ("claims", "page", "plan", "project", "run", "sections", "workers", "written")  # modules that compute nothing
LIBRARIES = ("numpy", "scipy", "scikit-fem", "numba", "pysindy")


@dataclass(frozen=True)
class Result:
    """Result of a stage: numbers (any JSON value), data and thermal models by name, and the CPU seconds."""

    numbers: Mapping[str, Any] = field(default_factory=dict)
    data: Mapping[str, xr.Dataset] = field(default_factory=dict)
    models: Mapping[str, ThermalModel] = field(default_factory=dict)
    seconds: float = 0.0


class Stored(Mapping[str, T]):
    """Files by name, each read when it is first used: most processes need few of them."""

    def __init__(self, paths: Mapping[str, Path], read: Callable[[Path], T]) -> None:
        self._paths = paths
        self._get = functools.cache(lambda name: read(paths[name]))

    def __getitem__(self, name: str) -> T:
        return self._get(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)


@dataclass(frozen=True)
class StageStore:
    """The folder of a reproduction's data; ``note`` is told of the files before they are written."""

    folder: Path
    note: Callable[..., None] = lambda *paths: None

    def manifest(self, stage: str) -> Path:
        """Manifest of a stage's results."""
        return self.folder / f"{stage}.json"

    def load(self, stage: str, key: str) -> Result | None:
        """Read the result of a stage; None where it is incomplete, damaged or has another key."""
        import surrogate

        try:
            content = files.read_json(self.manifest(stage), "manifest")
            if content.pop(HASH) != files.digest_tree(content) or (content["format"], content["key"]) != (FORMAT, key):
                return None
            paths = {name: self.folder / name for name in content["files"]}
            if any(files.digest(path) != content["files"][name] for name, path in paths.items()):
                return None
            seconds = float(content["cpu_seconds"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        data, models = (
            {path.name[len(stage) + 1 : -len(end)]: path for path in paths.values() if path.name.endswith(end)}
            for end in (".nc", ".json")
        )
        return Result(content["numbers"], Stored(data, dataset.load), Stored(models, surrogate.load_model), seconds)

    def save(self, stage: str, key: str, result: Result, seconds: float) -> Result:
        """Write a result, its manifest last, and return the result as a later run would read it."""
        import surrogate

        manifest, provenance = self.manifest(stage), {"stage": stage, "key": key}
        data = {self.folder / f"{stage}.{name}.nc": one for name, one in result.data.items()}
        models = {self.folder / f"{stage}.{name}.json": one for name, one in result.models.items()}
        self.note(manifest, *data, *models)
        manifest.unlink(missing_ok=True)
        written = [dataset.save(one, path) for path, one in data.items()]
        written += [surrogate.save_model(one, path, provenance=provenance) for path, one in models.items()]
        numbers = json.loads(json.dumps(files.plain(result.numbers)))
        content = {
            "format": FORMAT,
            "stage": stage,
            "key": key,
            "cpu_seconds": seconds,
            "files": {path.name: files.digest(path) for path in written},
            "numbers": numbers,
        }
        text = json.dumps({**content, HASH: files.digest_tree(content)}, indent=1, allow_nan=False) + "\n"
        files.write_whole(manifest, lambda path: path.write_text(text, encoding="utf-8"))
        return Result(numbers, result.data, result.models, seconds)


def slug(name: str) -> str:
    """A name as part of a file name: 'second order, 1 µs' becomes 'second_order_1_µs'."""
    return re.sub(r"[^\w.+-]+", "_", name.replace("'", "")).strip("_")


def key_of(stage: str, settings: Mapping[str, Any], inputs: Iterable[str]) -> str:
    """Hash of everything that decides a stage's result."""
    return files.digest_tree([FORMAT, stage, files.plain(dict(settings)), list(inputs), _code()])


def computes(path: Path) -> bool:
    """Whether a source file may change a number; commands, figures and text do not."""
    return path.parent.name not in ("cli", "plot") and path.stem not in WORDS and not path.name.startswith("plot")


@functools.cache
def _code() -> str:
    """Hash of the package's sources, without those of figures and text, and of the libraries' versions."""
    import coupled
    import surrogate

    roots = [Path(__file__).parents[2], *(Path(str(m.__file__)).parent for m in (coupled, surrogate))]
    sources = [path for root in roots for path in sorted(root.rglob("*.py"))]
    digest = hashlib.sha256()
    for path in filter(computes, sources):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest() + json.dumps([platform.python_version(), *(version(name) for name in LIBRARIES)])
