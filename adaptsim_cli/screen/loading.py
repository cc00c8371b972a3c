"""One line on the terminal while a command imports what it needs. Whatever is said next takes its place."""

from __future__ import annotations

import os
import sys

LINE = "adaptsim: loading ..."
_ERASE = "\r\x1b[K"


def say() -> None:
    """Nothing without a terminal, so that no pipe holds it."""
    if _can_erase():
        sys.stderr.write(LINE)
        sys.stderr.flush()


def clear() -> None:
    """Take the line away, if it stands there."""
    if _can_erase():
        sys.stderr.write(_ERASE)
        sys.stderr.flush()


def _can_erase() -> bool:
    return sys.stderr.isatty() and os.environ.get("TERM", "dumb") != "dumb"
