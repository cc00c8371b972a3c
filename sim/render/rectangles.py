"""Rectangles of an image as (rows, columns)."""

from __future__ import annotations

from collections.abc import Sequence

Rectangle = tuple[slice, slice]


def is_empty(box: Rectangle) -> bool:
    """Whether the rectangle has no pixel."""
    rows, columns = box
    return bool(rows.stop <= rows.start or columns.stop <= columns.start)


def union(boxes: Sequence[Rectangle]) -> Rectangle | None:
    """The smallest rectangle around all non-empty ones; None if all are empty."""
    full = [box for box in boxes if not is_empty(box)]
    if not full:
        return None
    rows, columns = zip(*full, strict=True)
    return (
        slice(min(s.start for s in rows), max(s.stop for s in rows)),
        slice(min(s.start for s in columns), max(s.stop for s in columns)),
    )


def within(box: Rectangle, region: Rectangle) -> Rectangle:
    """The part of `box` inside `region`, in pixels from the first corner of `region`."""
    rows, columns = (
        slice(max(side.start - whole.start, 0), max(min(side.stop, whole.stop) - whole.start, 0))
        for side, whole in zip(box, region, strict=True)
    )
    return rows, columns


def coarser(box: Rectangle, step: int) -> Rectangle:
    """`box` in an image reduced to every `step`-th row and column."""
    rows, columns = box
    return slice(rows.start // step, -(-rows.stop // step)), slice(columns.start // step, -(-columns.stop // step))
