"""Every reader of the project as a function of a text and a folder to put it into, and a valid text for each."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from paths import ROOT

import coupled
import surrogate
import thermofem as th
from coupled import ring_toml
from thermofem.campaign import Campaign
from thermofem.waveforms import from_json, to_json
from thermofem_cli.inputs.command_files import kind_of

Reader = Callable[[str, Path], Any]


def as_file(read: Callable[[Path], Any], name: str) -> Reader:
    """A reader of files as one of text."""

    def reader(text: str, folder: Path) -> Any:
        path = folder / name
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
        return read(path)

    return reader


def described(text: str | None, begin: str = "```toml\n") -> str:
    """The file that a docstring or a page of the docs shows."""
    return (text or "").split(begin)[1].split("```")[0]


READERS: dict[str, Reader] = {
    "model": as_file(surrogate.load_model, "model.json"),
    "provenance": as_file(th.models.load_provenance, "model.json"),
    "geometry": as_file(th.CrossSection.from_toml, "geometry.toml"),
    "campaign": as_file(Campaign.from_toml, "campaign.toml"),
    "ring": as_file(coupled.RingResonator.from_toml, "laser.toml"),
    "circuit": as_file(coupled.Circuit.from_toml, "circuit.toml"),
    "waveform": lambda text, folder: from_json(text),
    "table": as_file(lambda path: th.read_trace(path, 1e-3), "table.csv"),
    "kind": as_file(kind_of, "model.json"),
}
CAMPAIGN = """geometry = "strip.toml"
[[vary]]
path = "part.core.radius"
from = "3 um"
to = "15 um"
count = 3
[[drive]]
power = "1 mW"
square = "1 us"
duty = 0.3
periodic = true
"""


def valid(folder: Path) -> dict[str, str]:
    """A text that each reader takes; what they refer to is written into the folder."""
    (folder / "strip.toml").write_text(th.strip_ring().to_toml())
    (folder / "ring.toml").write_text('base = "borghi2021"\n')
    model = surrogate.save_model(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), folder / "good.json").read_text()
    return {
        "model": model,
        "provenance": model,
        "kind": model,
        "geometry": th.heated_ring().to_toml(),
        "campaign": CAMPAIGN,
        "ring": described(ring_toml.__doc__).replace('drop_rate = "40e9 1/s"', ""),
        "circuit": described((ROOT / "docs/circuits.md").read_text(), '```toml title="bus.toml"\n'),
        "waveform": json.dumps(json.loads(to_json(th.SquareWave(2e-3, 1e-6, 0.3)))),
        "table": "time (us),T (K)\n" + "".join(f"{k},{1 - 0.5**k}\n" for k in range(12)),
    }
