"""Where the checkout is, and where measured data may lie beside it."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MEASURED = ROOT.parent / "shared" / "reference" / "measured"
