"""The structures that Python fills for the kernel, and the check that C++ lays them out in the same way.

Fields stand in the order of `equations.hpp`, `loop.hpp` and `kernel.hpp`; the past of a circuit is flat here.
"""

import ctypes as c
from typing import Any

_D, _I, _L, _P = c.c_double, c.c_int, c.c_int64, c.c_void_p


def _structure(name: str, *fields: tuple[str, Any]) -> Any:
    parts = [(each, kind) for names, kind in fields for each in names.split()]
    return type(name, (c.Structure,), {"_fields_": parts})


Table = _structure("Table", ("columns terms", _I), ("place edges c", _P))
Method = _structure("Method", ("stages order", _I), ("gamma", _D), ("a c dense at slope", _P))
Problem = _structure(
    "Problem",
    ("rings fields order terms lasers pieces heat light delays waves", _I),
    ("method", Method),
    ("modes carriers dispersion bend own floor read weight gain rate cross A H G B edges jumps varies", _P),
    ("power phase detuning", Table),
    ("entry brightest sequence between taken sent delay late seen_ring seen_laser seen_late corner", _P),
    ("energies", _I),
    ("time_tolerance", _D),
)
Loop = _structure(
    "Loop",
    ("t h h_before size_before growth rtol longest restart cap rest_step level seen crossing", _D),
    ("accepted rejected rest_again filled room budget", _L),
    ("begun piece entered fresh per_step quantity ring stop", _I),
    ("past", _P),
    ("past_filled past_room", _L),
)
ReturnMap = _structure(
    "ReturnMap",
    ("p edges fixed slow rows steps", _P),
    ("fixed_count n room filled count", _L),
    ("memory", _P),
)
STRUCTURES = {"Table": Table, "Method": Method, "Problem": Problem, "Loop": Loop, "ReturnMap": ReturnMap}


class Place(c.Structure):
    """A field's offset, or a structure's size, in bytes: ``Place`` of layout.cpp."""

    _fields_ = (("name", c.c_char_p), ("bytes", _L))


def python_layout() -> dict[str, int]:
    """Offset of every field, such as "Loop.t", and size of every structure, such as "Loop", in bytes."""
    layout = {}
    for name, structure in STRUCTURES.items():
        for field, _ in structure._fields_:
            layout[f"{name}.{field}"] = int(getattr(structure, field).offset)
        layout[name] = c.sizeof(structure)
    return layout


def kernel_layout(kernel: c.CDLL) -> dict[str, int]:
    """The same as the compiled kernel has it, by its table `ring_layout`."""
    kernel.ring_layout.restype = c.POINTER(Place)
    places = kernel.ring_layout()
    layout = {}
    row = 0
    while places[row].name is not None:
        layout[places[row].name.decode()] = int(places[row].bytes)
        row += 1
    return layout


def check_layout(kernel: c.CDLL) -> None:
    """Raise RuntimeError naming the fields that lie elsewhere in the kernel than in this file."""
    here = python_layout()
    there = kernel_layout(kernel)
    moved = sorted(name for name in here.keys() | there.keys() if here.get(name) != there.get(name))
    if moved:
        raise RuntimeError(f"coupled/kernel/structures.py is not what is compiled: {', '.join(moved)}")
