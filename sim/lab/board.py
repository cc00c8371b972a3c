"""The calibration board in the lab's gripper: a rigid printed plate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from hw import mass
from hw.capsules import Capsule
from hw.collision import HAND_MASS, Tool, hand_with
from hw.kinematics import FLANGE
from hw.mass import Mass
from hw.types import Array
from sim.panda.shapes import Primitive, mesh
from sim.tasks.shared.shapes import cut, hole, joined, solid_box
from sim.types import Part, Texture, Visual

BODY = "board"
MARGIN_M = 0.012
"""White margin around the print; the gripper holds the upper margin by a tab."""
THICKNESS_M = 0.006
BOARD_KG_M2 = 7.0
"""Area density (kg/m²) of an aluminium sandwich board of that thickness (makers state 6.6 to 7.3)."""
GRIP_M = 0.115
"""Distance from the flange to the plate's upper edge, along the flange's axis: just beyond the fingertips."""

TAB_M = (0.03, 0.05)
"""Width and height of the tab between the fingers."""

_WHITE, _EDGE = 0.80, (0.30, 0.30, 0.32)
_TEXEL_M = 0.001
_CAPSULE_M = 0.018
_CLEARANCE_M = 0.01
_TAB_Y_M, _TAB_HALF_M, _TAB_RADIUS_M = -MARGIN_M - 0.02, 0.0185, 0.0168  # the capsule that contains the tab


@dataclass(frozen=True, eq=False)
class HeldBoard:
    """A printed pattern and its pose in the hand.

    The frame M of the print is that of `perception.board.types.Board`.
    """

    pattern: NDArray[np.uint8]  # (h, w) grey; the print without its margin, upright
    size_m: tuple[float, float]  # width and height stated by its maker

    @property
    def X_FM(self) -> Array:
        """(4, 4) planned pose in the flange: square to the closed fingers, hanging along the flange's axis.

        The fingers open along the hand's Y axis, which lies at 45° between X and Y of the flange.
        """
        s = np.sqrt(0.5)
        X = np.eye(4)
        X[:3, :3] = np.array([[-s, s, 0.0], [0.0, 0.0, 1.0], [s, s, 0.0]]).T
        width, _ = self.size_m
        X[:3, 3] = -width / 2 * X[:3, 0] + (GRIP_M + MARGIN_M) * X[:3, 1] - THICKNESS_M / 2 * X[:3, 2]
        return X

    def scaled(self, factor: float) -> HeldBoard:
        """The same pattern, printed larger or smaller than stated."""
        width, height = self.size_m
        return replace(self, size_m=(factor * width, factor * height))

    @property
    def mass_F(self) -> Mass:
        """The plate's mass in the flange frame, without the hand."""
        width, height = outline_m = np.array(self.size_m) + 2 * MARGIN_M
        centre_m = (*(outline_m / 2.0 - MARGIN_M), THICKNESS_M / 2)
        return mass.box(BOARD_KG_M2 * width * height, (width, height, THICKNESS_M), centre_m).placed(self.X_FM)

    def tool(self) -> Tool:
        """The hand with the plate, as capsules side by side, for the checks of `hw.limits`."""
        width, height = (length + 2 * MARGIN_M for length in self.size_m)
        count = int(np.ceil(width / (1.5 * _CAPSULE_M))) + 1
        x = np.linspace(_CAPSULE_M, width - _CAPSULE_M, count) - MARGIN_M
        X = self.X_FM
        plate = []
        for i, along in enumerate(x):
            rows = (_CAPSULE_M - MARGIN_M, height - MARGIN_M - _CAPSULE_M)
            ends = np.array([[along, y, THICKNESS_M / 2] for y in rows])
            start, end = ends @ X[:3, :3].T + X[:3, 3]
            plate.append(Capsule(f"board strip {i + 1}", FLANGE, start, end, _CAPSULE_M + _CLEARANCE_M))
        tab = np.array([[width / 2 - MARGIN_M, _TAB_Y_M + side * _TAB_HALF_M, THICKNESS_M / 2] for side in (-1, 1)])
        start, end = tab @ X[:3, :3].T + X[:3, 3]
        plate.append(Capsule("tab of the board", FLANGE, start, end, _TAB_RADIUS_M))
        return hand_with(HAND_MASS + self.mass_F, tuple(plate), name="calibration board")

    def visuals(self) -> tuple[Visual, ...]:
        """Plate with the print on its face, and the tab in the gripper; fixed to the flange."""
        X, (width, height) = self.X_FM, self.size_m
        centre = np.array([width / 2, height / 2, THICKNESS_M / 2])
        plate = Primitive(BODY, "box", (width + 2 * MARGIN_M, height + 2 * MARGIN_M, THICKNESS_M), tuple(centre))
        tab = Primitive(BODY, "box", (*TAB_M, THICKNESS_M), (width / 2, _TAB_Y_M, THICKNESS_M / 2))
        face = Texture(self._albedo(), X, self.size_m)
        return (
            Visual(BODY, *_placed(plate, X), (_WHITE, _WHITE, _WHITE), face),
            Visual(BODY, *_placed(tab, X), _EDGE),
        )

    def _albedo(self) -> NDArray[np.float32]:
        """The print with dark grey ink and off-white paper, one texel per millimetre."""
        size = tuple(round(length / _TEXEL_M) for length in self.size_m)
        grey = cv2.resize(self.pattern.astype(np.float32) / 255, size, interpolation=cv2.INTER_AREA)
        return np.asarray(0.035 + (_WHITE - 0.035) * grey, dtype=np.float32)


def _placed(primitive: Primitive, X: Array) -> tuple[Array, NDArray[np.int32]]:
    vertices, triangles = mesh(primitive)
    return vertices @ X[:3, :3].T + X[:3, 3], triangles


_RIB_M, _PAD_M, _LAP_M = 0.004, 0.04, 0.012  # thickness; height behind the board, and behind the tab


def holder() -> Part:
    """The tab by which the hand holds the board, for printing. Raises ExtraMissing.

    Its frame: the middle of the board's upper edge, X along it, Y down, Z back.
    """
    width, height = TAB_M
    above = height - MARGIN_M / 2
    tab = solid_box((width, above, THICKNESS_M), (0.0, -above / 2, THICKNESS_M / 2))
    rib_z = THICKNESS_M + _RIB_M / 2
    rib = solid_box((width, _PAD_M + _LAP_M, _RIB_M), (0.0, (_PAD_M - _LAP_M) / 2, rib_z))
    holes = [hole((0.0, share * _PAD_M, rib_z), _RIB_M) for share in (0.3, 0.8)]
    return Part(
        name="board-holder",
        solid=cut(joined(tab, rib), *holes),
        down=np.array([1.0, 0.0, 0.0]),
        held_m=THICKNESS_M,
        notes=(
            "Lies on its side, no supports. The closed fingers hold the tab, its lower end just beyond them.",
            "Two M3 x 12 screws through the board, or glue, behind the middle of its upper edge.",
        ),
    )
