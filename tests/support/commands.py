"""The command line, in this process, which spares a second of imports each time, or in one of its own."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import warnings
from pathlib import Path
from unittest import mock

from thermofem import InputError
from thermofem_cli import main

WIDE = {"COLUMNS": "200"}


def thermofem(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command as `process` does; whatever is neither an answer nor one line of error is raised here."""
    out, err, code = Stream(), Stream(), 0
    with (
        contextlib.chdir(cwd),
        mock.patch.dict(os.environ, WIDE),
        mock.patch.object(sys, "argv", ["thermofem", *arguments]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        warnings.catch_warnings(),
    ):
        warnings.resetwarnings()  # pytest makes them errors
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return subprocess.CompletedProcess(arguments, code, out.text(), err.text())


class Stream(io.TextIOWrapper):
    """What a process writes to a file or a pipe."""

    def __init__(self) -> None:
        super().__init__(io.BytesIO(), encoding="utf-8", newline="\n")

    def text(self) -> str:
        self.flush()
        return self.buffer.getvalue().decode()


def process(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "thermofem", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **WIDE, **environment},
        check=False,
    )


def says_one_line(call):
    """What a call returns; None where it is refused, in one line that is not long."""
    try:
        return call()
    except InputError as error:
        message = str(error)
    assert "\n" not in message
    assert len(message) < 1500
    return None
