"""The pusher, a plate on a stem to be printed in one piece: shape, mass, looks, prints, and how the hand holds it.

The tool frame T is at the middle of the lower edge of the plate's front face: X forward out of the face, the way it
pushes, Y to the left, Z up along the plate.
"""

from __future__ import annotations

import math

import numpy as np

from hw import mass
from hw.capsules import Capsule
from hw.kinematics import FLANGE
from hw.poses import pose
from hw.types import Array, frozen_array
from sim.tasks.pushing.params import PATCH_SIZE_M, PATCH_X_M
from sim.tasks.shared.shapes import Shape, box, cut, joined, library, solid_box
from sim.types import Part, Visual

PLATE_WIDTH_M = 0.12
PLATE_HEIGHT_M = 0.08
PLATE_THICKNESS_M = 0.005
PLATE_M = (PLATE_THICKNESS_M, PLATE_WIDTH_M, PLATE_HEIGHT_M)
PLATE_CENTRE_M = (-PLATE_THICKNESS_M / 2, 0.0, PLATE_HEIGHT_M / 2)
"""Edge lengths of the plate, and its middle in T."""

ROOT_M: Array = frozen_array([-PLATE_THICKNESS_M, 0.0, 0.05], (3,))
"""The point where the stem meets the plate's back, in T."""

GRIP_M: Array = frozen_array([-0.074, 0.072, 0.125], (3,))
"""The middle of the block that the fingers hold, in T."""

STEM_M = 0.022
BLOCK_M = (0.024, 0.024, 0.036)
"""Edge lengths of stem and block; the block's last one runs along the hand."""

PLATE_MASS_KG = 0.1
"""The whole pusher, spread evenly over plate, stem and block."""

_LEAN_RAD, _TURN_RAD, _ROLL_RAD = 1.174, 1.237, -2.878
_FLANGE_TO_GRIP_M = 0.1034  # the Franka Hand's fingertips


def _mounting() -> Array:
    """(4, 4) the tool in a flange whose hand holds it at `GRIP_M`.

    The hand comes from above, leaning `_LEAN_RAD` from straight down towards the heading `_TURN_RAD` about Z;
    `_ROLL_RAD` rotates it about its own axis. Grip, lean, turn and roll come from a joint search. It minimised the
    worst ratio of any joint of either arm to its limits over the action space (docs/decisions/0008).
    """
    cos, sin = np.cos(_TURN_RAD), np.sin(_TURN_RAD)
    approach = np.array([np.sin(_LEAN_RAD) * cos, np.sin(_LEAN_RAD) * sin, -np.cos(_LEAN_RAD)])
    across = np.array([sin, -cos, 0.0])
    along = np.cross(across, approach)
    c, s = np.cos(_ROLL_RAD), np.sin(_ROLL_RAD)
    R_TF = np.column_stack([c * along + s * across, c * across - s * along, approach])
    return np.asarray(np.linalg.inv(pose(R_TF, GRIP_M - _FLANGE_TO_GRIP_M * approach)))


X_FT: Array = frozen_array(_mounting(), (4, 4))
"""The tool in the flange (docs/decisions/0008)."""


def _block_axes() -> Array:
    """(3, 3) the hand's axes in T: the fingers close along the second, the third runs along the hand."""
    half = np.sqrt(0.5)  # the hand is rotated by -45° against the flange
    return np.asarray(np.linalg.inv(X_FT)[:3, :3] @ [[half, half, 0.0], [-half, half, 0.0], [0.0, 0.0, 1.0]])


_ROWS, _ROW_RADIUS_M, _ROW_INSET_M = 4, 0.0106, 0.0024


def _row(number: int) -> Capsule:
    """A capsule across the plate that contains an equal share of its height."""
    x_m, z_m = -PLATE_THICKNESS_M / 2, (number + 0.5) * PLATE_HEIGHT_M / _ROWS
    start, end = (np.array([x_m, side * (PLATE_WIDTH_M / 2 - _ROW_INSET_M), z_m]) for side in (-1, 1))
    return Capsule("plate of the pusher", FLANGE, start, end, _ROW_RADIUS_M)


