"""Values in the form that Drake's bindings take."""

from __future__ import annotations

from typing import Any

import numpy as np


def vector(x: float, y: float, z: float) -> Any:
    """(3,) for a Drake call. Typed `Any`, because no NumPy array matches the array type of Drake's stubs."""
    return np.array([x, y, z], dtype=np.float64)
