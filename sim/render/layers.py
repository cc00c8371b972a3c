"""The visible part of one body in one picture, painted over the background."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim.render.rays import Array32

Known = TypeVar("Known")


@dataclass(frozen=True, eq=False)
class Layer:
    """The pixels that show a body, with their values."""

    rows: NDArray[np.intp]  # (m,) in the whole image
    columns: NDArray[np.intp]  # (m,)
    t: Array32  # (m,) depth
    values: tuple[NDArray[Any], ...]  # (m, ...) each, one per picture

    def paint(self, t: Array32, pictures: Sequence[NDArray[Any]], corner: tuple[int, int] = (0, 0)) -> None:
        """Where the layer is nearer than `t` (h, w), replace `t` and the values of `pictures` (h, w, ...).

        Each picture is contiguous in memory; `corner` is the row and column of the image at which it begins.
        """
        flat = t.reshape(-1)
        at = (self.rows - corner[0]) * t.shape[1] + self.columns - corner[1]
        nearer = np.flatnonzero(self.t < flat[at])
        at = at[nearer]
        flat[at] = self.t[nearer]
        for picture, value in zip(pictures, self.values, strict=True):
            picture.reshape(-1, *picture.shape[2:])[at] = value[nearer]


class Latest(Generic[Known]):
    """Caches the last result per key, so that bodies at rest are not rendered again."""

    def __init__(self) -> None:
        self._known: dict[Hashable, tuple[Hashable, Known]] = {}

    def get(self, what: Hashable, key: Hashable, make: Callable[[], Known]) -> Known:
        """The last result for `what` if it had the same `key`; otherwise the result of `make`, which is kept.

        `key` holds everything that the result depends on.
        """
        known = self._known.get(what)
        if known is None or known[0] != key:
            known = key, make()
            self._known[what] = known
        return known[1]
