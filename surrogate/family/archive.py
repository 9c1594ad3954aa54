"""Arrays in NumPy's archive with a hash over all of them: family files, and the members that a training keeps."""

from __future__ import annotations

import io
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem.data.files import LARGEST, digest, digest_tree
from thermofem.data.netcdf import DAMAGE

HASH = "hash"  # name of the array that holds it
_DAMAGE = (EOFError, MemoryError, SyntaxError, struct.error, tokenize.TokenError, zipfile.BadZipFile, zlib.error)
"""Exceptions of NumPy and zipfile for a damaged archive, beside `DAMAGE`."""


def pack(arrays: Mapping[str, Any], *, deflated: bool = True) -> bytes:
    """The archive of named arrays."""
    memory = io.BytesIO()
    named: dict[str, Any] = {**arrays, HASH: np.array(_hash(arrays))}
    (np.savez_compressed if deflated else np.savez)(memory, **named)
    return memory.getvalue()


def unpack(raw: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of an archive.

    Raises
    ------
    ValueError
        no archive, a damaged one, one that unpacks to more than `LARGEST` bytes, or arrays that are not those
        of the hash.
    """
    if raw[:4] != b"PK\x03\x04":  # NumPy would say how to run what is in it
        raise ValueError("no archive")
    try:
        with np.load(io.BytesIO(raw), allow_pickle=False) as archive:
            if sum(member.file_size for member in archive.zip.infolist()) > LARGEST:
                raise ValueError(f"more than {LARGEST} bytes unpacked")
            arrays = {name: archive[name] for name in archive.files}
    except (*DAMAGE, *_DAMAGE) as error:
        raise ValueError(str(error) or type(error).__name__) from None
    if str(arrays.pop(HASH, None)) != _hash(arrays):
        raise ValueError("it was changed after it was written")
    return arrays


def _hash(arrays: Mapping[str, Any]) -> str:
    each = {name: np.asarray(values) for name, values in arrays.items()}
    return digest_tree({name: [str(a.dtype), a.shape, digest(a.tobytes())] for name, a in each.items()})
