"""What several pages are written with."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("adaptsim_cli", "calib", "hw", "perception", "sim")


def cell(text: str) -> str:
    """`text` on one line, as a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")
