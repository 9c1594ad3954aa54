"""Commands whose worker processes are killed, as where memory runs out, and commands that are ended themselves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from campaigns import marks, write
from commands import thermofem
from processes import helpers, wait_for

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc"),
]
FAMILY = ("family", "rings.toml", "--tolerance", "1e-3", "--workers", "2")
CAMPAIGN = ("campaign", "campaign.toml", "-o", "out", "--workers", "2")
LIMIT = 60.0  # s


@pytest.fixture
def folder(tmp_path):
    write(tmp_path, 60)
    vary = 'path = "layer.box.thickness"\nfrom = "1 um"\nto = "3 um"\n'
    more = 'path = "part.core.radius"\nfrom = "5 um"\nto = "9 um"\n'
    (tmp_path / "rings.toml").write_text(f'geometry = "ring.toml"\n[[vary]]\n{vary}[[vary]]\n{more}')
    return tmp_path


@pytest.fixture(autouse=True)
def interruptible():
    """Processes that are started hear Ctrl-C, also where the tests run in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def start(folder: Path, *arguments: str, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "thermofem", *arguments],
        cwd=folder,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and standard error; no process of the command outlives it."""
    try:
        _, said = process.communicate(timeout=LIMIT)
        return process.returncode, said
    finally:
        process.kill()


def kill(pids: list[int]) -> None:
    for pid in pids:
        os.kill(pid, signal.SIGKILL)


def working(process: subprocess.Popen[str], folder: Path) -> bool:
    """Whether results come, or the command has ended."""
    return len(list(folder.glob("parts/*.npz"))) + len(marks(folder / "out")) > 1 or process.poll() is not None


def of_family(path: Path) -> dict:
    """What a family file holds, beside how long it took."""
    with np.load(path) as found:
        arrays = {name: array.tolist() for name, array in found.items() if name != "hash"}
    header = json.loads(str(arrays["header"]))
    del header["provenance"]["seconds"]
    return arrays | {"header": header}


def test_a_training_survives_a_killed_worker(folder):
    """Promise 7: its task is tried again."""
    assert end(start(folder, *FAMILY, "-o", "whole.json"))[0] == 0
    training = start(folder, *FAMILY, "--folder", "parts")
    wait_for(lambda: working(training, folder))
    kill(helpers(training.pid, "worker")[:1])
    code, said = end(training)
    assert (code, said) == (0, "")
    assert of_family(folder / "family.json") == of_family(folder / "whole.json")


@pytest.mark.parametrize("words", ["cannot be made", "no file of a campaign", "rim"])
def test_a_refused_campaign_is_one_line(folder, words):
    """A line of progress stood above it."""
    if words == "cannot be made":
        (folder / "out").write_text("")
    elif words == "rim":
        with (folder / "campaign.toml").open("a") as file:
            file.write('[probes]\nheated = "rim"\n')
    else:
        (folder / "out").mkdir()
        (folder / "out" / "index.nc").write_text("precious")
    done = thermofem(*CAMPAIGN, cwd=folder)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert words in done.stderr
