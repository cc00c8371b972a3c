from dataclasses import replace

import numpy as np
import pytest
from cells import cell

from hw.capsules import Capsule
from hw.collision import LEVEL, KeepOut, Tool, point_heights
from hw.joint_limits import LIMITS
from hw.kinematics import FLANGE, forward, link_poses
from hw.mass import NOTHING
from hw.types import Array, ContactWindow, JointPath
from hw.workcell import Workcell
from sim.errors import NotExecutable
from sim.panda.model import inverse
from sim.panda.moves import join_paths, move_path
from sim.panda.planning import CLEAR_M, home, task_paths, trial_paths, vertical
from sim.panda.redundancy import ALLOWED, GOOD_ENOUGH, profiles
from sim.panda.tool import held
from sim.types import ToolMotion

X_FT = np.array([[1.0, 0.0, 0.0, 0.05], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.20], [0.0, 0.0, 0.0, 1.0]])
READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])


TOOL = held(X_FT, NOTHING)


def holding(model: str = "panda", tool: Tool = TOOL) -> Workcell:
    return cell(model, tool)


def sweep(
    distance_m: float, duration_s: float = 1.0, start_m: tuple[float, float, float] = (0.5, 0.0, 0.01)
) -> ToolMotion:
    """Forward along X with a little pitch, and up at the end."""
    t_s = np.arange(round(duration_s * 1000) + 1) / 1000
    u = t_s / t_s[-1]
    share = u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)
    X_BT = np.tile(np.eye(4), (len(t_s), 1, 1))
    pitch = -0.2 * share
    X_BT[:, 0, 0], X_BT[:, 0, 2] = np.cos(pitch), np.sin(pitch)
    X_BT[:, 2, 0], X_BT[:, 2, 2] = -np.sin(pitch), np.cos(pitch)
    X_BT[:, :3, 3] = np.array(start_m) + np.outer(share, [distance_m, 0.0, 0.02])
    return ToolMotion(t_s, X_BT)


def joint_path(motion: ToolMotion, X_FT: Array, cell: Workcell) -> JointPath:
    """The first path that is good enough, else the best. These cells have no joint zeros: reported joints are true."""
    found: list[tuple[float, JointPath]] = []
    for one in task_paths(motion, X_FT, cell, None):
        found.append(one)
        if one[0] < GOOD_ENOUGH:
            break
    return min(found, key=lambda one: one[0])[1]


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_the_tool_follows_its_motion_exactly_within_the_limits(model: str) -> None:
    motion = sweep(0.12)
    path = joint_path(motion, X_FT, holding(model))
    error = forward(path.q_rad) @ X_FT - motion.X_BT
    assert np.abs(error[:, :3, 3]).max() < 1e-4  # 0.1 mm
    assert np.abs(error[:, :3, :3]).max() < 1e-4
    report = holding(model).require(path, path.q_rad[0])
    assert report.joint_ratio <= ALLOWED
    assert np.array_equal(path.t_s, motion.t_s)


def test_redundancy_lowers_the_worst_ratio() -> None:
    """Against the best constant joint 7."""
    motion = sweep(0.3, 0.8)
    limits = LIMITS["panda"]
    X_BF = motion.X_BT @ np.linalg.inv(X_FT)
    found = min(p.ratio for p in profiles(motion.t_s, X_BF, limits))
    q = inverse(X_BF[::20, None], np.linspace(-2.8, 2.8, 141))
    dq, ddq = (q[2:] - q[:-2]) / 0.04, (q[2:] - 2 * q[1:-1] + q[:-2]) / 0.02**2
    constant = np.nan_to_num(limits.ratios(q[1:-1], dq, ddq), nan=9.0).max(axis=(0, 1, -1)).min()
    assert found < constant - 0.05


def test_contact_window_is_passed_on_and_checked() -> None:
    motion = sweep(0.1, start_m=(0.5, 0.0, -0.002))
    with pytest.raises(NotExecutable, match="depth in the table"):
        joint_path(motion, X_FT, holding())
    contact = ContactWindow(0.0, 0.6, 0.002, 10.0)
    assert joint_path(ToolMotion(motion.t_s, motion.X_BT, contact), X_FT, holding()).contact == contact


def test_reasons_for_refusal() -> None:
    with pytest.raises(NotExecutable, match="outside the arm's reach"):
        joint_path(sweep(0.1, start_m=(1.2, 0.0, 0.1)), X_FT, holding())
    with pytest.raises(NotExecutable, match=r"(velocity|acceleration) of joint \d"):
        joint_path(sweep(0.25, 0.3), X_FT, holding())
    wall = KeepOut("wall", np.array([0.55, -1.0, 0.0]), np.array([0.6, 1.0, 1.5]))
    with pytest.raises(NotExecutable, match="and wall"):
        joint_path(sweep(0.12), X_FT, replace(holding(), keep_out=(wall,)))


