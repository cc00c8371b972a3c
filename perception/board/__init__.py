"""The calibration board: drawn, detected in an image, located in space."""

from __future__ import annotations

from perception.board.detection import detect, draw, locate
from perception.board.finding import find
from perception.board.types import Board, BoardPose, Corners, Target

__all__ = ["Board", "BoardPose", "Corners", "Target", "detect", "draw", "find", "locate"]
