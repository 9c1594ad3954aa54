"""What a command may write, checked before it works."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from .. import dataset
from ..checks import InputError


def check_outputs(
    outputs: Iterable[Path | None], *, inputs: Iterable[Path | None] = (), images: Iterable[Path | None] = ()
) -> None:
    """InputError unless every output has a folder, is no device, no input and no other output, images an ending."""
    taken = {path.resolve(): "read" for path in inputs if path}
    for path in filter(None, outputs):
        dataset.check_target(path)
        if path.resolve() in taken:
            raise InputError(f"{path} would be {taken[path.resolve()]} and written at once; give it another name")
        taken[path.resolve()] = "written for something else"
    for path in filter(None, images):
        dataset.check_image(path)