def _block() -> Capsule:
    half_m = 0.0105 * _block_axes()[:, 2]
    return Capsule("block of the pusher", FLANGE, GRIP_M - half_m, GRIP_M + half_m, 0.0187)


KEEP_CLEAR = (
    *(_row(number) for number in range(_ROWS)),
    Capsule("stem of the pusher", FLANGE, ROOT_M, GRIP_M, STEM_M * np.sqrt(0.5)),
    _block(),
)
"""The outline of the pusher, in T, which must stay clear of arm, boxes and table."""


def _mass() -> mass.Mass:
    plate_m3, block_m3 = math.prod(PLATE_M), math.prod(BLOCK_M)
    stem_m3 = STEM_M**2 * float(np.linalg.norm(GRIP_M - ROOT_M))
    kg_m3 = PLATE_MASS_KG / (plate_m3 + stem_m3 + block_m3)
    plate, stem = mass.box(kg_m3 * plate_m3, PLATE_M, PLATE_CENTRE_M), mass.bar(kg_m3 * stem_m3, ROOT_M, GRIP_M, STEM_M)
    return plate + stem + mass.box(kg_m3 * block_m3, BLOCK_M, (0.0, 0.0, 0.0)).placed(pose(_block_axes(), GRIP_M))


TOOL_MASS = _mass()
"""In T, without the hand."""

_PRINT = (0.02, 0.05, 0.16)


def pusher_visuals(body: str) -> tuple[Visual, ...]:
    """Plate, stem and the block that the fingers hold, in the tool frame."""
    plate = box(np.array(PLATE_M), np.array([-PLATE_THICKNESS_M, 0.0, PLATE_HEIGHT_M]) / 2)
    length_m = float(np.linalg.norm(GRIP_M - ROOT_M))
    along = (GRIP_M - ROOT_M) / np.linalg.norm(GRIP_M - ROOT_M)
    beside = np.cross([0.0, 0.0, 1.0], along) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], along))
    axes = np.column_stack([along, beside, np.cross(along, beside)])
    stem = _turned(axes, np.array([length_m, STEM_M, STEM_M]), (ROOT_M + GRIP_M) / 2)
    block = _turned(_block_axes(), np.array(BLOCK_M), GRIP_M)
    return tuple(Visual(body, *shape, _PRINT) for shape in (plate, stem, block))


def _turned(R: Array, size_m: Array, centre_m: Array) -> Shape:
    """A box along the axes that are the columns of `R` (3, 3)."""
    vertices_m, triangles = box(size_m, np.zeros(3))
    return vertices_m @ R.T + centre_m, triangles


_LONGER_ROOT_M = 0.02
"""The stem's end is oblique to the plate. As drawn, half of it would touch; the print's is this much longer."""


def parts() -> tuple[Part, ...]:
    """Plate, stem and block in one piece, in the tool frame T, and the patch. Raises ExtraMissing."""
    plate, stem, block = (library().Trimesh(one.vertices_m, one.triangles) for one in pusher_visuals("pusher"))
    root = stem.copy()
    root.apply_translation(_LONGER_ROOT_M * (ROOT_M - GRIP_M) / np.linalg.norm(ROOT_M - GRIP_M))
    front = solid_box((0.1, 0.4, 0.4), (0.05, 0.0, 0.0))
    pusher = Part(
        name="pusher",
        solid=cut(joined(plate, stem, root, block), front),
        down=np.array([1.0, 0.0, 0.0]),
        held_m=BLOCK_M[1],
        mass=TOOL_MASS,
        notes=(
            "Plate down, with supports under the stem, four walls.",
            "Wind two rubber bands around the lower half of the plate: they are part of the task's friction.",
        ),
    )
    patch = Part(
        name="patch",
        solid=solid_box((PATCH_SIZE_M, PATCH_SIZE_M, 0.001), (0.0, 0.0, 0.0)),
        flat=True,
        notes=(f"its middle {PATCH_X_M:.2f} m ahead of the arm's foot, its edges along X and Y",),
    )
    return pusher, patch
