"""Output files of a command, checked before any work; the ring and the model of its options."""

from __future__ import annotations

import contextlib
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import files, quantity

from .apart import both, check_unread
from .kinds import expect
from .output import hold
from .output import working as working

if TYPE_CHECKING:
    from coupled import RingResonator
    from thermofem.geometry import CrossSection
    from thermofem.models import ThermalModel

DEFAULT_RING = "borghi2021"


def check_outputs(outputs: Iterable[Path | None], *, images: Iterable[Path | None] = ()) -> None:
    """InputError unless every output can be written, is no input and no other output, and images have an ending."""
    taken: list[Path] = []
    for path in filter(None, outputs):
        files.check_target(path)
        check_unread(path)
        for other in taken:
            if twice := both(path, other) or both(other, path):
                raise InputError(f"{twice} would be written twice; give it another name")
        taken.append(path)
    for path in filter(None, images):
        files.check_image(path)


@contextlib.contextmanager
def about(paths: Sequence[Path]) -> Iterator[None]:
    """Name the file in an InputError that does not; of several files those that it calls ``data[0]``, ``data[1]``."""
    try:
        yield
    except InputError as error:
        if any(str(path) in str(error) for path in paths) or error.rule.startswith("--"):
            raise
        if len(paths) > 1:
            raise InputError(re.sub(r"\bdata\[(\d+)\]", lambda k: str(paths[int(k[1])]), error.for_text())) from None
        raise InputError(f"{paths[0]}: {error.for_text()}") from None


def section_of(path: Path | None) -> CrossSection:
    """The geometry of a file, or the reference strip."""
    from thermofem.geometry import CrossSection, strip_ring

    return CrossSection.from_toml(path) if path else strip_ring()


def ring_of(given: str) -> RingResonator:
    """The ring of a file, or one that comes with the package."""
    import coupled

    named: dict[str, Callable[[], RingResonator]] = {
        "borghi2021": coupled.borghi2021,
        "borghi2021-lumped": lambda: coupled.borghi2021().with_lumped_fcd(),
        "vanvaerenbergh2012": coupled.vanvaerenbergh2012,
    }
    if given not in named and not Path(given).is_file():
        raise InputError(f"--ring = {given!r} is neither a file nor one of {', '.join(named)}")
    if given in named:
        return named[given]()
    expect(Path(given), "ring")
    return coupled.RingResonator.from_toml(given)


def say_ring(ring: RingResonator, given: str) -> None:
    """Name the ring on the terminal before the next words: a thermal model has no optics and carriers of its own."""
    hint = "; --ring RING.toml takes those of yours" if given == DEFAULT_RING else ""
    hold(f"light and carriers are those of the ring {ring.name!r}{hint}")


def longer(duration: float) -> str:
    """Hint at a longer run where this one ended in a transient; ``duration`` in s, of `thermal.long_enough`."""
    return f'try --duration "{quantity.write(duration, "s")}": ten times what a step of this heat takes to 95 %'


def in_volts(assumed: Any) -> bool:
    """Whether a model was trained on a voltage without the sensitivity of the thermometer; ``assumed`` of its file."""
    if not isinstance(assumed, list):
        return False
    from thermofem.data.column_units import VOLTS

    return any(VOLTS in str(line) for line in assumed)


def model_of(
    path: Path, heated: str | None = None, read: str | None = None, heaters: Iterable[str] = ()
) -> tuple[ThermalModel, dict[str, Any]]:
    """Read a thermal model, and check the names of the parts that the light heats and that are read.

    Raises InputError: no model; several inputs or outputs and no choice, or a name that is none of them.
    """
    from thermofem.models import load_model

    model: ThermalModel = load_model(path)
    if in_volts((getattr(model, "origin", None) or {}).get("assumed")):
        hold(f"warning: {path} was trained on a voltage that counts as kelvin; train it with `fit --sensitivity`")
    for option, given, names in (("--heated", heated, model.inputs), ("--read", read, model.outputs)):
        if given is not None:
            checks.choice(option, given, names)
    several = len(model.inputs) > 1 or len(model.outputs) > 1
    if several and heated is None and not list(heaters):
        first, other = shlex.quote(model.inputs[0]), shlex.quote(f"{model.inputs[-1]}=5 mW")
        raise InputError(
            f"{path} has several parts (inputs {', '.join(model.inputs)}; outputs {', '.join(model.outputs)}): pick "
            f"the one that the light heats with --channel {first} (or --heated and --read), and give others "
            f"power with --heater {other}"
        )
    return model, {"heated": heated, "read": read}


def one_channel(path: Path, heated: str | None, read: str | None) -> ThermalModel:
    """The thermal model of a file; of one with several parts the channel that is asked for.

    Raises InputError: no model; several parts and no choice, or a name that is none of them.
    """
    from thermofem.models import load_model

    model: Any = load_model(path)
    if len(model.inputs) == len(model.outputs) == 1:
        return model
    if heated is None:
        parts = f"inputs {', '.join(model.inputs)}; outputs {', '.join(model.outputs)}"
        raise InputError(f"{path} has several parts ({parts}): pick two with --heated and --read")
    checks.choice("--heated", heated, model.inputs)
    read = checks.choice("--read", read or heated, model.outputs)
    return model.channel(heated, read)
