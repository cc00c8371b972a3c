"""What Drake says by itself: warnings about features that no scene uses, and addresses that the program announces."""

from __future__ import annotations

import logging

import pydrake.common  # noqa: F401 - sets the level of its logger when it is first imported, so it comes first


def silence() -> None:
    """Let Drake's errors through alone, in this process."""
    logging.getLogger("drake").setLevel(logging.ERROR)
