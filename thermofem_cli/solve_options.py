"""Options of several commands: the heating waveform (--power, --pulse, --square, --duty), and --field-times."""

from __future__ import annotations

from typing import TYPE_CHECKING

from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import quantity

from .output import note
from .values import naming

if TYPE_CHECKING:
    from thermofem import waveforms


def waveform(power: str, pulse: str | None, square: str | None, duty: float | None) -> waveforms.Waveform:
    """The heating waveform that the options describe: a step, unless one of the others is given."""
    from thermofem import waveforms

    watts = quantity.not_negative(power, "W", name="--power")
    if pulse and square:
        raise InputError(f"--pulse {pulse} and --square {square} exclude each other; give one")
    if duty is not None and not square:
        raise InputError(f"--duty {duty} goes with --square: a pulse or a step has no duty cycle")
    if duty is not None:
        checks.between("--duty", duty, 0, 1, hint="the duty cycle is the fraction of the period that is on")
    if pulse:
        width = quantity.positive(pulse, "s", name="--pulse")
        with naming(f"--power {power} with --pulse {pulse}"):
            return waveforms.Pulse(watts, width)
    if square:
        period, share = quantity.positive(square, "s", name="--square"), 1 / 3 if duty is None else duty
        with naming(f"--power {power} with --square {square}"):
            return waveforms.SquareWave(watts, period, share)
    with naming(f"--power {power}"):
        return waveforms.Constant(watts)


def note_unseen_end(pulse: str | None, square: str | None, wave: waveforms.Waveform, duration: float) -> None:
    """Say where the power of --pulse or --square does not change before --duration ends."""
    if (pulse or square) and not wave.breakpoints(0.0, duration).size:
        given = f"--pulse {pulse}" if pulse else f"--square {square}"
        note(f"{given} is on all through --duration {quantity.write(duration, 's')}: the result is that of a step")


def times_of(texts: list[str]) -> tuple[float, ...]:
    """The times in s of --field-times '1 us, 5 us', which may be repeated; in order."""
    given = [part.strip() for text in texts for part in text.split(",") if part.strip()]
    if texts and not given:
        raise InputError(f"--field-times {texts[0]!r} names no time; give '1 us' or '1 us, 5 us'")
    return tuple(sorted(quantity.parse(text, "s", name="--field-times") for text in given))
