"""Compiles coupled/kernel for a wheel, with $CXX or zig; ctypes loads it, so one wheel a platform serves every Python.

KERNEL_TARGET names another platform that zig compiles for, one of `PLATFORMS`; `make wheels` does so for all. What
runs on every x86-64 processor is compiled twice, the second time for x86-64-v3, and `library.py` loads the one that the
processor has (`benchmarks/bench_wheel.py`: up to a fifth less time, as much as a build by zig at home).
"""

import os
import platform
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
        own = os.environ.get("CXX", "").split()
        if target:
            tag, ending = PLATFORMS[target]
            file = folder / f"ring{ending}"
            command = ZIG
            flags = ("-target", target)
            level = ("-mcpu=x86_64_v3",)
            portable = target.startswith("x86_64")
        else:
            tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            file = folder / kernel["NAME"]
            command = own or ZIG
            flags = ()
            level = ("-march=x86-64-v3",)
            portable = bool(own) and platform.machine() in ("x86_64", "AMD64")  # zig compiles for this processor
        made = [kernel["build"](file, flags, command)]
        if portable:
            made.append(kernel["build"](kernel["second_of"](file), (*flags, *level), command))
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{tag}"
        build_data["artifacts"] += [f"/coupled/kernel/{one.name}" for one in made]
