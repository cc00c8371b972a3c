"""The lab with a board: what its camera sees of it, and what its arm does not know of itself."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import pytest

from calib.touch import pivot
from hw.errors import ArmFault, CameraError
from hw.joint_limits import LIMITS
from hw.kinematics import forward
from hw.types import Array, Frame, Intrinsics
from perception.board import detect, draw, locate
from perception.board.types import Board
from sim.errors import SimError
from sim.lab.arm import AIM_STD_M, TIP_M, touching_q_rad
from sim.lab.board import HeldBoard
from sim.lab.calibrating import CalibrationLab
from sim.lab.kinect import default_X_BC
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Faults, Mount, Sensing, World, load_world
from sim.panda.moves import move_path
from sim.panda.postures import postures
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

pytestmark = pytest.mark.long

BOARD = Board()
HELD = HeldBoard(draw(BOARD, 112), BOARD.size_m)
CELL = cell_as_shipped(get_task("scooping").require_hardware(), "panda").holding(HELD.tool())
NEAR_RAD = (0.0, -0.8, 0.0, -2.2, 0.0, 1.9, -0.785)


def world(**sensing: Any) -> World:
    return replace(load_world("wd", get_task("scooping")), sensing=Sensing(**sensing))


@lru_cache
def q_rad() -> Array:
    """(7,) the board 0.8 m before the camera, tilted by 25°."""
    X_CM = np.eye(4)
    X_CM[:3, :3] = cv2.Rodrigues(np.deg2rad(np.array([20.0, 15.0, 8.0])))[0]
    X_CM[:3, 3] = np.array([0.05, -0.12, 0.8]) - X_CM[:3, :3] @ np.array([*np.array(BOARD.size_m) / 2, 0])
    (found,) = postures((default_X_BC() @ X_CM @ np.linalg.inv(HELD.X_FM))[None], CELL, NEAR_RAD)
    assert found is not None
    return found


def lab(the_world: World, seed: int = 0) -> CalibrationLab:
    return CalibrationLab(get_task("scooping"), the_world, seed, HELD, CELL, home_q_rad=q_rad())


@lru_cache
def frame() -> Frame:
    with lab(world()) as bench:
        return bench.camera.snapshot()


def expected_px(ids: np.ndarray, camera: Intrinsics, X_BC: Array, zeros_rad: Array | float = 0.0) -> Array:
    X = np.linalg.inv(X_BC) @ forward(q_rad() + zeros_rad) @ HELD.X_FM
    p = BOARD.p_MK_m[ids] @ X[:3, :3].T + X[:3, 3]
    return cv2.projectPoints(p, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0].reshape(-1, 2)


def test_corners_come_out_where_they_are() -> None:
    with lab(world()) as bench:
        model = bench.camera.model()
    seen = detect(frame().colour, BOARD, model.colour)
    assert len(seen) == BOARD.corners
    off = seen.px - expected_px(seen.ids, model.colour, default_X_BC())
    assert np.sqrt((off**2).mean()) < 0.08
    assert np.abs(off.mean(axis=0)).max() < 0.04


def test_the_infrared_image_shows_the_board_too() -> None:
    with lab(world()) as bench:
        model = bench.camera.model()
    dark = frame().infrared
    assert dark is not None
    seen = detect(dark, BOARD, model.depth)
    assert len(seen) >= 20
    off = seen.px - expected_px(seen.ids, model.depth, default_X_BC() @ model.X_CD)
    assert np.sqrt((off**2).mean()) < 0.25


def test_equal_inputs_give_equal_bytes() -> None:
    with lab(world()) as bench:
        again = bench.camera.snapshot()
    assert np.array_equal(again.colour, frame().colour)
    assert np.array_equal(again.depth_mm, frame().depth_mm)
    assert again.infrared is not None
    assert np.array_equal(again.infrared, frame().infrared)


def test_hidden_joint_zeros_move_the_board_and_not_what_the_arm_says() -> None:
    hidden = lab(world(joint_offset_mrad=3.0), seed=5)
    zeros = np.array(hidden.truth()["joint_offset_rad"])
    assert np.sqrt((zeros**2).mean()) == pytest.approx(3e-3, rel=0.8)
    with hidden as bench:
        assert bench.arm.state().q_rad == pytest.approx(q_rad())
        picture, camera = bench.camera.snapshot(), bench.camera.model().colour
    seen = detect(picture.colour, BOARD, camera)
    off = seen.px - expected_px(seen.ids, camera, default_X_BC(), zeros)
    assert np.sqrt((off**2).mean()) < 0.1
    assert np.linalg.norm(off - (seen.px - expected_px(seen.ids, camera, default_X_BC())), axis=1).min() > 0.3


def test_the_same_lab_has_the_same_arm_and_camera_with_and_without_board() -> None:
    the_world = world(joint_offset_mrad=1.0)
    other = SimulatedLab(get_task("scooping"), the_world, 5, CELL)
    assert lab(the_world, 5).truth()["joint_offset_rad"] == other.truth()["joint_zeros_rad"]
    assert lab(the_world, 5).truth()["X_BC"] == other.truth()["X_BC"]


def test_encoder_noise_belongs_to_the_posture() -> None:
    """Whoever comes back to a posture finds it as it was, in a resumed run too; another one has another error."""
    bench = lab(world(encoder_noise_mrad=1.0)).arm
    first = bench.error_rad
    bench.q_rad = bench.q_rad + 0.1
    assert np.abs(bench.error_rad - first).max() > 1e-4
    bench.q_rad = q_rad()
    assert np.array_equal(bench.error_rad, first)


def test_the_person_of_the_lab_touches_what_the_camera_sees() -> None:
    p_M_m = BOARD.p_MK_m[14]
    with lab(world(joint_offset_mrad=2.0), 5) as bench:
        zeros_rad = np.array(bench.truth()["joint_offset_rad"])
        with pytest.raises(SimError, match="still in the gripper"):
            bench.hands.touch(p_M_m, 0)
        bench.hands.lay_board()
        camera = bench.camera.model().colour
        seen = detect(bench.camera.snapshot().colour, BOARD, camera)
        touches = []
        for number in range(4):
            bench.hands.touch(p_M_m, number)
            touches.append(bench.arm.state().q_rad)
    assert len(seen) == BOARD.corners
    p_B_m = (default_X_BC() @ locate(seen, BOARD, camera).X_VM @ [*p_M_m, 1.0])[:3]
    off_mm = {
        name: 1e3 * np.linalg.norm(pivot(forward(np.array(touches) + extra_rad)).p_AT_m - p_B_m)
        for name, extra_rad in (("known", zeros_rad), ("unknown", 0.0))
    }
    assert off_mm["known"] < 1.0
    assert off_mm["unknown"] > off_mm["known"] + 0.5


def test_the_arm_refuses_to_put_the_board_into_the_table() -> None:
    down = q_rad() + np.array([0, 0.9, 0, 0, 0, 0, 0])
    with lab(world()) as bench, pytest.raises(Exception, match="table"):
        bench.arm.execute(move_path(q_rad(), down, LIMITS["panda"]))


def test_faults_come_at_their_motion_and_picture() -> None:
    there = q_rad() + np.array([0.05, 0, 0, 0, 0, 0, 0])
    path = move_path(q_rad(), there, LIMITS["panda"])
    with lab(replace(world(), faults=Faults(arm_reflex=(1,)))) as bench:
        with pytest.raises(ArmFault, match="reflex"):
            bench.arm.execute(path)
        assert bench.arm.state().fault is not None
    with lab(replace(world(), faults=Faults(camera_timeout=(1,)))) as bench, pytest.raises(CameraError):
        bench.camera.snapshot()


def test_a_person_leans_the_arm_less_where_it_hardly_reaches() -> None:
    leans = []
    for x_m in (0.60, 0.72):
        q_rad = touching_q_rad(np.array([x_m, 0.0, 0.006]), 0, np.random.default_rng(0))
        X_BF = forward(q_rad)
        assert np.linalg.norm((X_BF @ [*TIP_M, 1.0])[:3] - [x_m, 0.0, 0.006]) < 5 * AIM_STD_M
        leans.append(float(np.arccos(-X_BF[2, 2])))
    assert leans[0] > 0.3
    assert leans[1] < 0.8 * leans[0]
    with pytest.raises(SimError, match="outside the arm's reach"):
        touching_q_rad(np.array([1.0, 0.0, 0.006]), 0, np.random.default_rng(0))


def true_X_BM(the_lab: CalibrationLab) -> Array:
    """(4, 4) the board in the base by the lab's camera and its true pose."""
    with the_lab:
        corners = detect(the_lab.camera.snapshot().colour, BOARD, the_lab.camera.model().colour)
        X_CM = locate(corners, BOARD, the_lab.camera.model().colour).X_VM
    return np.array(the_lab.truth()["X_BC"]) @ X_CM


@pytest.mark.parametrize(
    "changed",
    [
        {"sensing": Sensing(camera_moved_mm=15.0, camera_moved_deg=1.5)},
        {"mount": Mount(table_height_mm=20.0, table_rise_mrad=(30.0, -25.0))},
    ],
    ids=["moved camera", "tilted table"],
)
def test_a_moved_camera_and_a_tilted_table_are_seen_by_a_guided_calibration(changed: dict[str, Any]) -> None:
    """The board is where the arm holds it, by the true pose of the camera in the arm's base."""
    there = lab(replace(world(), **changed))
    held = forward(q_rad()) @ HELD.X_FM
    assert np.linalg.norm(true_X_BM(there)[:3, 3] - held[:3, 3]) < 0.002
    X_BC = np.array(there.truth()["X_BC"])
    assert np.linalg.norm(X_BC[:3, 3] - default_X_BC()[:3, 3]) > 0.010
    trials = SimulatedLab(get_task("scooping"), replace(world(), **changed), 0, CELL)
    X_WC = np.array(trials.truth()["X_BC"])
    assert np.allclose(there._world.mount.true.X_BW @ X_WC, X_BC), "the same camera as in trials"
