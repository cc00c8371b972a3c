"""Coloured meshes for the camera: the piece and a nylon turner."""

from __future__ import annotations

import numpy as np

from perception.blade import BLADE_LENGTH_M, BLADE_WIDTH_M
from sim.tasks.scooping.handle import HANDLE_M, NECK_M, NECK_SIZE_M, ROOT_M, UP
from sim.tasks.scooping.params import EDGE_M, GRIP_M, HANDLE_RISE_RAD
from sim.tasks.scooping.piece import Piece
from sim.tasks.shared.shapes import box
from sim.types import Visual

_NYLON = (0.015, 0.015, 0.017)
_TAPE = (0.25, 0.25, 0.27)
_FOOD = (0.55, 0.13, 0.03)


def piece_visual(body: str, piece: Piece) -> Visual:
    """The piece in the colour of food, fixed to `body`."""
    return Visual(body, piece.vertices_m, piece.triangles, _FOOD)


def spatula_visuals(blade_body: str, handle_body: str) -> tuple[Visual, ...]:
    """Blade, neck and handle of the turner, and the box that the gripper holds."""
    neck_end = ROOT_M + NECK_M * UP
    handle_end = neck_end + HANDLE_M * UP
    blade = box(np.array([BLADE_LENGTH_M, BLADE_WIDTH_M, EDGE_M]), np.array([-BLADE_LENGTH_M / 2, 0, -EDGE_M / 2]))
    neck = box(np.array(NECK_SIZE_M), (ROOT_M + neck_end) / 2, HANDLE_RISE_RAD)
    handle = box(np.array([HANDLE_M, 0.024, 0.018]), (neck_end + handle_end) / 2, HANDLE_RISE_RAD)
    adapter = box(np.array([0.05, 0.045, 0.035]), ROOT_M + GRIP_M * UP, HANDLE_RISE_RAD)
    return (
        Visual(blade_body, *blade, _NYLON),
        Visual(handle_body, *neck, _NYLON),
        Visual(handle_body, *handle, _NYLON),
        Visual(handle_body, *adapter, _TAPE),
    )
