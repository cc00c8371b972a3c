"""Drake's types and log."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pydrake.common  # noqa: F401 - sets the level of its logger when it is first imported, so it comes first


def silence() -> None:
    """Let only Drake's errors through, in this process."""
    logging.getLogger("drake").setLevel(logging.ERROR)


def vector(x: float, y: float, z: float) -> Any:
    """(3,) for a Drake call. Typed `Any`, because no NumPy array matches the array type of Drake's stubs."""
    return np.array([x, y, z], dtype=np.float64)
