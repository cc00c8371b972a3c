"""The calibration board: drawn, detected in an image, located in space."""

from __future__ import annotations

from perception.board.detection import detect, draw, locate
from perception.board.finding import find
from perception.board.types import Board, BoardPose, CalibrationTarget, Corners

__all__ = ["Board", "BoardPose", "CalibrationTarget", "Corners", "detect", "draw", "find", "locate"]
