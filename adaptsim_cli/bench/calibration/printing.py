"""The board on paper: a page at true scale with a ruler to check the print, and the stored size of the print."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomli_w

from adaptsim_cli.errors import UsageError
from adaptsim_cli.storage import durable
from calib.records import read
from calib.target_records import BoardRecord
from hw.records import Record
from perception.board.types import Board

if TYPE_CHECKING:
    from adaptsim_cli.screen.paper import Sheet

PAPERS_MM = {"a4": (297.0, 210.0), "a3": (420.0, 297.0), "letter": (279.4, 215.9)}
FORMATS = (".pdf", ".png")
BOARD_FILE = "board.toml"
LIKELY = 0.03
"""A larger deviation of the print, as a share, means a wrong measurement or a print scaled to the page."""

_TOP_MM, _BOTTOM_MM, _SIDE_MM = 8.0, 17.0, 8.0
_RULER_MM = 100.0
_SQUARE_PX = 560


class PrintedBoard(Record):
    """board.toml: the board in use, with its measured size."""

    board: BoardRecord
    nominal_square_mm: float
    measured: bool


def fitting(paper: str, square_mm: float | None) -> Board:
    """The board for a paper size, with squares of the wanted size, or else the largest that fit, in whole mm. Raises
    UsageError.
    """
    if paper not in PAPERS_MM:
        raise UsageError(f"--paper {paper}: choose one of {', '.join(PAPERS_MM)}")
    width, height = PAPERS_MM[paper]
    like = Board()
    room = (width - 2 * _SIDE_MM) / like.squares_across, (height - _TOP_MM - _BOTTOM_MM) / like.squares_down
    side = float(np.floor(min(room))) if square_mm is None else square_mm
    if not 5.0 <= side <= min(room):
        raise UsageError(f"--square-mm {side:g}: on {paper} squares can be 5 to {min(room):.1f} mm")
    return Board(like.squares_across, like.squares_down, 1e-3 * side, 0.75e-3 * side, like.dictionary)


def page(board: Board, paper: str, kind: str) -> bytes:
    """The page as PDF or PNG (`kind` is ".pdf" or ".png"), at true scale if printed at 100 %."""
    from adaptsim_cli.screen.paper import Sheet
    from perception.board import draw

    sheet = Sheet(*PAPERS_MM[paper])
    across, down = (1e3 * length for length in board.size_m)
    left, bottom = (sheet.width_mm - across) / 2, sheet.height_mm - _TOP_MM - down
    sheet.picture(draw(board, _SQUARE_PX), left, bottom, across, down)
    _ruler(sheet, left, bottom - 8.5)
    square, marker = 1e3 * board.square_m, 1e3 * board.marker_m
    size = f"{board.squares_across} by {board.squares_down} squares of {square:g} mm, markers {marker:g} mm"
    lines = (
        f"adaptsim board: {size}, {board.dictionary}. Print at 100 %, not fitted to the page.",
        f"The {board.squares_across} squares of a row must be {across:g} mm wide together: measure, and enter the "
        "width in adaptsim.",
    )
    for line, text in enumerate(lines):
        sheet.text(left + across, bottom - 3.0 - 4.0 * line, text, 7, "rt")
    return Sheet.pdf([sheet]) if kind == ".pdf" else sheet.png()


def _ruler(sheet: Sheet, x_mm: float, y_mm: float) -> None:
    sheet.line([(x_mm, y_mm), (x_mm + _RULER_MM, y_mm)], 0.15)
    for tick in range(int(_RULER_MM) + 1):
        length = 4.0 if tick % 10 == 0 else 2.8 if tick % 5 == 0 else 1.8
        sheet.line([(x_mm + tick, y_mm), (x_mm + tick, y_mm + length)], 0.1)
        if tick % 10 == 0:
            sheet.text(x_mm + tick, y_mm - 0.6, f"{tick}", 5, "mt")
    sheet.text(x_mm + _RULER_MM + 2.5, y_mm - 0.6, "mm", 5, "lt")


def remember(data: Path, board: Board, width_mm: float | None) -> PrintedBoard:
    """Store the board in use, with the measured width of all its squares together. Raises UsageError, SessionError."""
    nominal = 1e3 * board.square_m
    side = nominal if width_mm is None else width_mm / board.squares_across
    if abs(side / nominal - 1) > LIKELY:
        raise UsageError(
            f"{width_mm:g} mm for {board.squares_across} squares is {100 * (side / nominal - 1):+.1f} % off the "
            f"{board.squares_across * nominal:g} mm that were printed: measure again, or print at 100 % and not fitted "
            "to the page"
        )
    scaled = replace(board, square_m=1e-3 * side, marker_m=board.marker_m * side / nominal)
    record = PrintedBoard(
        board=BoardRecord.from_board(scaled), nominal_square_mm=nominal, measured=width_mm is not None
    )
    durable.make_folder(data)
    durable.replace_file(data / BOARD_FILE, tomli_w.dumps(record.model_dump()).encode())
    return record


def stored_board(data: Path) -> PrintedBoard | None:
    """The board in use; None if none was stored. Raises ViewFolderError if its file is damaged."""
    path = data / BOARD_FILE
    return read(PrintedBoard, path) if path.exists() else None
