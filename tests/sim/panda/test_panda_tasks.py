"""The motions of both tasks on the arms: what the mounts of their tools were chosen for, and what these weigh."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from hw.capsules import segment_distance, segments
from hw.collision import HAND_MASS
from hw.kinematics import link_poses
from hw.types import JointPath
from sim.panda.planning import home, trial_paths
from sim.panda.redundancy import ALLOWED
from sim.panda.tool import cell_as_shipped, tool_of
from sim.tasks import get_task
from sim.tasks.pushing.params import BOTTLE_HEIGHT_M, BOTTLE_RADIUS_M, START_M
from sim.tasks.task import Task

PUSHING, SCOOPING = get_task("pushing"), get_task("scooping")
LOW = np.r_[SCOOPING.context.low, SCOOPING.action.low]
HIGH = np.r_[SCOOPING.context.high, SCOOPING.action.high]


def paths(
    task: Task, action: tuple[float, ...], model: str, context: tuple[float, ...] | None = None
) -> tuple[JointPath, JointPath, JointPath]:
    """Planned and found executable: approach and retreat, a stop at any moment, nothing near arm or table."""
    hardware = task.require_hardware()
    at = task.reference_context if context is None else np.array(context)
    cell = cell_as_shipped(hardware, model)
    found = trial_paths(hardware.plan(at, np.array(action)), hardware.X_FT, cell, home(hardware.X_FT, cell))
    reports = [cell.require(path, path.q_rad[0]) for path in found]
    assert reports[1].joint_ratio <= ALLOWED
    return found


@pytest.mark.long
@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
@pytest.mark.parametrize("action", [(-0.3, 0.8), (0.3, 0.4)])
def test_extreme_pushes_are_executable_and_the_bottle_is_left_alone_on_the_way(
    action: tuple[float, float], model: str
) -> None:
    approach, _, _ = paths(PUSHING, action, model)
    capsules = tool_of(PUSHING.require_hardware()).capsules
    bottle = np.array([[*START_M, 0.0], [*START_M, BOTTLE_HEIGHT_M]])
    near = segment_distance(segments(link_poses(approach.q_rad[::20]), capsules), bottle)
    clearance_m = near - np.array([c.radius_m for c in capsules]) - BOTTLE_RADIUS_M
    assert clearance_m.min() > 0.02


@pytest.mark.slow
@pytest.mark.parametrize("model", ["panda", "fr3", "fr3v2"])
def test_every_push_is_executable(model: str) -> None:
    low, high = PUSHING.action.low, PUSHING.action.high
    for action in product(np.linspace(low[0], high[0], 9), np.linspace(low[1], high[1], 5)):
        paths(PUSHING, action, model)


@pytest.mark.long
@pytest.mark.parametrize("corner", [(0, 1, 1, 1, 1), (1, 0, 1, 1, 0), (1, 1, 0, 0, 0)])
def test_extreme_scoops_are_executable(corner: tuple[int, ...]) -> None:
    value = np.choose(corner, (LOW, HIGH))
    paths(SCOOPING, tuple(value[2:]), "panda", tuple(value[:2]))


@pytest.mark.slow
def test_every_corner_of_scooping_is_executable_on_the_panda() -> None:
    for value in product(*zip(LOW, HIGH, strict=True)):
        paths(SCOOPING, value[2:], "panda", value[:2])


@pytest.mark.parametrize(("task", "tool_kg"), [(SCOOPING, 0.12), (PUSHING, 0.1)], ids=["scooping", "pushing"])
def test_hand_and_tool_weigh_what_their_sources_say(task: Task, tool_kg: float) -> None:
    hardware = task.require_hardware()
    mass = tool_of(hardware).mass
    assert mass.kg == pytest.approx(HAND_MASS.kg + tool_kg)
    assert cell_as_shipped(hardware, "fr3").tool.mass.kg == mass.kg
    between = hardware.X_FT[:3, :3] @ hardware.tool_mass.com_m + hardware.X_FT[:3, 3]
    np.testing.assert_allclose(mass.com_m, (HAND_MASS.kg * HAND_MASS.com_m + tool_kg * between) / mass.kg)
    assert 0.05 < np.linalg.norm(between) < 0.35, "beyond the hand, and within the tool's reach"
    a, b, c = np.sort(np.linalg.eigvalsh(mass.inertia_kg_m2))
    assert a > 0.0
    assert c <= a + b, "no body is longer than that"
    assert c > np.linalg.eigvalsh(HAND_MASS.inertia_kg_m2).max()
