"""Takes one view with the arm at rest before and after the picture, and films a swing for the time offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.bench.calibration.store import Series
from adaptsim_cli.screen import guided
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.guided import DRIFT_RAD, REST_RAD_S, state_of
from hw.types import ArmState, Array, Execution, Frame, JointPath
from perception.errors import PerceptionError
from sim.errors import NotExecutable

APART_S = 0.25
"""Largest time between picture and joints on the arm's clock."""


class ViewRefused(Exception):
    """This view does not count; the next may. The message gives the reason."""


@dataclass(frozen=True, eq=False)
class Look:
    """A frame with its joints."""

    frame: Frame
    q_rad: Array  # (7,)
    t_arm_s: float


def look(rig: CalibrationRig) -> Look:
    """Wait for rest and take one picture.

    Raises ViewRefused if the arm does not stay at rest or a person does not release it, CameraError, ArmFault.
    """
    before = at_rest(rig)
    frame = rig.camera.snapshot()
    after = state_of(rig.arm)
    if after.fault is not None:
        raise ViewRefused(f"while the picture was taken: {after.fault}")
    crept = float(np.abs(after.q_rad - before.q_rad).max())
    speed = float(np.abs(after.dq_rad_s).max())
    if crept > DRIFT_RAD or speed > REST_RAD_S:
        raise ViewRefused(
            f"the arm moved while the picture was taken: by {1e3 * crept:.2f} mrad (limit {1e3 * DRIFT_RAD:g}), "
            f"at {1e3 * speed:.1f} mrad/s (limit {1e3 * REST_RAD_S:g}); let go of it and take the view again"
        )
    t_arm_s = (before.t_s + after.t_s) / 2
    if abs(frame.t_s - t_arm_s) > APART_S + (after.t_s - before.t_s) / 2:
        raise ViewRefused(
            f"picture and joints are {frame.t_s - t_arm_s:+.3f} s apart (limit {APART_S:g} s): an old picture, or "
            "clocks that disagree; check the time synchronisation of camera and arm"
        )
    return Look(frame, (before.q_rad + after.q_rad) / 2, t_arm_s)


def at_rest(rig: CalibrationRig) -> ArmState:
    """The arm's state at rest, with nobody guiding it. Raises ViewRefused, ArmFault."""
    try:
        return guided.at_rest(rig.arm, rig.pause)
    except guided.NotAtRest as error:
        raise ViewRefused(str(error)) from error


SWING_RAD = 0.14
"""Amplitude of joint 1: about 60 px in about a second."""
ARM_PERIOD_S = 0.01


def record_motion(rig: CalibrationRig, series: Series, screen: Screen) -> None:
    """Swing, film, store the board's corners and the joints. Says so if there is no room to swing.

    Raises ArmFault, CameraError.
    """
    path = _swing(rig)
    if path is None:
        screen.note("  no room to swing the board here: the time offset between camera and arm is not measured")
        return
    with screen.busy("Filming a swing of the board, for the time offset between camera and arm"):
        rig.camera.start_recording()
        played = rig.arm.execute(path)
        frames = rig.camera.stop_recording()
        series.write_motion(_as_json(rig, played, frames))


def _swing(rig: CalibrationRig) -> JointPath | None:
    q_now = rig.arm.state().q_rad
    for swing in (SWING_RAD, -SWING_RAD):
        try:
            return rig.ways.way(q_now, q_now + np.array([swing, 0, 0, 0, 0, 0, 0]))
        except NotExecutable:
            continue
    return None


def _as_json(rig: CalibrationRig, played: Execution, frames: Sequence[Frame]) -> dict[str, Any]:
    from perception.board import detect

    rows: list[dict[str, Any]] = []
    for frame in frames:
        try:
            corners = detect(frame.colour, rig.board, rig.camera.model().colour)
        except PerceptionError:
            continue  # the board is blurred or half hidden in this frame
        rows.append({"t_s": frame.t_s, "ids": corners.ids.tolist(), "px": corners.px.tolist()})
    every = max(1, round(ARM_PERIOD_S / float(played.t_s[1] - played.t_s[0])))
    t_s: Array = played.t_start_s + played.t_s[::every]
    return {"frames": rows, "arm_t_s": t_s.tolist(), "q_rad": played.q_measured_rad[::every].tolist()}
