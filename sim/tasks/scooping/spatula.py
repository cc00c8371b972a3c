"""The spatula: a kitchen turner, its mass, looks and place in the hand, and its points of touch in a touch-off.

For the tool frame T see plan.py. Blade, neck and handle lie in its plane y = 0.
"""

from __future__ import annotations

import numpy as np

from hw import mass
from hw.capsules import Capsule
from hw.kinematics import FLANGE
from hw.poses import pose
from hw.types import Array, frozen_array
from perception.types import BLADE_LENGTH_M, BLADE_WIDTH_M
from sim.panda.tool import Feeler, Touchable
from sim.tasks.scooping.params import CORNER_M, EDGE_M, LIP_M
from sim.tasks.scooping.piece import blade
from sim.tasks.shared.shapes import box, cut, hole, solid_box
from sim.types import Part, Visual

HANDLE_RISE_RAD = 0.9
"""Angle at which the handle rises from the root of the blade, towards the back."""

GRIP_M = 0.215
"""Distance of the fingers on the handle from the root of the blade."""

NECK_M = 0.05
NECK_SIZE_M = (NECK_M, 0.035, 0.004)
"""Length along the handle, width and thickness of the neck, which stops a piece that rolls down to the blade's root."""

HANDLE_M = GRIP_M + 0.03 - NECK_M
HANDLE_SECTION_M = (0.024, 0.018)
"""Length, and width and thickness of the handle."""

ADAPTER_M = (0.05, 0.045, 0.035)
"""The box around the handle that the fingers hold: along the handle, across it, through it."""

ROOT_M: Array = np.array([-BLADE_LENGTH_M, 0.0, -EDGE_M / 2])
"""The point where the neck meets the blade, in T."""

UP: Array = np.array([-np.cos(HANDLE_RISE_RAD), 0.0, np.sin(HANDLE_RISE_RAD)])
"""Direction along the handle, in T."""

_NECK_END_M = ROOT_M + NECK_M * UP
_HANDLE_END_M = ROOT_M + (NECK_M + HANDLE_M) * UP

_LOW_NECK_M = 0.03
"""Distance from its root up to which the neck may touch the table with the blade."""


def _beside(name: str, start_m: Array, end_m: Array, y_m: float, radius_m: float) -> tuple[Capsule, Capsule]:
    """A capsule on each side of the plane y = 0."""
    left, right = (
        Capsule(f"{name} of the spatula", FLANGE, start_m + aside, end_m + aside, radius_m)
        for aside in (np.array([0.0, y_m, 0.0]), np.array([0.0, -y_m, 0.0]))
    )
    return left, right


KEEP_CLEAR = (
    *_beside("neck", ROOT_M + _LOW_NECK_M * UP, _NECK_END_M, 0.0088, 0.0095),
    Capsule("handle of the spatula", FLANGE, _NECK_END_M, _HANDLE_END_M, 0.0152),
    *_beside("adapter", ROOT_M + (GRIP_M - 0.0198) * UP, ROOT_M + (GRIP_M + 0.0198) * UP, 0.0113, 0.0216),
)
"""The outline that must stay clear of arm, boxes and table, in T."""

_STRIP_M, _STRIP_RADIUS_M, _STRIP_INSET_M = BLADE_WIDTH_M / 3, 0.0146, 0.0055

MAY_TOUCH = (
    *(
        Capsule(
            "blade of the spatula",
            FLANGE,
            np.array([-_STRIP_INSET_M, y_m, 0.0]),
            np.array([_STRIP_INSET_M - BLADE_LENGTH_M, y_m, 0.0]),
            _STRIP_RADIUS_M,
        )
        for y_m in (-_STRIP_M, 0.0, _STRIP_M)
    ),
    *_beside("neck", ROOT_M, ROOT_M + _LOW_NECK_M * UP, 0.0088, 0.0095),
)
"""The outline of the part that slides on the table, in T; the motion's contact window limits how deep."""

BLADE_MASS_KG, TURNER_KG = 0.02, 0.12
_HANDLE_EDGE_M = 0.02

TOOL_MASS = mass.box(
    BLADE_MASS_KG, (BLADE_LENGTH_M, BLADE_WIDTH_M, EDGE_M), (-BLADE_LENGTH_M / 2, 0.0, -EDGE_M / 2)
) + mass.bar(TURNER_KG - BLADE_MASS_KG, ROOT_M, _HANDLE_END_M, _HANDLE_EDGE_M)
"""In T. The total is that of the example rig file (docs/guide/rig.md, `[tools.scooping.payload]`); all but the blade is
spread evenly along neck and handle."""

