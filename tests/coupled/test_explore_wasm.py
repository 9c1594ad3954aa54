"""The committed kernel of the page is that of the sources."""

from __future__ import annotations

from importlib import metadata

import pytest

from coupled.explore import bundle

ZIG = "0.17.1"  # that compiled the committed file; others order its functions differently


@pytest.mark.slow
def test_the_committed_module_is_that_of_the_sources(tmp_path):
    versions = [each.version for each in metadata.distributions(name="ziglang")]
    if versions != [ZIG]:
        pytest.skip(f"needs ziglang {ZIG}")
    bundle.compile_kernel(tmp_path / "kernel.wasm")
    assert (tmp_path / "kernel.wasm").read_bytes() == (bundle.HERE / "page/kernel.wasm").read_bytes()
