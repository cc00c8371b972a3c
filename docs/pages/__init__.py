"""The pages that follow from the code, one module per page; `docs/generate.py` writes them."""

import sys
from pathlib import Path

from adaptsim_cli.screen.svg import Canvas

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "benchmarks"))  # the table of sessions is read by its own benchmark
PACKAGES = ("adaptsim_cli", "calib", "hw", "perception", "sim")


def cell(text: str) -> str:
    """`text` on one line, as a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def standalone(canvas: Canvas, style: str) -> str:
    """The drawing as a file of its own: grey text and grid that are readable on light and dark pages."""
    common = (
        "text{font:12px system-ui,sans-serif;fill:#808080}.title{font-weight:600;font-size:13px}"
        ".grid{stroke:#8884;stroke-width:.6}polyline,.line{fill:none;stroke-width:1.5}"
    )
    head, body = canvas.svg().split(">", 1)
    return f'{head} xmlns="http://www.w3.org/2000/svg"><style>{common}{style}</style>{body}\n'
