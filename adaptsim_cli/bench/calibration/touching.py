"""The touch check: the board lies flat before the camera, and a tip touches one of its corners from four sides.

The board's pose by the camera and the tip's by the arm's kinematics must meet at that corner. It is offered after the
last view; a person may skip it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.bench.calibration.store import Series
from adaptsim_cli.bench.calibration.taking import ViewRefused, at_rest, look
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, enter, stop
from calib import files
from calib.touch import LIMIT_SCATTER_M, MIN_TOUCHES, pivot
from hw.bounded import encode_image
from hw.kinematics import forward
from hw.types import Array
from perception.board.types import Board, Corners
from perception.errors import BoardNotFound

TRIES = 3
PICTURE = "touch.jpg"
LEFT_OUT = "  no point is touched: that check is left out"
_SIDES = ("towards the camera", "away from the camera", "to the left", "to the right")
_LAY = (
    "A check by touch, two minutes: take the board out of the gripper and lay it flat in view of the camera, face up, "
    "the arm drawn back. Does it lie there?"
)


def offer(rig: CalibrationRig, series: Series, screen: Screen, *, unattended: bool) -> None:
    """Ask, take the picture and the touches, store them. Does nothing if already done, or if nobody is there.

    Raises StoppedByOperator, HardwareError, WrongBoard, BoardMirrored.
    """
    if series.has_touch or (unattended and rig.hands is None):
        return
    asking = _Asking(rig, screen, unattended)
    laid = asking.picture()
    if laid is None:
        screen.note(LEFT_OUT)
        return
    colour, corners = laid
    corner = middle(corners, rig.board)
    path = series.picture(PICTURE, ringed(colour, corners, corner))
    screen.show(f"  The corner ringed in {path.name}, beside the views, is touched from {MIN_TOUCHES} sides.")
    q_rad = asking.touches(corner)
    if q_rad is None:
        screen.note(LEFT_OUT)
        return
    series.write_touch(files.touch_files(colour, corner, q_rad))


def middle(corners: Corners, board: Board) -> int:
    """The visible corner nearest to the board's centre, where its pose is best known."""
    p = board.p_MK_m[corners.ids]
    return int(corners.ids[np.linalg.norm(p - board.outline_m.mean(axis=0), axis=1).argmin()])


def ringed(colour: NDArray[np.uint8], corners: Corners, corner: int) -> bytes:
    """JPEG of the picture (H, W, 3 RGB) with a ring around that corner."""
    image = np.ascontiguousarray(colour[..., ::-1])
    u, v = corners.px[int(np.flatnonzero(corners.ids == corner)[0])]
    radius = max(6, image.shape[0] // 40)
    cv2.circle(image, (round(16 * u), round(16 * v)), 16 * radius, (40, 40, 230), 2, cv2.LINE_AA, shift=4)
    return encode_image(image, ".jpg")


@dataclass(frozen=True, eq=False)
class _Asking:
    """The steps of a person, or of the lab in place of a person."""

    rig: CalibrationRig
    screen: Screen
    unattended: bool

    def picture(self) -> tuple[NDArray[np.uint8], Corners] | None:
        """The picture of the lying board; None if skipped, or not found in several tries."""
        from perception.board import detect

        for _ in range(TRIES):
            if not self._go_on(_LAY):
                return None
            if self.rig.hands is not None:
                self.rig.hands.lay_board()
            try:
                shot = look(self.rig)
                return shot.frame.colour, detect(shot.frame.colour, self.rig.board, self.rig.camera.model().colour)
            except (ViewRefused, BoardNotFound) as error:
                self.screen.note(f"  try again: {error}")
        return None

    def touches(self, corner: int) -> Array | None:
        """(N, 7) reported joints, repeated if they disagree; None if skipped."""
        for attempt in range(TRIES):
            postures: list[Array] = []
            for i in range(MIN_TOUCHES):
                q = self._touch(corner, attempt * MIN_TOUCHES + i)
                if q is None:
                    return None
                postures.append(q)
            q_rad = np.array(postures)
            scatter_m = pivot(forward(q_rad)).scatter_m
            self.screen.show(f"  {MIN_TOUCHES} touches agree to {1e3 * scatter_m:.2f} mm")
            if scatter_m <= LIMIT_SCATTER_M:
                break
            self.screen.note(f"  limit {1e3 * LIMIT_SCATTER_M:.0f} mm: the tip slipped, or the board did; touch again")
        return q_rad

    def _touch(self, corner: int, number: int) -> Array | None:
        """(7,) reported joints of one touch at rest; None if skipped, or the arm does not come to rest in several
        tries.
        """
        question = (
            f"Touch {number % MIN_TOUCHES + 1} of {MIN_TOUCHES}: guide the tip to the corner, the gripper leaning "
            f"{_SIDES[number % len(_SIDES)]} by 20 to 40°, let go. At rest?"
        )
        for _ in range(TRIES):
            if not self._go_on(question):
                return None
            if self.rig.hands is not None:
                self.rig.hands.touch(self.rig.board.p_MK_m[corner], number)
            try:
                return at_rest(self.rig).q_rad
            except ViewRefused as error:
                self.screen.note(f"  try again: {error}")
        return None

    def _go_on(self, question: str) -> bool:
        """Enter is yes, n no. Raises StoppedByOperator at q."""
        if self.unattended:
            return True
        go_on = enter("to go on", "The program takes the picture, or reads the joints.")
        leave_out = Key("n", "to leave this out", "The calibration is solved without the touched corner.")
        way_out = stop("The command ends; the views so far are stored, and the same command goes on with them.")
        answer = self.screen.choose(question, go_on, leave_out, way_out)
        if answer == "q":
            raise StoppedByOperator("stopped by the operator; the views so far are stored")
        return answer == ""
