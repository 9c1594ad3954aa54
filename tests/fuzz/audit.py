"""The promises about files, tried at random and by kills: `make audit` for minutes, a short run in the tests.

    python tests/fuzz/audit.py [minutes]

1. damage      a result, a journal or a model with a few bytes overwritten is refused or reads as it was written
2. kills       campaigns, maps and `reproduce` killed at random times and started again end with the same result
3. disks       commands whose disk is full after a random number of bytes say so in one line and leave nothing half
4. changes     files written over, replaced and deleted while they are read: a result or one line of InputError
5. trees       seeded random JSON and TOML trees through every reader: a result or one line of InputError

Prints one line for each promise with the counts; exit code 1 where one is broken.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import hostile
import numpy as np
import options

import coupled
import surrogate
import thermofem as th
from coupled.maps.journal import Journal

MAP = """
import sys, thermofem as th, coupled
model = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
found = coupled.pulsing_map(coupled.borghi2021(), model, [2e-3, 4e-3, 6e-3], [-5e9, 0.0, 5e9], duration=2e-6,
                            file=sys.argv[1])
print("\\n".join(found["regime"].values.ravel().tolist()))
"""
REPRODUCE = """
import sys
from pathlib import Path
from thermofem_cli.reproduce import Settings, run
size = Settings(grid=(4, 5), duration=8e-6, scan=1, fitted=5, run=8e-6, loop_every=3, runs=1, repeats=1, cycle=31)
print(run(Path(sys.argv[1]), size, processes=2)["stages"])
"""
CAMPAIGN = """
import sys, thermofem as th
if __name__ == "__main__":
    print(th.Campaign.from_toml(sys.argv[1]).run(sys.argv[2], workers=1))
