"""Targets other than our own board: plain chessboards, single markers and groups of them, circles, bare points.

Frame M of all of them: X to the right on the print, Y down, Z into the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array
from perception.board.types import DICTIONARIES

_ALIKE = 1e-3  # of the size of a set of points: places this near are the same


@dataclass(frozen=True, eq=False)
class Chessboard:
    """A plain chessboard: its inner corners, along X first. Upside down it looks the same, or nearly the same."""

    squares_across: int
    squares_down: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.squares_across, self.squares_down) < 4:
            raise ValueError(f"a chessboard of {self.squares_across} x {self.squares_down} squares; at least 4 x 4")
        if not self.square_m > 0:
            raise ValueError(f"squares of {self.square_m} m")

    @property
    def p_MK_m(self) -> Array:
        """(K, 3) inner corners."""
        return self.square_m * _grid(self.squares_across - 1, self.squares_down - 1)

    @property
    def corners(self) -> int:
        """How many inner corners."""
        return (self.squares_across - 1) * (self.squares_down - 1)

    @property
    def spacing_m(self) -> float:
        """Edge of a square."""
        return self.square_m

    @property
    def outline_m(self) -> Array:
        """(4, 3) outer corners."""
        first_inner = np.array([1.0, 1.0, 0.0])
        outer: Array = self.square_m * (_rectangle(self.squares_across, self.squares_down) - first_inner)
        return outer

    @property
    def least(self) -> int:
        """All corners: a part of the pattern is not enough."""
        return self.corners

    @property
    def turns(self) -> tuple[NDArray[np.int64], ...]:
        """Half a turn, and quarters of a square one."""
        return _turns(self.squares_across - 1, self.squares_down - 1)

    @property
    def name(self) -> str:
        """The target in words."""
        return f"chessboard of {self.squares_across} x {self.squares_down} squares of {1e3 * self.square_m:.4g} mm"

    def scaled(self, factor: float) -> Chessboard:
        """The same print, larger by `factor`."""
        return replace(self, square_m=factor * self.square_m)


@dataclass(frozen=True, eq=False)
class Circles:
    """A grid of dark circles on white: their centres in OpenCV's order, in equal or in staggered rows."""

    across: int  # centres in a row
    down: int  # rows
    spacing_m: float  # of neighbours in a row; half of it in staggered rows (OpenCV's convention)
    staggered: bool = False

    def __post_init__(self) -> None:
        if min(self.across, self.down) < 3 or not self.spacing_m > 0:
            raise ValueError(f"{self.across} x {self.down} circles at {self.spacing_m} m; at least 3 x 3")

    @property
    def p_MK_m(self) -> Array:
        """(K, 3) centres."""
        p = _grid(self.across, self.down)
        if self.staggered:
            p = p * [2.0, 1.0, 0.0] + np.array([1.0, 0.0, 0.0]) * (p[:, 1:2] % 2)
        return self.spacing_m * p

    @property
    def corners(self) -> int:
        """How many circles."""
        return self.across * self.down

    @property
    def outline_m(self) -> Array:
        """(4, 3) rectangle of half a spacing around the centres."""
        return _around(self.p_MK_m, 0.5 * self.spacing_m)

    @property
    def least(self) -> int:
        """All corners: a part of the pattern is not enough."""
        return self.corners

    @property
    def turns(self) -> tuple[NDArray[np.int64], ...]:
        """Half a turn, and quarter turns if the grid is square. A staggered grid looks the same turned only if its rows
        are odd.
        """
        if self.staggered:
            return (np.arange(self.corners)[::-1],) if self.down % 2 else ()
        return _turns(self.across, self.down)

    @property
    def name(self) -> str:
        """The target in words."""
        rows = "staggered rows" if self.staggered else "rows"
        return f"{self.across} x {self.down} circles in {rows}, {1e3 * self.spacing_m:.4g} mm apart"

    def scaled(self, factor: float) -> Circles:
        """The same print, larger by `factor`."""
        return replace(self, spacing_m=factor * self.spacing_m)


