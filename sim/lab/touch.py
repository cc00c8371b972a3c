"""The lab during a touch-off: an arm that a simulated person guides with the accuracy of a hand, a hand, and a
displaced table and tool.

The world is that of `SimulatedLab`: its `[mount]`, the task's own effects on the tool, its joint zeros.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from scipy.spatial.transform import Rotation

from hw.errors import MotionRefused
from hw.grasping import FakeHand
from hw.poses import pose
from hw.types import Array, Execution, JointPath, frozen_array
from hw.workcell import ArmModel, Workcell
from sim.errors import SimError
from sim.lab.arm import ArmInLab
from sim.lab.rng_streams import guided_stream, joint_zeros
from sim.lab.world import World
from sim.panda.model import postures
from sim.panda.setting_down import HAND_M, SetDown
from sim.panda.tool import ToolCorrection, touchable
from sim.tasks.task import Task

GUIDING_S = 15.0
"""The time that a person takes for one set-down."""
AIM_M, TURN_RAD = 0.01, 0.04
"""The error of place and direction when a person holds the tool: one standard deviation along each axis, and of pitch
and yaw."""
_Q7 = 61
_MARGIN_RAD = 0.03


class TouchLab:
    """One world as a bench for a touch-off. Entering connects arm and hand; equal inputs give equal numbers."""

    def __init__(self, task: Task, world: World, seed: int, cell: Workcell, *, home_q_rad: Array) -> None:
        """`home_q_rad` (7,) is the arm's first posture; `cell` has the arm's joint zeros by the calibration.

        Raises NoHardware, and UnknownName for a tool without feelers.
        """
        world.require_lab()
        hardware = task.require_hardware()
        self._world, self._held_m, self._designed = world, touchable(hardware).held_m, hardware.X_FT
        self._seed, self._guided = seed, 0
        self.zeros_rad = joint_zeros(seed, world.sensing.joint_offset_mrad)
        self.hand = FakeHand()
        self.arm = _GuidedArm(cell, frozen_array(home_q_rad, (7,)))

    def __enter__(self) -> Self:
        self.arm.__enter__()
        self.hand.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self.hand.__exit__(*exc)
        self.arm.__exit__(*exc)

    def offer_tool(self, present: bool) -> None:
        """The simulated person holds the tool between the open fingers (True), or takes it away."""
        self.hand.between_m = self._held_m if present else None
        self.hand.holds = self.hand.holds and present

    def set_down(self, where: SetDown, number: int) -> None:
        """The simulated person guides the tool to a set-down of the given number, as exactly as a hand can.

        Raises SimError if the place is out of reach.
        """
        self._guided += 1
        rng = guided_stream(self._seed, self._guided)
        true = self.arm.cell.arm.in_true_joints()
        q_rad = set_down_q_rad(where, self._world, self._designed, true, self.arm.state().q_rad, rng)
        self.arm.be_at(frozen_array(q_rad - self.zeros_rad))

    def truth(self) -> dict[str, Any]:
        """The true values that a touch-off should find, only for checks."""
        mount = self._world.mount
        table = mount.true.table
        return {
            "table": [table.height_m, table.slope_x, table.slope_y],
            "tool_height_m": 1e-3 * mount.tool_height_mm,
            "tool_pitch_rad": float(getattr(self._world.unmodelled, "pitch_bias_rad", 0.0)),
            "tool_roll_rad": 1e-3 * mount.tool_roll_mrad,
            "joint_zeros_rad": self.zeros_rad.tolist(),
        }


class _GuidedArm(ArmInLab):
    """`hw.ports.Arm` in a person's hands: it plays no path."""

    def __init__(self, cell: Workcell, q_rad: Array) -> None:
        super().__init__(cell, "run again")
        self.cell, self._q_rad, self._t_s = cell, q_rad, 0.0

    def _now(self) -> tuple[float, Array]:
        return self._t_s, self._q_rad

    def be_at(self, q_rad: Array) -> None:
        """Rest where the person let go."""
        self._q_rad, self._t_s = q_rad, self._t_s + GUIDING_S

    def execute(self, path: JointPath) -> Execution:
        """Raises MotionRefused: a person guides it."""
        raise MotionRefused("nothing moves by itself during a touch-off: a person guides the arm")


def true_X_FT(world: World, designed: Array) -> Array:
    """(4, 4) the tool as it really sits in the flange."""
    pitch_rad = float(getattr(world.unmodelled, "pitch_bias_rad", 0.0))
    return np.asarray(ToolCorrection(pitch_rad=pitch_rad).X_FT(world.mount.true.X_FT(designed)))


def set_down_q_rad(
    where: SetDown, world: World, designed: Array, arm: ArmModel, near_rad: Array, rng: np.random.Generator
) -> Array:
    """(7,) reported joints with both corners on the true table; each corner is off by an error of the hand.

    `designed` (4, 4) is the tool in the flange by its drawing. Raises SimError out of reach.
    """
    table, X_FT = world.mount.true.table, true_X_FT(world, designed)
    errors_m = HAND_M * (rng.standard_normal() + rng.standard_normal(2))
    low, high = where.pitches_rad
    pitch_rad = float(np.clip(where.pitch_rad + TURN_RAD * rng.standard_normal(), low + 0.02, high - 0.02))
    yaw_rad, xy_m = TURN_RAD * rng.standard_normal(), where.xy_m + AIM_M * rng.standard_normal(2)
    left, right = where.corners
    roll_rad = float((errors_m[0] - errors_m[1]) / np.linalg.norm(left.p_T_m - right.p_T_m))
    R = Rotation.from_euler("ZYX", [yaw_rad, pitch_rad, roll_rad]).as_matrix()
    middle = (left.p_T_m + right.p_T_m) / 2.0
    above = np.array([*xy_m, left.radius_m + errors_m.mean()])
    X_BT = table.X_BW @ pose(R, above - R @ middle)
    limits = arm.in_true_joints().limits
    q = postures(X_BT @ np.linalg.inv(X_FT), limits, _Q7)
    q = q[((q > limits.q_min_rad + _MARGIN_RAD) & (q < limits.q_max_rad - _MARGIN_RAD)).all(axis=1)]
    if not len(q):
        raise SimError(f"the tool cannot be set down at {where.name}: it lies outside the arm's reach")
    return np.asarray(arm.reported_rad(q[np.abs(q - arm.true_rad(near_rad)).max(axis=1).argmin()]))
