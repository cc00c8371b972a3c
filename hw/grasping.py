"""The range of widths that counts as the expected object between the fingers."""

from __future__ import annotations

TOLERANCE_M = 0.005


def narrower_m(width_m: float) -> float:
    """How much narrower than `width_m` it may be (m): never so much that fingers closed on nothing would count."""
    return min(TOLERANCE_M, width_m / 2.0)


def fits(found_m: float, width_m: float) -> bool:
    """Whether fingers that stand `found_m` apart may hold an object `width_m` wide."""
    return width_m - narrower_m(width_m) <= found_m <= width_m + TOLERANCE_M
