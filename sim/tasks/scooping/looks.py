"""What the camera sees: coloured meshes of table, piece and a nylon turner."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.tasks.scooping.params import BLADE_LENGTH_M, BLADE_WIDTH_M, EDGE_M, GRIP_M, HANDLE_RISE_RAD
from sim.tasks.scooping.piece import Piece
from sim.tasks.task import Visual

_NYLON = (0.015, 0.015, 0.017)
_TAPE = (0.25, 0.25, 0.27)
_FOOD = (0.55, 0.13, 0.03)
_TABLE = (0.55, 0.53, 0.50)
_TABLE_CORNERS_M = np.array([[0.30, -0.60, -0.03], [1.20, 0.60, 0.0]])
_NECK_M = 0.05
_HANDLE_M = GRIP_M + 0.03 - _NECK_M


def table_visual() -> Visual:
    """The table in front of the robot; its top is at z = 0."""
    vertices, triangles = _box(_TABLE_CORNERS_M[1] - _TABLE_CORNERS_M[0], _TABLE_CORNERS_M.mean(axis=0), 0.0)
    return Visual("world", vertices, triangles, _TABLE)


def piece_visual(body: str, piece: Piece) -> Visual:
    return Visual(body, piece.vertices_m, piece.triangles, _FOOD)


def spatula_visuals(blade_body: str, handle_body: str) -> tuple[Visual, ...]:
    """Blade, neck and handle of the turner, and the box that the gripper holds."""
    root = np.array([-BLADE_LENGTH_M, 0.0, -EDGE_M / 2])
    up = np.array([-np.cos(HANDLE_RISE_RAD), 0.0, np.sin(HANDLE_RISE_RAD)])
    neck_end = root + _NECK_M * up
    handle_end = neck_end + _HANDLE_M * up
    blade = _box(np.array([BLADE_LENGTH_M, BLADE_WIDTH_M, EDGE_M]), np.array([-BLADE_LENGTH_M / 2, 0, -EDGE_M / 2]), 0)
    neck = _box(np.array([_NECK_M, 0.035, 0.004]), (root + neck_end) / 2, HANDLE_RISE_RAD)
    handle = _box(np.array([_HANDLE_M, 0.024, 0.018]), (neck_end + handle_end) / 2, HANDLE_RISE_RAD)
    adapter = _box(np.array([0.05, 0.045, 0.035]), root + GRIP_M * up, HANDLE_RISE_RAD)
    return (
        Visual(blade_body, *blade, _NYLON),
        Visual(handle_body, *neck, _NYLON),
        Visual(handle_body, *handle, _NYLON),
        Visual(handle_body, *adapter, _TAPE),
    )


def _box(size_m: Array, centre_m: Array, pitch_rad: float) -> tuple[Array, NDArray[np.int32]]:
    """A box turned by `pitch_rad` about Y (positive: its X end down)."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size_m
    cos, sin = np.cos(pitch_rad), np.sin(pitch_rad)
    turned = corners @ np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]).T
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)
    return turned + centre_m, triangles
