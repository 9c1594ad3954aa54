"""What the tests of the page share."""

from __future__ import annotations

import pytest
from browser import chromium

from coupled.explore import bundle


@pytest.fixture(scope="module")
def browser():
    """One Chromium for all tests of a file."""
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def js(browser):
    """A function that evaluates a JavaScript function with an argument, in a page that holds the modules."""
    page = browser.new_page()
    page.goto("about:blank")
    page.evaluate("globalThis.d3 = {}; document.addEventListener = () => {};")  # the page itself is not started
    source = bundle.script().replace("else start();", "")
    page.evaluate(f"() => {{ {source} }}")
    page.evaluate("kernel => globalThis.ringPage.loadKernel(kernel)", bundle.kernel())
    return page.evaluate
