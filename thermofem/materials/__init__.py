"""Materials by name, with sources, and how their properties depend on temperature.

The package lists itself: ``print(th.materials)``, ``list(th.materials)``, ``th.materials["Si"]``, and a table with the
sources in a notebook.
"""

import sys as _sys
from collections.abc import Iterator as _Iterator
from types import ModuleType as _ModuleType

from .material_laws import INDEX_LAWS, IndexTable, Polynomial, PowerLaw, Sellmeier, Table, constant_index
from .material_library import LIBRARY, Material, find, silicon_film

__all__ = [
    "INDEX_LAWS", "LIBRARY", "IndexTable", "Material", "Polynomial", "PowerLaw", "Sellmeier", "Table",
    "constant_index", "find", "silicon_film",
]  # fmt: skip


class _Listed(_ModuleType):
    """This package as a mapping from names to materials, void left out."""

    def __getitem__(self, name: str) -> Material:
        return find(name)

    def __iter__(self) -> _Iterator[str]:
        return (name for name in LIBRARY if name != "void")

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __repr__(self) -> str:
        from ..data.display import materials_text

        return materials_text(map(find, self))

    def _repr_html_(self) -> str:
        """HTML for notebooks."""
        from ..data.display import materials_text

        return materials_text(map(find, self), html=True)


_sys.modules[__name__].__class__ = _Listed  # Python's data model: "customizing module attribute access"
