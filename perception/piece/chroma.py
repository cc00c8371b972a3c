"""Tells the object from its background by rg-chromaticity, which does not change with shading and shadows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from perception.geometry import Array32


def chromaticity(rgb: NDArray[np.uint8]) -> Array32:
    """(..., 3) -> (..., 2): the shares of red and green in the sum of the channels."""
    values = rgb.astype(np.float32)
    total = values.sum(axis=-1, keepdims=True) + np.float32(6.0)  # black has no colour: pull it towards grey
    return np.asarray((values[..., :2] + np.float32(2.0)) / total, dtype=np.float32)


def matte(rgb: NDArray[np.uint8], piece: Array, others: tuple[Array, ...]) -> Array32:
    """(h, w) share of each pixel that the piece covers, 0 to 1.

    `piece` and `others` (table, tool) are chromaticities (2,). A pixel is placed on the line
    from each of the others to the piece, and the smallest share counts.
    """
    colour = chromaticity(rgb)
    share = np.ones(colour.shape[:2], dtype=np.float32)
    for other in others:
        line = (piece - other).astype(np.float32)
        on_line = (colour - other.astype(np.float32)) @ (line / np.float32(line @ line))
        np.minimum(share, on_line, out=share)
    return np.clip(share, 0, 1, out=share)


def typical(colour: Array32) -> tuple[Array, float]:
    """Median chromaticity (2,) of (n, 2) and the spread around it (one standard deviation, robustly)."""
    centre = np.median(colour, axis=0).astype(np.float64)
    spread = 1.4826 * np.median(np.abs(colour - centre.astype(np.float32)), axis=0)
    return centre, float(max(spread.max(), 1e-3))
