"""Whether gmsh can be loaded, and which packages are missing if not."""

from __future__ import annotations

import ctypes
import importlib
import re

# shared libraries that the gmsh wheel links to, and the Debian package that brings each
_PACKAGES = {
    "libGLU.so.1": "libglu1-mesa",
    "libGL.so.1": "libgl1",
    "libOpenGL.so.0": "libopengl0",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXrender.so.1": "libxrender1",
    "libXcursor.so.1": "libxcursor1",
    "libXfixes.so.3": "libxfixes3",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
    "libfontconfig.so.1": "libfontconfig1",
    "libgomp.so.1": "libgomp1",
}


def _loads(library: str) -> bool:
    """Whether a shared library is on the machine."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def gmsh_problem() -> str | None:
    """None where gmsh and pygmsh can be loaded; otherwise one line with the missing library and how to install it."""
    remedy = "the committed meshes of the reference cross-sections work without it"
    for module in ("gmsh", "pygmsh"):
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            package = error.name
            missing, brings = f"the Python package {package}", f"pip install {package}"
        except (ImportError, OSError) as error:
            library = re.match(r"(lib[\w.+-]+?\.so[.\d]*)", str(error))
            if library is None:
                return f"{module} cannot be loaded: {error}; {remedy}"
            missing = f"the shared library {library[1]}"
            absent = [known for known in _PACKAGES if known == library[1] or not _loads(known)]  # the loader names one
            packages = " ".join(_PACKAGES[known] for known in absent)
            named = library[1] in _PACKAGES
            brings = f"Debian, Ubuntu: apt-get install {packages}" if named else "apt-file search finds its package"
        else:
            continue
        return f"{module} cannot be loaded: {missing} is missing ({brings}); {remedy}"
    return None
