"""A short swing of the board before the running camera, to measure the time offset between camera and arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptsim_cli.calibration.parts import CalibrationRig
from adaptsim_cli.calibration.store import Series
from adaptsim_cli.screen.console import Screen
from hw.types import Array, Execution, Frame, JointPath
from perception.errors import PerceptionError
from sim.errors import NotExecutable

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


def _as_json(rig: CalibrationRig, played: Execution, frames: tuple[Frame, ...] | Any) -> dict[str, Any]:
    from perception.board import detect

    seen: list[dict[str, Any]] = []
    for frame in frames:
        try:
            corners = detect(frame.colour, rig.board, rig.camera.model().colour)
        except PerceptionError:
            continue  # the board is blurred or half hidden in this frame
        seen.append({"t_s": frame.t_s, "ids": corners.ids.tolist(), "px": corners.px.tolist()})
    every = max(1, round(ARM_PERIOD_S / float(played.t_s[1] - played.t_s[0])))
    t_s: Array = played.t_start_s + played.t_s[::every]
    return {"frames": seen, "arm_t_s": t_s.tolist(), "q_rad": played.q_measured_rad[::every].tolist()}
