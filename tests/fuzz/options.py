"""Every option of every command with hostile values: an answer, or one line and exit code 2.

    python tests/fuzz/options.py [minutes [seed]]

Commands run in this process, in a folder that holds one valid file of each kind. Prints each failure once, the calls
that take longer than `LONGEST` among them; the exit code is then 1.
"""

from __future__ import annotations

import random
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import typer

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]

from commands import thermofem  # noqa: E402 - in the folder of the tests
from targets import MODEL, small_family  # noqa: E402 - beside this file

import surrogate  # noqa: E402
import thermofem as th  # noqa: E402
import thermofem_cli as cli  # noqa: E402

LONGEST = 60  # CPU s of one call: a loaded machine takes no longer
STUCK = 900  # s after which a call waits for something that does not come
LEFT_OUT = ("reproduce", "doctor")
COMMANDS: dict[str, Any] = typer.main.get_command(cli.app).commands  # type: ignore[attr-defined]
BASE = {
    "solve": ["strip.toml", "--power", "1 mW", "--pulse", "1 us"],
    "campaign": ["plan.toml"],
    "fit": ["data.nc", "--kind", "newton"],
    "reduce": ["strip.toml"],
    "validate": ["strip.toml", "model.json", "--power", "1 mW"],
    "family": ["plan.toml"],
    "design": ["ring.family", "--resistance", "8000 K/W"],
    "uncertainty": ["ring.family", "--spread", "box=1.95 um,1 nm", "--samples", "2"],
    "calibrate": ["ring.family", "data.nc"],
    "simulate": ["model.json", "--power", "1 mW", "--duration", "10 ns"],
    "map": ["model.json", "--points", "2, 2", "--duration", "10 ns"],
    "stability": ["model.json", "--points", "2, 2"],
    "cosimulate": ["strip.toml", "--power", "1 mW", "--duration", "1 ns"],
    "explore": ["model.json"],
    "show": ["model.json"],
    "export": ["model.json", "--to", "csv"],
    "cite": [],
}
ODD = "q\udcff.json"  # a name that is not UTF-8
VALUES = [
    "", " ", "x", "-", "--", "0", "1", "2", "-1", "1.5", "nan", "inf", "1e400", "-1e400", "9" * 400, "1_0", "١",
    "1e-300",
    "1e300", "0 W", "1 mW", "-1 mW", "1e-320 W", "1 K", "1 us", "-1 us", "0 s", "1e9 s", "1 ns, 2 ns", "1 GHz",
    "-30 GHz, 30 GHz", "3 dBm, 10 dBm", "10 dBm, 3 dBm", "1e300 GHz", "2, 2", "1e9, 1e9", "1000000000, 2", "-1, 2",
    "a=b", "core", "core=1 mW", "box=1.95 um", "layer.box.thickness", "\n", "a\nb", "\x1b[31m", "[red]", "é", "\u202e",
    "1 mW*9**9**9**9", "1099511627776", "4611686018427387904", ".", "/dev/null", "/dev/full", "/nowhere/x.nc",
    "model.json", "ring.toml", "strip.toml", "plan.toml", "data.nc", "table.csv", "ring.family", "out.nc", "out.json",
    "out.png", "out.html", "out.toml", "x" * 300, "/dev/stdout", "/dev/fd/2", "out.pvd", "a&b.pvd", ODD, "a/b=1",
]  # fmt: skip
DEFAULTS = {str(p.default) for command in COMMANDS.values() for p in command.params if p.default is not None}


def files(folder: Path) -> None:
    """One valid file of each kind."""
    surrogate.save_model(MODEL, folder / "model.json")
    strip = th.strip_ring(outer_radius=30e-6, substrate=10e-6)
    (folder / "strip.toml").write_text(strip.to_toml())
    (folder / "ring.toml").write_text('base = "borghi2021"\n[carriers]\nlifetime = "10 ns"\n')
    vary = '[[vary]]\npath = "layer.box.thickness"\nfrom = "1.9 um"\nto = "2 um"\ncount = 2\n'
    (folder / "plan.toml").write_text(f'geometry = "strip.toml"\n{vary}[[drive]]\npower = "1 mW"\n')
    family = small_family()
    family.save(folder / "ring.family")
    t = np.linspace(0, 1e-5, 60)
    rise = family.at({"box": 1.95e-6}).response(th.Constant(1e-3), t)
    th.save(th.dataset.build(t, rise, th.Constant(1e-3)), folder / "data.nc")
    (folder / "table.csv").write_text("Time (us),T (K)\n" + "".join(f"{k},{k % 7}\n" for k in range(40)))
    surrogate.save_model(MODEL, folder / ODD)
    for name in ("model.csv", "model.cir", "model.va", "model.mat", "model.fmu", "out_0000.vtu"):
        (folder / name).write_text("of the user\n")


def jobs(seed: int) -> Iterator[list[str]]:
    """Commands with one option more, or one argument replaced, in random order and without end."""
    pick = random.Random(seed)
    while True:
        name = pick.choice(list(BASE))
        options = [p for p in COMMANDS[name].params if p.name != "help"]
        option, value, base = pick.choice(options), pick.choice(VALUES), list(BASE[name])
        if option.param_type_name == "argument":
            yield [name, *([value, *base[1:]] if base else [value])]
        elif option.is_flag:
            yield [name, *base, option.opts[0]]
        else:
            yield [name, *base, option.opts[0], value]


def _late(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"takes more than {LONGEST} CPU s" if number == signal.SIGPROF else f"waits for {STUCK} s")


def failure(arguments: list[str], folder: Path) -> str:
    """What is wrong with a call; empty where nothing is."""
    before = {path.name for path in folder.iterdir()}
    signal.signal(signal.SIGPROF, _late)
    signal.signal(signal.SIGALRM, _late)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    signal.alarm(STUCK)
    try:
        done = thermofem(*arguments, cwd=folder)
    except Exception as error:
        return f"{type(error).__name__}: {error}"[:300]
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0)
    new = {path.name for path in folder.iterdir()} - before
    if [name for name in new if name.startswith(".") and name != ".lock"]:
        return f"leaves {sorted(new)}"
    lines = [line for line in done.stderr.splitlines() if line.startswith("thermofem: ")]
    if done.returncode not in (0, 2) or (done.returncode == 2) != (len(lines) == 1):
        return f"exit code {done.returncode}: {done.stderr[-300:]!r}"
    return ""


def main(minutes: float, seed: int = 0) -> int:
    """Call commands until the time is over; the number of failures."""
    end, done, found = time.monotonic() + 60 * minutes, 0, dict[str, list[str]]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files(folder)
        given = {path: path.read_bytes() for path in folder.iterdir()}
        for arguments in jobs(seed):
            if time.monotonic() > end:
                break
            wrong, done = failure(arguments, folder), done + 1
            for path, content in given.items():  # an output may have any of their names
                if path.read_bytes() != content:
                    path.write_bytes(content)
                    if not any(path.name in one for one in arguments) and path.name not in DEFAULTS:
                        wrong = wrong or f"replaces {path.name}, which nobody named"
            if wrong and wrong not in found:
                found[wrong] = arguments
                print(f"{arguments!r:.300}: {wrong}".encode("ascii", "backslashreplace").decode(), flush=True)
    print(f"{done} calls, {len(found)} failures")
    return len(found)


if __name__ == "__main__":
    numbers = [float(text) for text in sys.argv[1:3]]
    sys.exit(bool(main(numbers[0] if numbers else 10.0, int(numbers[1]) if len(numbers) > 1 else 0)))