"""

LIMITED = """
import resource, sys, thermofem_cli
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
del sys.argv[1]
thermofem_cli.main()
"""
WRITERS = [
    "solve strip.toml -o out.nc --paraview out.xdmf --figure out.png", "campaign plan.toml -o out",
    "fit data.nc --kind newton -o out.json --figure out.png", "reduce strip.toml -o out.json",
    "uncertainty ring.family --spread box=1.95um,1nm --samples 2 --points 2,2 --power 3dBm,10dBm "
    "--detuning -30GHz,30GHz --map out.nc",
    "simulate model.json --power 1mW --duration 100ns -o out.nc", "export model.json --to fmu -o out.fmu",
    "map model.json --points 2,2 --duration 10ns -o out.nc --resume out.jsonl", "explore model.json -o out.html",
    "family plan.toml -o out.family --folder out", "cosimulate strip.toml --power 1mW --duration 1ns -o out.nc",
]  # fmt: skip


def damage(count: int, seed: int = 0) -> tuple[int, int]:
    """Damaged models and journals that were read, and how many of them differ from what was written without a word."""
    tried = wrong = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "map.jsonl"
        with Journal(path, {"a": 1}) as journal:
            for row in range(4):
                journal.add(row, [["stable", 1e-6, 0.5, 1.0 + row, ""]])
            rows = dict(journal.rows)
        content = path.read_bytes()
        for broken in hostile.damaged(content, seed, count):
            path.write_bytes(broken)
            tried += 1
            with contextlib.suppress(th.InputError), Journal(path, {"a": 1}) as journal:
                wrong += any(cells != rows.get(row) for row, cells in journal.rows.items())
    return tried, wrong


def models(count: int, seed: int = 0) -> tuple[int, int]:
    """Damaged model files: tried, and those that end in anything but a model or InputError."""
    tried = wrong = 0
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "model.json"
        surrogate.save_model(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), path, provenance={"a": [1, "x"]})
        for broken in hostile.damaged(path.read_bytes(), seed, count):
            path.write_bytes(broken)
            tried += 1
            try:
                surrogate.load_model(path).step_response(np.array([1e-6]))
            except th.InputError:
                pass
            except Exception as error:
                wrong += 1
                print(f"model: {type(error).__name__}: {error}")
    return tried, wrong


def kills(command: Callable[[], list[str]], count: int, longest: float, seed: int = 0) -> tuple[int, str]:
    """Start a command, end it at random times, and let the last start end; returns kills and its output.

    SIGKILL or SIGTERM, to it alone or to its group.
    """
    pick, done = random.Random(seed), 0
    for _ in range(count):
        run = subprocess.Popen(command(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        with contextlib.suppress(subprocess.TimeoutExpired):
            run.wait(pick.uniform(0.2, longest))
        if run.poll() is None:
            how, number = pick.choice(
                [(os.killpg, signal.SIGKILL), (os.kill, signal.SIGKILL), (os.kill, signal.SIGTERM)]
            )
            how(run.pid, number)
            done += 1
        run.wait()
        _wait_for_group(run.pid)
    end = subprocess.run(command(), capture_output=True, text=True, check=False)
    return done, end.stdout if end.returncode == 0 else f"failed: {end.stderr[-500:]}"


def _wait_for_group(group: int) -> None:
    """Wait for the workers of a killed process, which end by themselves; they are ended where they do not."""
    end = time.monotonic() + 10
    with contextlib.suppress(ProcessLookupError, PermissionError):
        while time.monotonic() < end:
            os.killpg(group, 0)
            time.sleep(0.05)
        print(f"workers of {group} go on after it was killed")
        os.killpg(group, signal.SIGKILL)


def killed_maps(count: int, seed: int = 0) -> tuple[int, bool]:
    """Kills of a map, and whether its last start gives what an undisturbed one gives."""
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "rows.jsonl"
        undisturbed = subprocess.run(
            [sys.executable, "-c", MAP, str(Path(name) / "other.jsonl")], capture_output=True, text=True, check=True
        )
        begin = time.monotonic()
        subprocess.run([sys.executable, "-c", MAP, str(Path(name) / "third.jsonl")], capture_output=True, check=True)
        done, found = kills(
            lambda: [sys.executable, "-c", MAP, str(file)], count, 1.2 * (time.monotonic() - begin), seed
        )
        return done, found == undisturbed.stdout


def killed_campaigns(count: int, seed: int = 0) -> tuple[int, bool]:
    """Kills of a campaign, and whether every geometry is finished in the end, none computed in vain twice."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "strip.toml").write_text(th.strip_ring().to_toml())
        vary = '[[vary]]\npath = "material.SiO2.conductivity"\nfrom = "1 W/m/K"\nto = "2 W/m/K"\ncount = 400\n'
        (folder / "plan.toml").write_text(f'geometry = "strip.toml"\n{vary}[[drive]]\npower = "1 mW"\n')
        script = folder / "run.py"
        script.write_text(CAMPAIGN)
        done, found = kills(
            lambda: [sys.executable, str(script), str(folder / "plan.toml"), str(folder / "out")], count, 6.0, seed
        )
        if "failed=0" not in found:
            print(found)
            return done, False
        index = th.open_campaign(folder / "out")
        whole = (index["status"] == "finished").all() and np.isfinite(index["thermal_resistance"]).all()
        return done, bool(whole)


def killed_reproductions(count: int, seed: int = 0) -> tuple[int, bool]:
    """Kills of a small reproduction by two processes, and whether the last start ends with the right table."""
    with tempfile.TemporaryDirectory() as name:
        tables, begin = [], time.monotonic()
        first = subprocess.run(
            [sys.executable, "-c", REPRODUCE, f"{name}/whole"], capture_output=True, text=True, check=True
        )
        longest = max(4.0, 2 * (time.monotonic() - begin) / count)  # what is finished stays: all together take as long
        done, found = kills(lambda: [sys.executable, "-c", REPRODUCE, f"{name}/killed"], count, longest, seed)
        if found.splitlines()[-1:] != first.stdout.splitlines()[-1:]:
            print(found)
            return done, False
        for folder in ("whole", "killed"):
            rows = json.loads((Path(name) / folder / "data" / "table.json").read_text(encoding="utf-8"))
            tables.append([(row["quantity"], row["agrees"]) for row in rows])
            left = [path.name for path in (Path(name) / folder).rglob(".*-*")]
            if left:
                print(f"{folder}: {left} are left")
        return done, tables[0] == tables[1]