def test_planning_is_deterministic() -> None:
    first, second = (joint_path(sweep(0.12), X_FT, holding()) for _ in range(2))
    assert np.array_equal(first.q_rad, second.q_rad)


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_a_trial_hangs_together(model: str) -> None:
    within = holding(model)
    q_home = home(X_FT, within)
    motion = sweep(0.12)
    approach, task, retreat = trial_paths(motion, X_FT, within, q_home)
    assert np.allclose(approach.q_rad[0], q_home)
    assert np.allclose(approach.q_rad[-1], task.q_rad[0])
    assert np.allclose(task.q_rad[-1], retreat.q_rad[0])
    assert np.allclose(retreat.q_rad[-1], q_home)
    for path in (approach, task, retreat):
        within.require(path, path.q_rad[0])
    for path in (approach, retreat):
        p = (forward(path.q_rad) @ X_FT)[:, :3, 3]
        near = motion.X_BT[0 if path is approach else -1, :3, 3]
        low = point_heights(link_poses(path.q_rad), TOOL, LEVEL)[:, 0] < CLEAR_M
        assert np.allclose(p[low][:, :2], near[:2], atol=1e-6)  # only straight above


def test_home_is_level_and_away_from_the_limits() -> None:
    q = home(X_FT, holding())
    assert np.allclose((forward(q) @ X_FT)[:3, :3], np.eye(3), atol=1e-9)
    still = np.zeros((1, 7))
    assert LIMITS["panda"].ratios(q[None], still, still)[0].max() < 0.9


@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_moves_are_smooth_and_as_fast_as_asked(model: str) -> None:
    to = READY + np.array([0.9, 0.2, -0.4, 0.3, 0.5, 0.2, 0.8])
    slow, fast = move_path(READY, to, LIMITS[model], 0.2), move_path(READY, to, LIMITS[model], 0.8)
    assert slow.duration_s == pytest.approx(4 * fast.duration_s, rel=0.02)
    report = holding(model).check(fast, READY)
    assert report.ok
    assert 0.6 < report.joint_ratio <= 0.95
    assert np.allclose(fast.q_rad[-1], to)


def test_fr3_moves_slow_down_near_its_position_limits() -> None:
    q_max = LIMITS["fr3"].q_max_rad
    near = READY.copy()
    near[6] = 0.94 * q_max[6]
    path = move_path(READY, near, LIMITS["fr3"], 1.0)
    assert holding("fr3").check(path).joint_ratio <= 1.0


def test_a_move_to_nowhere_stays_and_one_beyond_the_limits_is_refused() -> None:
    assert np.allclose(move_path(READY, READY, LIMITS["panda"]).q_rad, READY)
    with pytest.raises(NotExecutable, match="choose other end postures"):
        move_path(READY, READY + np.array([0, 0, 0, 3.0, 0, 0, 0]), LIMITS["panda"])


def test_vertical_moves_only_along_z() -> None:
    path = vertical(READY, 0.1, holding().arm)
    X = forward(path.q_rad)
    assert np.allclose(X[:, :3, :3], X[0, :3, :3], atol=1e-9)
    assert np.allclose(X[:, :2, 3], X[0, :2, 3], atol=1e-9)
    assert X[-1, 2, 3] - X[0, 2, 3] == pytest.approx(0.1)
    with pytest.raises(NotExecutable, match="cannot rise"):
        vertical(READY, 0.9, holding().arm)


def test_paths_join_only_at_rest_in_the_same_posture() -> None:
    a, b = move_path(READY, READY + 0.1, LIMITS["panda"]), move_path(READY + 0.1, READY, LIMITS["panda"])
    both = join_paths(a, b)
    assert both.duration_s == pytest.approx(a.duration_s + b.duration_s)
    assert holding().check(both, READY).ok
    with pytest.raises(ValueError, match="join"):
        join_paths(a, a)


def test_a_held_tool_brings_its_capsules_into_the_flange_and_they_must_stay_clear() -> None:
    stem = Capsule("stem", FLANGE, np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.0, 0.12]), 0.01)
    tool = held(X_FT, NOTHING, (stem,))
    X_TF = np.linalg.inv(X_FT)
    carried = next(c for c in tool.capsules if c.name == "stem")
    assert np.allclose(X_TF[:3, :3] @ carried.start_m + X_TF[:3, 3], stem.start_m)
    assert np.allclose(X_TF[:3, :3] @ carried.end_m + X_TF[:3, 3], stem.end_m)
    assert joint_path(sweep(0.05, start_m=(0.5, 0.0, 0.005)), X_FT, holding(tool=tool))
    thick = replace(stem, radius_m=0.03)
    with pytest.raises(NotExecutable, match="stem and table"):
        joint_path(sweep(0.05, start_m=(0.5, 0.0, 0.005)), X_FT, holding(tool=held(X_FT, NOTHING, (thick,))))
