"""The structures that Python fills, against the offsets that the C++ compiler has."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import pytest

from coupled.kernel import library as structures
from coupled.kernel.library import SOURCES, library


def test_every_field_lies_where_the_kernel_has_it():
    assert structures.kernel_layout(library()) == structures.python_layout()


def test_the_table_of_the_kernel_has_every_field_of_the_headers():
    """By the text of the headers: a name that layout.cpp lacks would be compared with nothing."""
    listed = {name for name in structures.kernel_layout(library()) if "." in name}
    headers = {"Problem": "equations.hpp", "Loop": "loop.hpp", "Method": "equations.hpp", "ReturnMap": "kernel.hpp"}
    for structure, header in headers.items():
        text = Path(SOURCES, header).read_text()
        body = re.sub(r"//.*", "", re.search(rf"struct {structure} {{(.*?)\n}};", text, re.DOTALL)[1])
        fields = re.findall(r"(\w+)\s*(?=[,;])", body)
        assert len(fields) > 5
        assert {f"{structure}.{field}" for field in fields} <= listed


@pytest.mark.parametrize("name", structures.STRUCTURES)
def test_a_field_added_in_the_middle_is_reported_at_load(name, monkeypatch):
    before, after = structures.STRUCTURES[name]._fields_[:1], structures.STRUCTURES[name]._fields_[1:]
    shifted = type(name, (ctypes.Structure,), {"_fields_": [*before, ("added", ctypes.c_int64), *after]})
    monkeypatch.setitem(structures.STRUCTURES, name, shifted)
    with pytest.raises(RuntimeError, match=rf"{name}\.added"):
        structures.check_layout(library())
