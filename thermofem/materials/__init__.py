"""Materials by name, with sources, and how their properties depend on temperature."""

from .laws import Polynomial, PowerLaw, Table
from .library import Material, find, silicon_film

__all__ = ["Material", "Polynomial", "PowerLaw", "Table", "find", "silicon_film"]
