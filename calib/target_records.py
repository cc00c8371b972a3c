"""`[board]` of setup.toml: kind and size of the target in the views."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from hw.records import Record
from perception.board.targets import Chessboard, Circles, Markers, Points, marker_grid, single
from perception.board.types import Board

Millimetres = Annotated[float, Field(gt=1.0, lt=2000.0)]


class TargetRecord(Record, ABC):
    """The common base of all kinds. With `size = "unknown"`, lengths only state proportions."""

    size: Literal["stated", "unknown"] = "stated"  # unknown: lengths state proportions, the arm's motion gives the size

    @abstractmethod
    def board(self) -> Board | Chessboard | Circles | Markers | Points:
        """The value. Raises ValueError for an impossible target."""

    @property
    def size_known(self) -> bool:
        """Whether the lengths are true lengths."""
        return self.size == "stated"

    def scaled(self, factor: float) -> Self:
        """The same record with all lengths times `factor`."""
        lengths = {key: value for key, value in self if key.endswith("_mm") and value is not None}
        return self.model_copy(update={key: factor * value for key, value in lengths.items()})


class PrintedRecord(TargetRecord):
    """A target whose file states all of it."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.board()  # checks the values: a ValueError becomes part of the message
        return self


class BoardRecord(PrintedRecord):
    """A ChArUco board as printed; its square as measured on the print."""

    kind: Literal["charuco"] = "charuco"  # a chessboard with markers
    squares_across: int
    squares_down: int
    square_mm: float = Field(gt=2.0, lt=500.0)
    marker_mm: float = Field(gt=1.0, lt=500.0)
    dictionary: str
    legacy: bool = False  # the pattern of OpenCV before 4.6

    @classmethod
    def from_board(cls, board: Board) -> Self:
        """The record of a board: lengths in mm, to a nanometre."""
        return cls(
            squares_across=board.squares_across,
            squares_down=board.squares_down,
            square_mm=round(1e3 * board.square_m, 6),
            marker_mm=round(1e3 * board.marker_m, 6),
            dictionary=board.dictionary,
            legacy=board.legacy,
        )

    def board(self) -> Board:
        """See `TargetRecord`."""
        return Board(
            self.squares_across,
            self.squares_down,
            1e-3 * self.square_mm,
            1e-3 * self.marker_mm,
            self.dictionary,
            self.legacy,
        )


class ChessboardRecord(PrintedRecord):
    """A plain chessboard."""

    kind: Literal["chessboard"]  # without markers
    squares_across: int  # squares, not inner corners
    squares_down: int  # rows of squares
    square_mm: Millimetres  # edge of a square

    def board(self) -> Chessboard:
        """See `TargetRecord`."""
        return Chessboard(self.squares_across, self.squares_down, 1e-3 * self.square_mm)


class MarkerRecord(PrintedRecord):
    """One ArUco or AprilTag marker; `marker_mm` is the edge of its black square."""

    kind: Literal["marker"]  # ArUco or AprilTag
    dictionary: str  # a dictionary of OpenCV, without DICT_, in small letters
    id: int  # its number in the dictionary
    marker_mm: Millimetres  # edge of the black square

    def board(self) -> Markers:
        """See `TargetRecord`."""
        return single(self.dictionary, self.id, 1e-3 * self.marker_mm)


class MarkerGridRecord(PrintedRecord):
    """Markers in rows, numbered along each row first."""

    kind: Literal["markers"]  # ArUco or AprilTag
    dictionary: str  # a dictionary of OpenCV, without DICT_, in small letters
    first_id: int = 0  # of the upper left marker
    across: int = Field(ge=1, le=100)  # markers in a row
    down: int = Field(ge=1, le=100)  # rows
    marker_mm: Millimetres  # edge of a black square
    gap_mm: float = Field(ge=0.0, lt=2000.0)  # between two black squares

    def board(self) -> Markers:
        """See `TargetRecord`."""
        shape = (self.across, self.down)
        return marker_grid(self.dictionary, self.first_id, shape, 1e-3 * self.marker_mm, 1e-3 * self.gap_mm)


class CirclesRecord(PrintedRecord):
    """A grid of circles; in staggered rows `spacing_mm` is half the distance of neighbours in a row."""

    kind: Literal["circles"]  # dark on white
    across: int  # centres in a row
    down: int  # rows
    spacing_mm: Millimetres  # between neighbours of a row; half of it in staggered rows
    staggered: bool = False  # every second row is moved by half

    def board(self) -> Circles:
        """See `TargetRecord`."""
        return Circles(self.across, self.down, 1e-3 * self.spacing_mm, self.staggered)


class PointsRecord(TargetRecord):
    """Points found by another program: every view gives their pixels and places."""

    kind: Literal["points"]  # found by another program
    points_mm: tuple[tuple[float, float, float], ...] = ()  # filled in from the views

    def scaled(self, factor: float) -> Self:
        """The same record with all lengths times `factor`."""
        grown = tuple((factor * x, factor * y, factor * z) for x, y, z in self.points_mm)
        return self.model_copy(update={"points_mm": grown})

    def board(self) -> Points:
        """See `TargetRecord`."""
        return Points(1e-3 * np.array(self.points_mm).reshape(-1, 3))


def _kind(value: Any) -> str:
    kind = value.get("kind", "charuco") if isinstance(value, dict) else getattr(value, "kind", "charuco")
    return str(kind)


AnyTargetRecord = Annotated[
    Annotated[BoardRecord, Tag("charuco")]
    | Annotated[ChessboardRecord, Tag("chessboard")]
    | Annotated[MarkerRecord, Tag("marker")]
    | Annotated[MarkerGridRecord, Tag("markers")]
    | Annotated[CirclesRecord, Tag("circles")]
    | Annotated[PointsRecord, Tag("points")],
    Discriminator(_kind),
]
"""The kind of a record; a board without a kind is a ChArUco board."""
