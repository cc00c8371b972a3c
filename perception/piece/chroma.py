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


_SURE, _FEWEST = 0.9, 8
_LIT = 80.0
_DARKEST, _DARK = 0.2, 0.5
"""Brightness, as a share of the piece's own in this picture, below which a pixel on the tool shows only the tool, and
above which it may show the piece.
"""


def without_halo(share: Array32, rgb: NDArray[np.uint8], on_tool: NDArray[np.bool_]) -> Array32:
    """`share` (h, w) without the rim that a piece gets on a black tool.

    JPEG and demosaicing give dark pixels the colour of their bright neighbours; only their brightness tells them from
    the piece. `on_tool` (h, w) are the pixels with the tool behind the piece. Elsewhere a dark pixel may be a shadow.
    """
    total = rgb.sum(axis=-1, dtype=np.float32)
    sure = share > _SURE
    if sure.sum() < _FEWEST:
        return share
    lit = (total / np.percentile(total[sure], _LIT) - _DARKEST) / (_DARK - _DARKEST)
    return np.where(on_tool, np.minimum(share, np.clip(lit, 0, 1)), share).astype(np.float32)


def typical(colour: Array32) -> tuple[Array, float]:
    """Median chromaticity (2,) of (n, 2) and the spread around it (one standard deviation, robustly)."""
    centre = np.median(colour, axis=0).astype(np.float64)
    spread = 1.4826 * np.median(np.abs(colour - centre.astype(np.float32)), axis=0)
    return centre, float(max(spread.max(), 1e-3))
