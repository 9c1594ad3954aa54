"""The targets of readers.py under atheris, which steers the bytes by the coverage they reach; ends at a failure.

python tests/fuzz/coverage.py [minutes]
"""

from __future__ import annotations

import sys

import atheris

with atheris.instrument_imports(include=["thermofem", "surrogate", "coupled"]):
    import readers

NAMES = list(readers.TARGETS)


def check(data: bytes) -> None:
    """Run the target that the first byte picks."""
    if data:
        readers.survives(NAMES[data[0] % len(NAMES)], data[1:].decode("utf-8", "replace"), {})


if __name__ == "__main__":
    corpus = readers.FOLDER / "corpus"
    corpus.mkdir()
    for name, texts in readers.seeds().items():
        for k, text in enumerate(texts):
            (corpus / f"{name}{k}").write_bytes(bytes([NAMES.index(name)]) + text.encode())
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    atheris.Setup([sys.argv[0], f"-max_total_time={60 * minutes:.0f}", "-max_len=6000", str(corpus)], check)
    atheris.Fuzz()
