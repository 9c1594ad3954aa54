"""The report's words, section by section, from sections.toml; every number in them is a place that `claims` fills."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Picture:
    """A panel with its title and caption, and the stages it draws."""

    name: str
    title: str
    stages: tuple[str, ...]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A heading, a paragraph, and pictures; ``quick`` where only the one-minute version shows it."""

    title: str
    text: str
    pictures: tuple[Picture, ...] = ()
    quick: bool = False


def read() -> tuple[tuple[Section, ...], tuple[Section, ...]]:
    """The boxes at the top, and the sections."""
    words = tomllib.loads((Path(__file__).parent / "sections.toml").read_text(encoding="utf-8"))
    lead, sections = ([_section(entry) for entry in words[key]] for key in ("lead", "section"))
    return tuple(lead), tuple(sections)


def _section(entry: dict[str, Any]) -> Section:
    pictures = [Picture(**one_line(picture)) for picture in entry.get("picture", ())]
    rest = {key: value for key, value in entry.items() if key != "picture"}
    return Section(**one_line(rest), pictures=tuple(pictures))


def one_line(entry: dict[str, Any]) -> dict[str, Any]:
    """An entry of a TOML file with every text on one line."""
    return {key: " ".join(value.split()) if isinstance(value, str) else value for key, value in entry.items()}
