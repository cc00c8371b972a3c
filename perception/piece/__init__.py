"""The piece of food: found on the table, tracked through a trial."""

from __future__ import annotations

from perception.piece.detection import PieceDetection, find_piece
from perception.piece.tracking import at_home, lies_at_home, track_piece

__all__ = ["PieceDetection", "at_home", "find_piece", "lies_at_home", "track_piece"]
