"""How wide something between the fingers may be to count as what was to be grasped."""

from __future__ import annotations

TOLERANCE_M = 0.005


def narrower_m(width_m: float) -> float:
    """By how much it may be narrower than `width_m`: never so much that fingers closed on nothing hold it."""
    return min(TOLERANCE_M, width_m / 2.0)


def fits(found_m: float, width_m: float) -> bool:
    """Whether fingers that stand `found_m` apart may hold something `width_m` wide."""
    return width_m - narrower_m(width_m) <= found_m <= width_m + TOLERANCE_M
