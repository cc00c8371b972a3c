"""The piece of food: found on the table, shown to the operator, tracked through a trial."""

from __future__ import annotations

from perception.geometry import Area
from perception.piece.detection import PieceDetection, find_piece
from perception.piece.overlay import overlay
from perception.piece.tracking import track_piece

__all__ = ["Area", "PieceDetection", "find_piece", "overlay", "track_piece"]
