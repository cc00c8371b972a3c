"""The pages that follow from the code, one module a page; `docs/generate.py` writes them."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("adaptsim_cli", "calib", "hw", "perception", "sim")


def cell(text: str) -> str:
    """`text` on one line, as a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")
