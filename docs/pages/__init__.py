"""The pages that follow from the code, one module a page; `docs/generate.py` writes them."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "benchmarks"))  # the table of sessions is read by its own benchmark
PACKAGES = ("adaptsim_cli", "calib", "hw", "perception", "sim")


def cell(text: str) -> str:
    """`text` on one line, as a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")