def full_disks(count: int, seed: int = 0) -> tuple[int, int]:
    """Commands whose files may grow to a random size: tried, and those without one line or with half a file."""
    pick, wrong = random.Random(seed), 0
    with tempfile.TemporaryDirectory() as name:
        given = Path(name) / "given"
        given.mkdir()
        options.files(given)
        for k in range(count):
            folder, words = Path(name) / str(k), pick.choice(WRITERS)
            shutil.copytree(given, folder)
            most = int(10 ** pick.uniform(0, 5))
            command = [sys.executable, "-c", LIMITED, str(most), *words.split()]
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            said = [line for line in done.stderr.splitlines() if line.startswith("thermofem: ")]
            half = [str(path) for path in folder.rglob(".*-*") if len(path.stem) > 16]
            named = done.returncode == 0 or (
                done.returncode == 2 and len(said) == 1 and "out" in said[0].split(": ")[2]
            )
            if half or not named or "Traceback" in done.stderr:
                wrong += 1
                print(f"{words} with {most} bytes: exit code {done.returncode}, {done.stderr[-300:]!r}, {half} left")
            shutil.rmtree(folder)
    return count, wrong


def changed_files(seconds: float, seed: int = 0) -> tuple[int, int]:
    """Files that change while they are read, for some seconds each: reads, and those that end in another error."""
    readers: dict[str, Callable[[Path], object]] = {
        "model.json": surrogate.load_model,
        "ring.family": surrogate.load_family,
        "strip.toml": th.CrossSection.from_toml,
        "ring.toml": coupled.RingResonator.from_toml,
        "data.nc": th.load,
        "copy.nc": th.dataset.load_record,
        "ring.msh": th.mesh.load,
        "table.csv": lambda path: th.read_trace(path, th.Constant(1e-3)),
    }
    tried, wrong, hook = 0, list[str](), sys.unraisablehook
    sys.unraisablehook = lambda unraisable: wrong.append(f"ignored: {unraisable.exc_value}")
    logging.disable(logging.WARNING)  # the log tells of files that were changed
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            options.files(folder)
            shutil.copy(folder / "data.nc", folder / "copy.nc")
            th.mesh.mesh_for(th.strip_ring(), 1e-3).save(folder / "ring.msh")
            for file, read in readers.items():
                end = time.monotonic() + seconds
                with hostile.changing(folder / file, seed):
                    while time.monotonic() < end:
                        tried += 1
                        try:
                            read(folder / file)
                        except th.InputError:
                            pass
                        except Exception as error:
                            wrong.append(f"{file}: {type(error).__name__}: {error}")
    finally:
        sys.unraisablehook = hook
        logging.disable(logging.NOTSET)
    for text in dict.fromkeys(wrong):
        print(text)
    return tried, len(wrong)


def random_trees(count: int, seed: int = 0) -> tuple[int, int]:
    """Random trees through the readers of models and waveforms: tried, and those that end in another error."""
    tried = wrong = 0
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "x.json"
        for text in hostile.trees(seed, count):
            path.write_text(text, encoding="utf-8", errors="surrogatepass")
            head = json.dumps({"format": "thermofem thermal model", "schema": 1})[:-1]
            both = [text, head + ", " + text[1:] if text.startswith('{"') else text]
            for content in both:
                path.write_text(content, encoding="utf-8", errors="surrogatepass")
                for read in (lambda: surrogate.load_model(path), lambda: th.waveforms.from_json(content)):  # noqa: B023
                    tried += 1
                    try:
                        read()
                    except th.InputError:
                        pass
                    except Exception as error:
                        wrong += 1
                        print(f"tree: {type(error).__name__}: {error}: {content[:200]!r}")
    return tried, wrong


def main(minutes: float) -> int:
    """Run everything, the kills for about ``minutes``; the number of broken promises."""
    broken = 0
    scale = max(1, round(minutes))
    for what, (tried, wrong) in {
        "damaged journals": damage(400 * scale),
        "damaged models": models(400 * scale),
        "full disks": full_disks(10 * scale),
        "changed files": changed_files(2.0 * scale),
        "random trees": random_trees(1000 * scale),
    }.items():
        print(f"{what}: {tried} tried, {wrong} wrong")
        broken += bool(wrong)
    for what, (done, whole) in {
        "maps": killed_maps(2 * scale),
        "campaigns": killed_campaigns(2 * scale),
        "reproductions": killed_reproductions(scale),
    }.items():
        print(f"{what}: {done} kills, {'nothing lost' if whole else 'LOST'}")
        broken += not whole
    return broken


if __name__ == "__main__":
    sys.exit(bool(main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)))
