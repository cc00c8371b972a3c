"""The pushing motions on both arms: what the mount of the pusher and the timing of the push were chosen for."""

from itertools import product

import numpy as np
import pytest

from hw.collision import segment_distance, segments
from hw.kinematics import link_poses
from hw.types import JointPath
from sim.panda.planning import home, trial_paths
from sim.panda.redundancy import ALLOWED
from sim.panda.tool import cell_as_shipped, tool_of
from sim.tasks.pushing import HARDWARE
from sim.tasks.pushing.mount import X_FT
from sim.tasks.pushing.params import ACTION, BOTTLE_HEIGHT_M, BOTTLE_RADIUS_M, REFERENCE_CONTEXT, START_M
from sim.tasks.pushing.plan import plan

TOOL = tool_of(HARDWARE)


def paths(action: tuple[float, ...], model: str) -> tuple[JointPath, JointPath, JointPath]:
    """Planned and found executable: approach and retreat, a stop at any moment, nothing near arm or table."""
    motion = plan(REFERENCE_CONTEXT, np.array(action))
    cell = cell_as_shipped(HARDWARE, model)
    found = trial_paths(motion, X_FT, cell, home(X_FT, cell))
    reports = [cell.require(path, path.q_rad[0]) for path in found]
    assert reports[1].joint_ratio <= ALLOWED
    return found


@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.parametrize("action", [(-0.3, 0.8), (0.0, 0.8), (0.3, 0.4)])
def test_extreme_pushes_are_executable_and_the_bottle_is_left_alone_on_the_way(
    action: tuple[float, float], model: str
) -> None:
    approach, _, _ = paths(action, model)
    bottle = np.array([[*START_M, 0.0], [*START_M, BOTTLE_HEIGHT_M]])
    near = segment_distance(segments(link_poses(approach.q_rad[::20]), TOOL.capsules), bottle)
    clearance_m = near - np.array([c.radius_m for c in TOOL.capsules]) - BOTTLE_RADIUS_M
    assert clearance_m.min() > 0.02


@pytest.mark.slow
@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_the_whole_action_space_is_executable(model: str) -> None:
    for action in product(np.linspace(ACTION.low[0], ACTION.high[0], 9), np.linspace(ACTION.low[1], ACTION.high[1], 5)):
        paths(action, model)
