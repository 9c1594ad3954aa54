"""A small campaign that several tests run."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import thermofem as th
from thermofem.campaign import Drive, Variation

TIMES = (0.0, 1e-8, 1e-7)
STEP = Drive("step", th.Constant(1e-3), TIMES)
OXIDE = "material.SiO2.conductivity"
FILE = """
geometry = "ring.toml"
[[vary]]
path = "material.SiO2.conductivity"
name = "oxide"
from = "1.0 W/m/K"
to = "1.4 W/m/K"
count = {count}
[[drive]]
power = "1 mW"
duration = "100 ns"
first = "10 ns"
samples = 3
"""


def make(count: int = 4, *, bad: int | None = None, **options) -> th.Campaign:
    """A campaign over the oxide's conductivity; ``bad`` is the place of one geometry that cannot be."""
    values = np.linspace(1.0, 1.4, count).round(6).tolist()
    paths, unit = (OXIDE,), "W/m/K"
    if bad is not None:
        values[bad] = -1.0
    return th.Campaign(th.strip_ring().to_toml(), (Variation("oxide", paths, unit, tuple(values)),), (STEP,), **options)


def write(folder: Path, count: int) -> Path:
    """The same campaign as a file."""
    (folder / "ring.toml").write_text(th.strip_ring().to_toml())
    (folder / "campaign.toml").write_text(FILE.format(count=count))
    return folder / "campaign.toml"


def marks(folder: Path) -> dict[str, int]:
    """When each result was written: a geometry computed again changes its mark."""
    return {
        path.name: path.stat().st_mtime_ns for path in (folder / "results").glob("[!.]*.nc")
    }  # not those being written
