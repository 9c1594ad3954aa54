"""Compiles coupled/kernel for a wheel, with $CXX or zig; ctypes loads it, so one wheel a platform serves every Python.

KERNEL_TARGET names another platform that zig compiles for, one of `PLATFORMS`; `make wheels` does so for all.
"""

import os
import runpy
import sys
import sysconfig
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PLATFORMS = {  # target of zig: tag of the wheel, ending of a library
    "x86_64-linux-gnu.2.17": ("manylinux_2_17_x86_64", ".so"),
    "aarch64-linux-gnu.2.17": ("manylinux_2_17_aarch64", ".so"),
    "x86_64-linux-musl": ("musllinux_1_1_x86_64", ".so"),
    "aarch64-linux-musl": ("musllinux_1_1_aarch64", ".so"),
    "x86_64-macos.11.0": ("macosx_11_0_x86_64", ".dylib"),
    "aarch64-macos.11.0": ("macosx_11_0_arm64", ".dylib"),
    "x86_64-windows-gnu": ("win_amd64", ".dll"),
}
ZIG = [sys.executable, "-m", "ziglang", "c++"]


class KernelHook(BuildHookInterface):
    """Builds the library into the package, and tags the wheel."""

    def initialize(self, version: str, build_data: dict) -> None:
        """Before a wheel, or an editable one, is packed."""
        if self.target_name != "wheel":
            return
        folder = Path(self.root, "coupled", "kernel")
        kernel = runpy.run_path(str(folder / "library.py"))
        target = os.environ.get("KERNEL_TARGET")
        if target:
            tag, ending = PLATFORMS[target]
            made = kernel["build"](folder / f"ring{ending}", ("-target", target), ZIG)
        else:
            tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            own = os.environ.get("CXX", "").split()
            made = kernel["build"](folder / kernel["NAME"], command=own or ZIG)
        build_data["pure_python"], build_data["tag"] = False, f"py3-none-{tag}"
        build_data["artifacts"].append(f"/coupled/kernel/{made.name}")
