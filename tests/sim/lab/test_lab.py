"""The simulated lab: one arm, one block, one camera, and results that depend on nothing but their seed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest
from slider import CELL, HOME_RAD, TASK, XY_M, run, shove, world

from hw.joint_limits import LIMITS
from hw.types import ContactWindow, JointPath
from sim.errors import NoHardware
from sim.lab.calibrating import nominal_X_BC
from sim.lab.cell import Cell
from sim.lab.kinect import default_X_BC
from sim.lab.rng_streams import RngStreams
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Sensing
from sim.panda.moves import move_path

PERIOD_S = 1 / 30


@pytest.fixture(scope="module")
def shared() -> Iterator[SimulatedLab]:
    """For tests that place the object themselves, so none sees what another left."""
    with SimulatedLab(TASK, world(), 7, CELL) as lab:
        yield lab


@pytest.mark.long
def test_a_trial_depends_on_seed_trial_and_attempt_alone(shared: SimulatedLab) -> None:
    first, second = run(shared, 2), run(shared, 3)
    shared.bench.place(XY_M + 0.03, 1, 0)
    shared.camera.start_recording()  # and then the process dies; the next one starts from nothing
    with SimulatedLab(TASK, world(), 7, CELL) as afresh:
        again = run(afresh, 3)
    assert again.bytes_ == second.bytes_
    assert run(shared, 2).bytes_ == first.bytes_
    assert first.bytes_ != second.bytes_
    assert run(shared, 2, attempt=1).bytes_ != first.bytes_
    with SimulatedLab(TASK, world(), 8, CELL) as other:
        assert run(other, 2).bytes_ != first.bytes_


@pytest.mark.long
def test_the_tool_shoves_the_block_and_the_truth_says_where(shared: SimulatedLab) -> None:
    trial = run(shared, 4)
    lag = np.abs(trial.execution.q_measured_rad - trial.execution.q_commanded_rad).max()
    assert 1e-4 < lag < 5e-3
    t_s = np.array([f.t_s for f in trial.frames]) - trial.execution.t_start_s
    np.testing.assert_allclose(np.diff(t_s), PERIOD_S, atol=1e-9)
    assert 0.0 < t_s[0] < PERIOD_S + 0.005
    assert t_s[-1] > 1.3 - PERIOD_S - 0.005, "the film holds the motion and the rest after it"
    truth = shared.truth()["trials"][-1]
    assert (truth["trial"], truth["attempt"]) == (4, 0)
    placed = np.array(truth["X_BO_placed"])[:2, 3]
    assert 1e-5 < np.linalg.norm(placed - XY_M) < 0.008
    (motion,) = truth["motions"]
    p_m = np.array(motion["X_BO"])[:, :3, 3]
    np.testing.assert_allclose(p_m[0, :2], placed, atol=1e-9)
    # the tool's front ends at 0.55 - 0.05 + 0.08 + 0.01, the block's centre half an edge farther
    assert p_m[-1, 0] == pytest.approx(0.61, abs=0.002)
    np.testing.assert_allclose(p_m[:, 2], 0.02, atol=1e-3)


@pytest.mark.long
def test_pictures_show_the_block_where_it_truly_is(shared: SimulatedLab) -> None:
    trial = run(shared, 7)
    truth = shared.truth()
    (motion,) = truth["trials"][-1]["motions"]
    t_s, p_BO_m = np.array(motion["t_s"]) + motion["t_start_s"], np.array(motion["X_BO"])[:, :3, 3]
    X_CB = np.linalg.inv(np.array(truth["X_BC"]))
    colour = shared.camera.model().colour
    checked = 0
    for frame in trial.frames[::6]:
        red = (frame.colour[..., 0] > 90) & (frame.colour[..., 1:].max(axis=-1) < 0.55 * frame.colour[..., 0])
        seen = np.argwhere(red)
        assert len(seen) > 15
        p_m = np.array([np.interp(frame.t_s, t_s, column) for column in p_BO_m.T])
        p_C_m = X_CB[:3, :3] @ p_m + X_CB[:3, 3]
        uv, _ = cv2.projectPoints(p_C_m[None], np.zeros(3), np.zeros(3), colour.K, colour.distortion)
        low, high = seen.min(axis=0)[::-1], seen.max(axis=0)[::-1]
        assert np.linalg.norm((low + high) / 2 - uv.ravel()) < 1.5
        checked += 1
    assert checked >= 6


def test_a_free_motion_leaves_the_block_alone(shared: SimulatedLab) -> None:
    shared.bench.place(XY_M, 8, 0)
    before = shared.camera.snapshot()
    away = HOME_RAD + np.array([0.3, 0, 0, 0, 0, 0, 0])
    shared.arm.execute(move_path(HOME_RAD, away, LIMITS["panda"]))
    between = shared.camera.snapshot()
    shared.arm.execute(move_path(away, HOME_RAD, LIMITS["panda"]))
    after = shared.camera.snapshot()
    assert before.t_s < between.t_s < after.t_s
    assert (
        np.abs(between.colour.astype(int) - before.colour).mean()
        > np.abs(after.colour.astype(int) - before.colour).mean()
    )
    assert shared.truth()["trials"][-1]["motions"] == []


def test_a_picture_of_the_same_moment_is_the_same_picture(shared: SimulatedLab) -> None:
    shared.bench.place(XY_M, 9, 0)
    one, two = shared.camera.snapshot(), shared.camera.snapshot()
    np.testing.assert_array_equal(one.colour, two.colour)
    np.testing.assert_array_equal(one.depth_mm, two.depth_mm)


@pytest.mark.long
def test_frames_get_lost_where_the_world_says_so(shared: SimulatedLab) -> None:
    whole = run(shared, 12)
    with SimulatedLab(TASK, world(Sensing(camera="small", frame_drop=0.3)), 7, CELL) as lossy:
        kept = run(lossy, 12)
    times = [f.t_s for f in kept.frames]
    assert set(times) < {f.t_s for f in whole.frames}
    assert 0.4 < len(times) / len(whole.frames) < 0.95


def test_contact_declared_is_simulated_even_in_the_air(shared: SimulatedLab) -> None:
    shared.bench.place(XY_M, 13, 0)
    path = move_path(HOME_RAD, HOME_RAD + 0.05, LIMITS["panda"])
    free = shared.arm.execute(path)
    np.testing.assert_array_equal(free.q_measured_rad, free.q_commanded_rad)
    shared.bench.place(XY_M, 13, 0)
    touching = shared.arm.execute(JointPath(path.t_s, path.q_rad, ContactWindow(0.0, 0.1, 0.001, 5.0)))
    assert np.abs(touching.q_measured_rad - touching.q_commanded_rad).max() > 1e-5


def test_what_lies_on_the_table_stays_while_the_arm_travels() -> None:
    cell = Cell(TASK, world())
    path = shove()
    X_BO = np.eye(4)
    X_BO[:3, 3] = [0.55, 0.0, 0.3]
    cell.reset(path.q_rad[0], X_BO)
    motion = cell.travel(path.t_s[::100], path.q_rad[::100])
    X_BT, X_BO = (cell.poses(motion.positions)[name] for name in (cell.bodies.tool, cell.bodies.object))
    np.testing.assert_allclose(X_BO, X_BO[:1].repeat(len(X_BO), axis=0), atol=1e-9)
    assert X_BT[-1, 0, 3] - X_BT[0, 0, 3] == pytest.approx(0.08, abs=1e-6)


def test_touching_is_told_apart() -> None:
    cell = Cell(TASK, world())
    path = shove()
    X_BO = np.eye(4)
    cases = {
        (0.55, 0.30): (False, False),  # in the air
        (0.55, 0.0199): (False, True),  # on the table
        (0.529, 0.30): (False, False),
        (0.5299, 0.025): (True, False),  # against the tool, which ends at 0.51, clear of the table
        (0.5299, 0.0199): (True, True),
    }
    for (x_m, z_m), expected in cases.items():
        X_BO[0, 3], X_BO[2, 3] = x_m, z_m
        cell.reset(path.q_rad[0], X_BO)
        assert cell.touches() == expected, (x_m, z_m)


def test_the_truth_is_ready_for_json_and_complete(shared: SimulatedLab) -> None:
    truth = json.loads(json.dumps(shared.truth(), allow_nan=False))
    assert truth["parameters"] == {"mu": 0.3, "e": 1e5, "kind": 1.0, "h": 2.0, "y": 0.0}
    assert truth["nuisance"] == {"radius": 0.015}
    assert truth["unmodelled"]["pitch_bias_rad"] == 0.0
    assert np.array(truth["X_BC"]).shape == (4, 4)


def test_the_nominal_calibration_is_off_by_what_it_says() -> None:
    sensing = Sensing(extrinsic_error_mm=2.0, extrinsic_error_deg=0.2)
    shifts, turns = [], []
    for seed in range(200):
        nominal = nominal_X_BC(world(sensing), seed)
        error = np.linalg.inv(default_X_BC()) @ nominal
        shifts.append(1e3 * np.linalg.norm(error[:3, 3]))
        turns.append(np.rad2deg(np.linalg.norm(cv2.Rodrigues(error[:3, :3])[0])))
    assert np.sqrt(np.mean(np.square(shifts))) == pytest.approx(2.0, rel=0.12)
    assert np.sqrt(np.mean(np.square(turns))) == pytest.approx(0.2, rel=0.12)
    np.testing.assert_array_equal(nominal_X_BC(world(sensing), seed), nominal)


def test_streams_of_chance_are_all_different() -> None:
    chances = [RngStreams.draw(s, t, a) for s in (0, 1) for t in (0, 1, 3) for a in (0, 1)]
    draws = [tuple(c.placing_m) for c in chances]
    draws += [tuple(c.frame_stream(i).standard_normal(2)) for c in chances for i in (0, 1)]
    draws += [tuple(c.snapshot_stream(t_s).standard_normal(2)) for c in chances for t_s in (0.0, 1.0)]
    assert len(set(draws)) == len(draws)


def test_a_lab_needs_a_scene_and_its_own_world() -> None:
    with pytest.raises(NoHardware, match="it runs in simulation only"):
        SimulatedLab(replace(TASK, hardware=None), world(), 0, CELL)
    with pytest.raises(ValueError, match="is of pushing, not of slider"):
        SimulatedLab(TASK, replace(world(), task="pushing"), 0, CELL)
