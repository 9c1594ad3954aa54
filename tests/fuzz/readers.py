"""Fuzzing of all that reads text: random edits of valid files.

    python tests/fuzz/readers.py [minutes [seed]]

Every input ends in a result or in an `InputError` of one line. Whatever else comes up is printed with its input; the
exit code is then 1.
"""

from __future__ import annotations

import logging
import random
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import hostile
from reading import READERS, valid

import thermofem as th

WORDS = [
    *hostile.BREAKS, *hostile.ODD, *hostile.numbers(), "1", "-1", "0.5", "1e-9", "-0.0", "1e-30", "true", "null", '""',
    '"0 nm"', '"-3 um"', '"1e30 m"', '"8 dBm"', '"5 degC"', '"80 deg"', '"void"', '"Si"', '"core"', "heated", "radius",
    "[", "]", "{", "}", "[[part]]", "[[layer]]", "=", ",", ":", ".", "#", "R", "tau", "poles", "kind", "from", "count",
    *(f'"{unit}"' for unit in hostile.units() if len(unit) < 200),
]  # fmt: skip


def edited(text: str, pick: random.Random) -> str:
    """The text with one to four pieces replaced by words, copied, or cut out."""
    for _ in range(pick.randint(1, 4)):
        start = pick.randrange(len(text) + 1)
        stop = min(len(text), start + pick.choice([0, 1, 3, 10, 40]))
        new = pick.choice([pick.choice(WORDS), "", text[start:stop] * 2])
        text = text[:start] + new + text[stop:]
    return text


def fuzz(seconds: float, seed: int, folder: Path) -> list[str]:
    """Edit valid files for so long; a description of each failure."""
    pick, failures, texts = random.Random(seed), [], valid(folder)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        name = pick.choice([*texts])
        text = edited(texts[name], pick)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                READERS[name](text, folder)
        except th.InputError as error:
            if "\n" in str(error) or len(str(error)) > 1500:
                failures.append(f"{name}: {text!r}: a message of several lines: {error}")
        except Exception:
            failures.append(f"{name}: {text!r}\n{traceback.format_exc(limit=-3)}")
    return failures


if __name__ == "__main__":
    logging.disable(logging.WARNING)
    minutes, seed = (float(a) for a in [*sys.argv[1:], "60", "0"][:2])
    with tempfile.TemporaryDirectory() as folder:
        found = fuzz(60 * minutes, int(seed), Path(folder))
    print("\n\n".join(found) or "nothing found")
    sys.exit(bool(found))
