"""Coloured meshes for the camera: the piece and a nylon turner."""

from __future__ import annotations

import numpy as np

from sim.tasks.scooping.handle import HANDLE_M, NECK_M, NECK_SIZE_M, ROOT_M, UP
from sim.tasks.scooping.params import GRIP_M, HANDLE_RISE_RAD, LIP_M
from sim.tasks.scooping.piece import Piece, blade
from sim.tasks.shared.shapes import box
from sim.types import Visual

_NYLON = (0.015, 0.015, 0.017)
_TAPE = (0.25, 0.25, 0.27)

HANDLE_SECTION_M = (0.024, 0.018)
"""Width and thickness of the handle."""

ADAPTER_M = (0.05, 0.045, 0.035)
"""The box around the handle that the fingers hold: along the handle, across it, through it."""


def piece_visual(body: str, piece: Piece, colour: tuple[float, float, float]) -> Visual:
    """The piece in its colour (linear RGB), fixed to `body`."""
    return Visual(body, piece.vertices_m, piece.triangles, colour)


def spatula_visuals(blade_body: str, handle_body: str, lip_m: float = LIP_M) -> tuple[Visual, ...]:
    """Blade with a lip of `lip_m`, neck and handle of the turner, and the box that the gripper holds."""
    neck_end = ROOT_M + NECK_M * UP
    handle_end = neck_end + HANDLE_M * UP
    solid = blade(lip_m)
    neck = box(np.array(NECK_SIZE_M), (ROOT_M + neck_end) / 2, HANDLE_RISE_RAD)
    handle = box(np.array([HANDLE_M, *HANDLE_SECTION_M]), (neck_end + handle_end) / 2, HANDLE_RISE_RAD)
    adapter = box(np.array(ADAPTER_M), ROOT_M + GRIP_M * UP, HANDLE_RISE_RAD)
    return (
        Visual(blade_body, solid.vertices_m, solid.triangles, _NYLON),
        Visual(handle_body, *neck, _NYLON),
        Visual(handle_body, *handle, _NYLON),
        Visual(handle_body, *adapter, _TAPE),
    )