_APPROACH_LEAN_RAD, _APPROACH_TURN_RAD = float(np.deg2rad(60.7)), float(np.deg2rad(-53.8))
_FLANGE_TO_GRIP_M = 0.1034  # the Franka Hand's fingertips


def _mounting() -> Array:
    """(4, 4) the tool in the flange: the hand comes from behind and the left, its fingers close across the handle.

    Lean (from straight down) and turn of the approach, grip and rise come from a joint search. It minimised the worst
    ratio of any joint to its limits over contexts and actions (`benchmarks/executability.py`).
    """
    lean, turn = _APPROACH_LEAN_RAD, _APPROACH_TURN_RAD
    approach = np.array([np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), -np.cos(lean)])
    across = np.cross(UP, approach) / np.linalg.norm(np.cross(UP, approach))  # Y axis of the hand
    half = np.sqrt(0.5)  # the flange is rotated by 45° against the hand
    R_TH = np.column_stack([np.cross(across, approach), across, approach])
    R_TF = R_TH @ np.array([[half, -half, 0.0], [half, half, 0.0], [0.0, 0.0, 1.0]])
    p_TF_m = np.array([-BLADE_LENGTH_M, 0.0, 0.0]) + GRIP_M * UP - _FLANGE_TO_GRIP_M * approach
    return np.asarray(np.linalg.inv(pose(R_TF, p_TF_m)))


X_FT: Array = frozen_array(_mounting(), (4, 4))
"""The tool in the flange."""

CORNERS_M: Array = np.array([[0.0, side * (BLADE_WIDTH_M - EDGE_M) / 2, -EDGE_M + CORNER_M] for side in (1, -1)])
"""(2, 3) left and right: centres of the rounded corners on which the edge rides over the table, in T."""

TOUCHABLE = Touchable(
    feelers=tuple(
        Feeler(f"{side} corner of the {end}", CORNERS_M[i] + [x_m, 0.0, 0.0], CORNER_M)
        for end, x_m in (("edge", 0.0), ("heel", -BLADE_LENGTH_M))
        for i, side in enumerate(("left", "right"))
    ),
    centre_m=(0.66, 0.0),
    held_m=ADAPTER_M[1],
)
"""The blade's lower corners: two at its leading edge, two at its root."""

_NYLON = (0.015, 0.015, 0.017)
_TAPE = (0.25, 0.25, 0.27)


def spatula_visuals(blade_body: str, handle_body: str, lip_m: float = LIP_M) -> tuple[Visual, ...]:
    """Blade with a lip of `lip_m`, neck and handle of the turner, and the box that the gripper holds."""
    solid = blade(lip_m)
    neck = box(np.array(NECK_SIZE_M), (ROOT_M + _NECK_END_M) / 2, HANDLE_RISE_RAD)
    handle = box(
        np.array([HANDLE_M, *HANDLE_SECTION_M]), (_NECK_END_M + (_NECK_END_M + HANDLE_M * UP)) / 2, HANDLE_RISE_RAD
    )
    adapter = box(np.array(ADAPTER_M), ROOT_M + GRIP_M * UP, HANDLE_RISE_RAD)
    return (
        Visual(blade_body, solid.vertices_m, solid.triangles, _NYLON),
        Visual(handle_body, *neck, _NYLON),
        Visual(handle_body, *handle, _NYLON),
        Visual(handle_body, *adapter, _TAPE),
    )


_FIT_M = 0.0004
"""The channel is this much wider than the handle; the halves are this far apart."""


def parts() -> tuple[Part, ...]:
    """The adapter between handle and fingers: one of two equal halves that clamp the handle, which lies along X.

    Raises ExtraMissing.
    """
    length, width, height = ADAPTER_M
    channel_y, channel_z = (side + _FIT_M for side in HANDLE_SECTION_M)
    half = solid_box((length, width, height / 2 - _FIT_M / 2), (0.0, 0.0, -height / 4 - _FIT_M / 4))
    channel = solid_box((2 * length, channel_y, channel_z), (0.0, 0.0, 0.0))
    y = (width + channel_y) / 4
    holes = [hole((0.32 * sx * length, sy * y, 0.0), height) for sx in (-1, 1) for sy in (-1, 1)]
    return (
        Part(
            name="adapter",
            solid=cut(half, channel, *holes),
            count=2,
            down=np.array([0.0, 0.0, -1.0]),
            held_m=width,
            notes=(
                "Four M3 x 35 screws with nuts clamp the handle between the halves.",
                "For a handle of {:.0f} x {:.0f} mm; tape fills a gap.".format(*(1e3 * s for s in HANDLE_SECTION_M)),
                "Weigh turner and adapter together, and write it into [tools.scooping.payload].",
            ),
        ),
    )
