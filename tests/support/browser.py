"""Headless Chromium for the tests of pages; they are skipped, with the reason, where it is absent."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from contextlib import contextmanager

import pytest

INSIDE = ("file:", "blob:", "data:")
ARGUMENTS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]


@contextmanager
def chromium():
    """A running browser, by Playwright with the Chromium of the system."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as running:
        try:
            browser = running.chromium.launch(executable_path=program, args=ARGUMENTS)
        except playwright.Error as error:
            pytest.skip(f"Chromium does not start: {str(error).splitlines()[0]}")
        yield browser
        browser.close()


@contextmanager
def opened(browser, file, after="", **window):
    """The page of a file, settled; fails on console errors and on any request that leaves the file."""
    context = browser.new_context(bypass_csp=True, **window)
    page = context.new_page()
    problems = []
    page.on("console", lambda message: problems.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: problems.append(request.url) if not request.url.startswith(INSIDE) else None)
    page.goto(file.as_uri() + after)
    settled(page)
    yield page
    assert problems == []
    context.close()


def settled(page, also="true"):
    """Wait until the exact answer stands, and ``also`` holds."""
    exact = "ringPage.shown.trace && ringPage.shown.trace.request.quick === false"
    page.wait_for_function(f"{exact} && ({also})", timeout=90_000)


def run_in_a_shell(block, folder):
    """Run lines that call `python` or `thermofem`, in a folder of their own; what they print."""
    programs = folder / "bin"
    programs.mkdir(exist_ok=True)
    for name, call in (("thermofem", [sys.executable, "-m", "thermofem"]), ("python", [sys.executable])):
        command = programs / name
        command.write_text(f'#!/bin/sh\nexec {shlex.join(call)} "$@"\n')
        command.chmod(0o755)
    path = f"{programs}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["sh", "-ec", block], cwd=folder, check=True, env={**os.environ, "PATH": path}, capture_output=True, text=True
    )
    return done.stdout