@dataclass(frozen=True, eq=False)
class Markers:
    """Square markers on one rigid body. Point 4 n + k is corner k of marker n, clockwise from upper left."""

    dictionary: str  # a key of DICTIONARIES
    ids: tuple[int, ...]
    corners_m: Array  # (N, 4, 3)

    def __post_init__(self) -> None:
        if self.dictionary not in DICTIONARIES:
            raise ValueError(f"dictionary {self.dictionary!r} is not one of {', '.join(DICTIONARIES)}")
        beyond = [n for n in self.ids if not 0 <= n < DICTIONARIES[self.dictionary]]
        if beyond or not self.ids or len(set(self.ids)) < len(self.ids):
            raise ValueError(
                f"marker ids {self.ids}: {self.dictionary} has 0 to {DICTIONARIES[self.dictionary] - 1}, each once"
            )
        object.__setattr__(self, "corners_m", frozen_array(self.corners_m, (len(self.ids), 4, 3), "corners_m"))
        if not self.spacing_m > 0:
            raise ValueError("a marker without size")

    @property
    def p_MK_m(self) -> Array:
        """(4 N, 3) corners of all markers."""
        return self.corners_m.reshape(-1, 3)

    @property
    def corners(self) -> int:
        """How many corners."""
        return 4 * len(self.ids)

    @property
    def spacing_m(self) -> float:
        """Edge of the first marker."""
        return float(np.linalg.norm(self.corners_m[0, 1] - self.corners_m[0, 0]))

    @property
    def outline_m(self) -> Array:
        """(4, 3) rectangle about them."""
        low, high = self.p_MK_m.min(axis=0), self.p_MK_m.max(axis=0)
        return np.array([low, [high[0], low[1], low[2]], high, [low[0], high[1], high[2]]])

    @property
    def least(self) -> int:
        """One marker."""
        return 4

    @property
    def turns(self) -> tuple[NDArray[np.int64], ...]:
        """None, because a marker identifies its corners."""
        return ()

    @property
    def name(self) -> str:
        """The target in words."""
        size = f"{1e3 * self.spacing_m:.4g} mm ({self.dictionary}"
        if len(self.ids) == 1:
            return f"marker {self.ids[0]} of {size})"
        return f"{len(self.ids)} markers of {size}, {min(self.ids)} to {max(self.ids)})"

    def scaled(self, factor: float) -> Markers:
        """The same, larger by `factor`."""
        return replace(self, corners_m=factor * self.corners_m)


@dataclass(frozen=True, eq=False)
class Points:
    """Points found by another program, flat or not."""

    p_MK_m: Array  # (K, 3)

    def __post_init__(self) -> None:
        object.__setattr__(self, "p_MK_m", frozen_array(self.p_MK_m, (None, 3), "p_MK_m"))

    @property
    def corners(self) -> int:
        """How many points."""
        return len(self.p_MK_m)

    @property
    def spacing_m(self) -> float:
        """Distance of the two nearest points."""
        apart = np.linalg.norm(self.p_MK_m[:, None] - self.p_MK_m, axis=-1)
        return float(apart[apart > 0].min()) if (apart > 0).any() else 0.0

    @property
    def outline_m(self) -> Array:
        """(4, 3) rectangle about them, at their middle height."""
        return _around(self.p_MK_m)

    @property
    def least(self) -> int:
        """The fewest that have a pose."""
        return 4

    @property
    def turns(self) -> tuple[NDArray[np.int64], ...]:
        """Half and quarter turns under which flat points look the same: other programs may number from any end."""
        return _symmetries(self.p_MK_m)

    @property
    def name(self) -> str:
        """The target in words."""
        return f"set of {self.corners} points, the nearest two {1e3 * self.spacing_m:.4g} mm apart"

    def scaled(self, factor: float) -> Points:
        """The same, larger by `factor`."""
        return Points(factor * self.p_MK_m)


def single(dictionary: str, marker: int, edge_m: float) -> Markers:
    """One marker; the origin is its upper left corner."""
    return Markers(dictionary, (marker,), edge_m * _rectangle(1, 1)[None])


def marker_grid(dictionary: str, first: int, shape: Sequence[int], edge_m: float, gap_m: float) -> Markers:
    """Markers `first` and on in rows, `shape` = (across, down), `gap_m` between them."""
    across, down = shape
    places = (edge_m + gap_m) * _grid(across, down)
    return Markers(
        dictionary, tuple(range(first, first + across * down)), places[:, None] + edge_m * _rectangle(1, 1)[None]
    )


def _grid(across: int, down: int) -> Array:
    x, y = np.meshgrid(np.arange(across), np.arange(down))
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(np.float64)


def _rectangle(width: float, height: float) -> Array:
    return np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]], dtype=np.float64)


def _around(p_m: Array, margin_m: float = 0.0) -> Array:
    """(4, 3) rectangle `margin_m` around points (K, 3), at their middle height."""
    low, high = p_m.min(axis=0) - margin_m, p_m.max(axis=0) + margin_m
    z = (low[2] + high[2]) / 2
    return np.array([[low[0], low[1], z], [high[0], low[1], z], [high[0], high[1], z], [low[0], high[1], z]])


def _symmetries(p_m: Array) -> tuple[NDArray[np.int64], ...]:
    """Symmetries of points (K, 3): the new numbers for each quarter turn about their middle that keeps them."""
    centred = p_m - p_m.mean(axis=0)
    size = float(np.abs(centred).max())
    _, flat, axes = np.linalg.svd(centred, full_matrices=False)
    if len(p_m) < 4 or flat[2] > _ALIKE * size:
        return ()
    xy = centred @ axes[:2].T
    symmetries = []
    for quarters in (1, 2, 3):
        c, s = ((0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[quarters - 1]
        apart = np.linalg.norm((xy @ np.array([[c, s], [-s, c]]))[:, None] - xy, axis=-1)
        ids = apart.argmin(axis=1)
        if apart.min(axis=1).max() < _ALIKE * size and len(set(ids.tolist())) == len(ids):
            symmetries.append(ids.astype(np.int64))
    return tuple(symmetries)


def _turns(across: int, down: int) -> tuple[NDArray[np.int64], ...]:
    ids = np.arange(across * down).reshape(down, across)
    quarters = (2,) if across != down else (1, 2, 3)
    return tuple(np.rot90(ids, k).ravel() for k in quarters)
