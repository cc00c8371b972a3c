"""Joins the parts of a calibration, and finds a rig's calibration."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.bench.calibration.parts import CalibrationRig, Ways
from adaptsim_cli.bench.calibration.store import CalibrationStore
from adaptsim_cli.bench.devices.mounted import weighed, workcell
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.rig_file.reading import BOARD, rig_of
from adaptsim_cli.config import Config, Places
from adaptsim_cli.screen.console import Screen
from calib.errors import CalibrationMissing
from calib.saved import SavedCalibration
from calib.types import HandEye
from hw.collision import camera_box
from hw.types import Array
from hw.workcell import Workcell
from perception.board.types import Board

if TYPE_CHECKING:
    from adaptsim_cli.bench.devices.drivers import Drivers
    from sim.lab.board import HeldBoard

BOARD_HOME_RAD = (0.0, -0.8, 0.0, -2.2, 0.0, 1.9, -0.785)
"""The arm's posture with the board: the arm is drawn back, and the board is between arm and camera."""

UNKNOWN_RAD = (0.0,) * 7
"""During a calibration that searches for the joint zeros, they are 0, so that its plans do not change on the way."""


def calibration_key(config: Config) -> str:
    """The folder of a rig's calibrations: one per task, world and seed in the simulated lab, else one per lab.

    The content of an own world file counts, not only its name. Raises UsageError if a real lab has no rig file.
    """
    if not config.is_simulated:
        return _plain(f"{config.hw}-{rig_of(config).name}")
    path = Path(config.world).expanduser()
    own = f"-{hashlib.sha256(path.read_bytes()).hexdigest()[:8]}" if path.is_file() else ""
    return _plain(f"lab-{config.task}-{path.stem}{own}-seed{config.seed}")


def calibrations(config: Config, places: Places) -> CalibrationStore:
    """The stored calibrations of the rig or world of these settings."""
    return CalibrationStore(places.calibrations / calibration_key(config))


def current_calibration(config: Config, places: Places) -> SavedCalibration | None:
    """The calibration in use for this rig; None if there is none. Raises SessionError if it is damaged."""
    return calibrations(config, places).current()


def calibration_of(config: Config, places: Places, nominal: HandEye | None) -> tuple[HandEye, Array]:
    """The camera pose that a session uses, and the joint zeros (7,) found with it.

    `nominal` is the calibration of a simulated lab. A real rig has none: without a calibration it raises
    CalibrationMissing, and nothing moves.
    """
    calibration = current_calibration(config, places)
    if calibration is not None:
        return calibration.hand_eye(), calibration.offsets_rad()
    if nominal is not None:
        return nominal, np.zeros(7)
    raise CalibrationMissing(
        f"hw = {config.hw}: this rig has no calibration, so nothing has moved. Calibrate it: adaptsim calibrate "
        f"--hw {config.hw}"
    )


@contextmanager
def open_calibration_rig(
    config: Config,
    board: Board,
    rough: SavedCalibration | None,
    drivers: Drivers | None = None,
    screen: Screen | None = None,
) -> Iterator[CalibrationRig]:
    """The connected devices, with the board in the gripper. Raises DeviceUnavailable, and the errors of `open_lab`.

    `rough` is an earlier calibration, if there is one: it gives the camera's place, for planning only. Without it
    nothing is planned, and the arm is guided by hand. `drivers` are those of a real lab's devices.
    """
    from sim.tasks import get_task

    with open_lab(config, get_task(config.task), drivers, screen) as lab:
        eye = lab.nominal if rough is None else rough.hand_eye()
        boxes = () if eye is None else (camera_box(eye.X_BC),)
        held, home_rad = held_board(board), np.array(BOARD_HOME_RAD)
        cell = workcell(lab.rig, UNKNOWN_RAD, weighed(held.tool(), lab.rig.tool(BOARD)), boxes)
        arm, camera, pause, hands, release = lab.for_calibration(held, cell, home_rad)
        yield CalibrationRig(
            name=config.hw,
            title=lab.title,
            key=calibration_key(config),
            arm=arm,
            camera=camera,
            board=board,
            X_FM=held.X_FM,
            rough_X_BC=None if eye is None else eye.X_BC,
            ways=ways(cell, home_rad),
            pause=pause,
            hands=hands,
            release=release,
        )


def held_board(board: Board) -> HeldBoard:
    """The board in the gripper, as in docs/guide/calibrate.md."""
    from perception.board import draw
    from sim.lab.board import HeldBoard

    return HeldBoard(draw(board, square_px=112), board.size_m)


def ways(cell: Workcell, home_rad: Array) -> Ways:
    """Plans paths between postures that keep clear of everything in `cell`."""
    from sim.panda import postures

    return Ways(
        postures=lambda X_BF: postures.postures(X_BF, cell, home_rad),
        way=lambda q_from, q_to: postures.way(q_from, q_to, home_rad, cell),
    )


def _plain(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9._-]", "-", name)
