"""Joins the real parts of a calibration, and finds the calibration that a rig has. The other half of `wiring`."""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from adaptsim_cli.calibration.parts import CalibrationRig, Ways
from adaptsim_cli.calibration.store import CalibrationStore
from adaptsim_cli.config import Config, Places
from calib.errors import CalibrationMissing
from calib.saved import SavedCalibration
from calib.types import HandEye
from hw.collision import KeepOut, Tool
from hw.errors import DeviceUnavailable
from hw.types import Array
from perception.board_types import Board

CAMERA_ROOM_M = 0.12
"""Half the edge of the box around the camera that the arm keeps out of."""

BOARD_HOME_RAD = (0.0, -0.8, 0.0, -2.2, 0.0, 1.9, -0.785)
"""Where the arm stands with the board: drawn back, the board between it and the camera."""


def calibration_key(config: Config) -> str:
    """The folder of a rig's calibrations: of the simulated lab one a task, world and seed, else one an arm.

    The content of an own world file counts, not only its name.
    """
    if config.hw != "fake":
        return _plain(f"{config.hw}-{config.host or 'arm'}")
    path = Path(config.world).expanduser()
    own = f"-{hashlib.sha256(path.read_bytes()).hexdigest()[:8]}" if path.is_file() else ""
    return _plain(f"lab-{config.task}-{path.stem}{own}-seed{config.seed}")


def calibrations(config: Config, places: Places) -> CalibrationStore:
    return CalibrationStore(places.calibrations / calibration_key(config))


def current_calibration(config: Config, places: Places) -> SavedCalibration | None:
    """The calibration in use for this rig; None where there is none. Raises SessionError where it is damaged."""
    return calibrations(config, places).current()


def calibration_of(config: Config, places: Places, nominal: HandEye | None) -> tuple[HandEye, Array]:
    """The camera's pose that a session works with, and the joint offsets (7,) found with it.

    `nominal` is what a simulated lab comes with. A real rig has none: without a calibration CalibrationMissing is
    raised, and nothing moves.
    """
    known = current_calibration(config, places)
    if known is not None:
        return known.hand_eye(), known.offsets_rad()
    if nominal is not None:
        return nominal, np.zeros(7)
    raise CalibrationMissing(
        f"hw = {config.hw}: where the camera stands is not known, so nothing has moved. Find out: adaptsim calibrate "
        f"--hw {config.hw}"
    )


@contextmanager
def open_calibration_rig(config: Config, board: Board, rough: SavedCalibration | None) -> Iterator[CalibrationRig]:
    """The devices, connected, with the board in the gripper. Raises SimError, DeviceUnavailable.

    `rough` is an earlier calibration, if there is one: where the camera stands, for planning alone.
    """
    if config.hw != "fake":
        raise DeviceUnavailable(
            f"hw = {config.hw}: the driver of this arm is not part of this version yet, so nothing has moved. "
            "Use --hw fake for the simulated lab, or `adaptsim calibrate solve` for views recorded elsewhere"
        )
    from hw.kinematics import forward
    from perception.board import draw
    from sim.lab.board import HeldBoard
    from sim.lab.calibrating import CalibrationLab
    from sim.tasks import get_task
    from sim.world import load_world

    logging.getLogger("drake").setLevel(logging.ERROR)  # its warnings are about features that no scene uses
    task = get_task(config.task)
    world = load_world(config.world, task)
    held = HeldBoard(draw(board, square_px=112), board.size_m)
    home_rad = np.array(BOARD_HOME_RAD)
    lab = CalibrationLab(task, world, config.seed, held, home_q_rad=home_rad)
    nominal = lab.nominal_calibration().X_BC
    rough_X_BC = nominal if rough is None else np.array(rough.X_AC)
    with lab:
        yield CalibrationRig(
            name="fake",
            title=f"simulated lab, world {world.name}",
            key=calibration_key(config),
            arm=lab.arm,
            camera=lab.camera,
            board=board,
            X_FM=held.X_FM,
            rough_X_BC=rough_X_BC,
            ways=ways(held.tool(), lab.arm.model, home_rad, camera_box(rough_X_BC)),
            flange=forward,
            pause=lambda _: None,
        )


def ways(tool: Tool, model: str, home_rad: Array, keep_out: tuple[KeepOut, ...]) -> Ways:
    from sim.panda import visits

    return Ways(
        postures=lambda X_BF: visits.postures(X_BF, model, home_rad, tool, keep_out),
        order=visits.nearest_first,
        way=lambda q_from, q_to: visits.way(q_from, q_to, home_rad, model, tool, keep_out),
    )


def camera_box(X_BC: Array) -> tuple[KeepOut, ...]:
    at = np.asarray(X_BC)[:3, 3]
    return (KeepOut("camera", at - CAMERA_ROOM_M, at + CAMERA_ROOM_M),)


def _plain(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]", "-", name)
