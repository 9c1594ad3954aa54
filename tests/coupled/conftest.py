"""What the tests of the page share."""

from __future__ import annotations

import pytest
from browser import chromium


@pytest.fixture(scope="module")
def browser():
    """One Chromium for all tests of a file."""
    with chromium() as running:
        yield running
