"""One line on the terminal while a command imports its modules. The next output replaces it."""

from __future__ import annotations

import os
import sys

LINE = "adaptsim: loading ..."
_ERASE = "\r\x1b[K"


def say() -> None:
    """Show the line; nothing without a terminal, so that no pipe gets it."""
    if _can_erase():
        sys.stderr.write(LINE)
        sys.stderr.flush()


def clear() -> None:
    """Erase the line, if it is shown."""
    if _can_erase():
        sys.stderr.write(_ERASE)
        sys.stderr.flush()


def _can_erase() -> bool:
    return sys.stderr.isatty() and os.environ.get("TERM", "dumb") != "dumb"
