"""The calibration board, and its corners in a picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, frozen_array

DICTIONARIES: Final = {
    **{f"{bits}x{bits}_{size}": size for bits in (4, 5, 6, 7) for size in (50, 100, 250, 1000)},
    "apriltag_16h5": 30,
    "apriltag_25h9": 35,
    "apriltag_36h10": 2320,
    "apriltag_36h11": 587,
    "aruco_original": 1024,
    "aruco_mip_36h12": 250,
}
"""Marker dictionaries and how many markers each has: OpenCV's names without `DICT_`, in small letters."""


class CalibrationTarget(Protocol):
    """Anything that shows points whose places on it are known, up to its size. Frame M is its own."""

    @property
    def p_MK_m(self) -> Array:
        """(K, 3) the points, row number = id."""

    @property
    def corners(self) -> int:
        """How many points: K."""

    @property
    def spacing_m(self) -> float:
        """Distance of neighbouring points."""

    @property
    def outline_m(self) -> Array:
        """(4, 3) corners of a rectangle about it."""

    @property
    def least(self) -> int:
        """Points that a view must show to count."""

    @property
    def turns(self) -> tuple[NDArray[np.int64], ...]:
        """Other ids (K,) that the same points could have in a picture, because a plain chessboard may be read upside
        down.
        """

    @property
    def name(self) -> str:
        """The board in words, with its size."""

    def scaled(self, factor: float) -> Self:
        """The same, larger by `factor`."""


@dataclass(frozen=True, eq=False)
class Board:
    """A ChArUco board: a chessboard whose white squares carry markers. The default is 280 x 200 mm.

    A bit of a marker is then 5 mm wide: 2.4 px at 1.3 m in a Kinect's colour image. Smaller squares give more corners,
    but fewer of them are found.

    Board frame M: origin at the outer corner of the first printed square (upper left on the print), X to the
    right along `squares_across`, Y down along `squares_down`, Z into the paper, away from who looks at it. So a
    camera straight in front has the same axes as the board. The top left square is black, as OpenCV has it since 4.6.
    """

    squares_across: int = 7
    squares_down: int = 5
    square_m: float = 0.040  # as measured on the print
    marker_m: float = 0.030
    dictionary: str = "4x4_50"  # a key of DICTIONARIES: few bits, so that a marker can be read from afar
    legacy: bool = False  # the pattern of OpenCV before 4.6; it differs for an even number of `squares_down`

    def __post_init__(self) -> None:
        if self.dictionary not in DICTIONARIES:
            raise ValueError(f"dictionary {self.dictionary!r} is not one of {', '.join(DICTIONARIES)}")
        if self.squares_across < 3 or self.squares_down < 3:
            raise ValueError(f"a board of {self.squares_across} x {self.squares_down} squares; at least 3 x 3")
        if not 0.0 < self.marker_m < self.square_m:
            raise ValueError(f"marker {self.marker_m} m, square {self.square_m} m: 0 < marker < square")
        if self.markers > DICTIONARIES[self.dictionary]:
            raise ValueError(f"{self.markers} markers, but dictionary {self.dictionary} has fewer: choose a larger one")

    @property
    def markers(self) -> int:
        """Number of markers on the board; their ids count from 0."""
        return self.squares_across * self.squares_down // 2

    @property
    def corners(self) -> int:
        """Number of inner corners; their ids count from 0, along X first, then down."""
        return (self.squares_across - 1) * (self.squares_down - 1)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (X) and height (Y) of the printed squares."""
        return self.squares_across * self.square_m, self.squares_down * self.square_m

    @property
    def p_MK_m(self) -> Array:
        """(corners, 3) inner corners in the board frame, row number = id."""
        x, y = np.meshgrid(np.arange(1, self.squares_across), np.arange(1, self.squares_down))
        return self.square_m * np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(np.float64)

    @property
    def spacing_m(self) -> float:
        """Edge of a square."""
        return self.square_m

    @property
    def least(self) -> int:
        """A pose from fewer corners is too weak to be worth a view."""
        return 8

    @property
    def turns(self) -> tuple[NDArray[np.int64], ...]:
        """None, because the markers identify the corners."""
        return ()

    @property
    def name(self) -> str:
        """The board in words."""
        pattern = ", legacy pattern" if self.legacy else ""
        return (
            f"ChArUco board of {self.squares_across} x {self.squares_down} squares of {1e3 * self.square_m:.4g} mm"
            f" ({self.dictionary}{pattern})"
        )

    def scaled(self, factor: float) -> Board:
        """The same print, larger by `factor`."""
        return replace(self, square_m=factor * self.square_m, marker_m=factor * self.marker_m)

    @property
    def outline_m(self) -> Array:
        """(4, 3) outer corners of the printed squares, clockwise on the print from the origin."""
        w, h = self.size_m
        return np.array([[0, 0, 0], [w, 0, 0], [w, h, 0], [0, h, 0]], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Corners:
    """Inner corners found in one image (pixel centres at integers), in order of their ids."""

    ids: NDArray[np.int64]  # (N,) strictly increasing
    px: Array  # (N, 2) sub-pixel u, v; lens distortion still in

    def __post_init__(self) -> None:
        ids = np.array(self.ids, dtype=np.int64).reshape(-1)
        if len(ids) and (ids[0] < 0 or (np.diff(ids) <= 0).any()):
            raise ValueError("corner ids are not strictly increasing from 0")
        ids.flags.writeable = False
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "px", frozen_array(self.px, (len(ids), 2), "px"))

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class BoardPose:
    """The board's pose in a camera V, and the second pose that a flat board may have."""

    X_VM: Array  # (4, 4) the pose that fits better
    rms_px: float  # root mean square distance of the corners, in px
    X_VM_flipped: Array | None  # (4, 4) the mirror solution, None where it does not exist
    ambiguous: bool  # both fit about equally well: the tilt's sign is not known from this image alone

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_VM", frozen_array(self.X_VM, (4, 4), "X_VM"))
        if self.X_VM_flipped is not None:
            object.__setattr__(self, "X_VM_flipped", frozen_array(self.X_VM_flipped, (4, 4), "X_VM_flipped"))
