"""Silences Drake's own log: warnings about unused features, and addresses that the program itself announces."""

from __future__ import annotations

import logging

import pydrake.common  # noqa: F401 - sets the level of its logger when it is first imported, so it comes first


def silence() -> None:
    """Let only Drake's errors through, in this process."""
    logging.getLogger("drake").setLevel(logging.ERROR)
