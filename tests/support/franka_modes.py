"""What a Franka arm takes in which mode, and what it says no to: one table for both arms of the tests.

The modes are libfranka's `RobotMode`. The Panda's stand-in SDK and the FR3's protocol server both keep an `ArmModes`
and a `Monitor`, so neither takes what the other refuses. The statuses and the order of the error flags on the wire are
those that libfranka 0.21.3 reads (`test_modes_of_both_arms.py` sends each of them and compares the words); which mode
takes which command is the maker's documentation and the reports of users (franka_ros issues 25 and 70).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hw.joint_limits import LIMITS
from hw.kinematics import forward
from hw.types import Array

MODES = ("Other", "Idle", "Move", "Guiding", "Reflex", "UserStopped", "AutomaticErrorRecovery")
"""In the order of their numbers on the wire."""

COMMANDS = ("set_collision_behavior", "set_joint_impedance", "set_load", "move", "recover", "read")
SETTERS = COMMANDS[:3]
NAMES = {
    "set_collision_behavior": "Set Collision Behavior",
    "set_joint_impedance": "Set Joint Impedance",
    "set_load": "Set Load",
    "move": "Move",
    "recover": "Automatic Error Recovery",
}
"""As libfranka calls them in its messages."""

SPOKEN = {"UserStopped": "User stopped", "AutomaticErrorRecovery": "Automatic error recovery"}
"""Modes that libfranka spells otherwise in its messages."""

FLAGS = (
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame",
    "controller_torque_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_j_range_violation",
    "instability_detected",
    "joint_move_in_wrong_direction",
    "cartesian_spline_motion_generator_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
)
"""All errors of an FR3 in the order of their flags on the wire; a Panda has the first 37."""
PANDA_FLAGS = 37


@dataclass(frozen=True)
class Refusal:
    """An arm's no: the status on the wire, by the kind of command, and libfranka's words for it."""

    setter: int | None
    move: int | None
    recover: int | None
    words: str

    def status(self, command: str) -> int:
        found = self.move if command == "move" else self.recover if command == "recover" else self.setter
        assert found is not None, f"an arm does not answer {command} so"
        return found

    def said(self, command: str, mode: str) -> str:
        """What libfranka raises."""
        hint = " Did you open the brakes?" if self is WRONG_MODE and mode == "Other" else ""
        return f"libfranka: {NAMES[command]} command {self.words}".format(mode=SPOKEN.get(mode, mode)) + hint


WRONG_MODE = Refusal(1, 5, 1, 'rejected: command not possible in the current mode ("{mode}")!')
BY_HAND_FIRST = Refusal(None, None, 3, "rejected: manual error recovery required!")
REFLEX = Refusal(None, 8, 4, "aborted: motion aborted by reflex!")
STOP_PRESSED = Refusal(None, 9, 5, "aborted: User Stop pressed!")

ANSWERS: dict[tuple[str, str], Refusal | None] = {
    **{(command, mode): WRONG_MODE for command in COMMANDS for mode in MODES},
    **{(command, "Idle"): None for command in COMMANDS},
    **{("read", mode): None for mode in MODES},
    ("recover", "Reflex"): None,
}
"""(command, mode) -> the refusal, None: it is taken."""


@dataclass
class ArmModes:
    """What has happened to an arm, and the mode that it is in for that."""

    locked: bool = False  # its joints
    pressed: bool = False  # its stop button
    guided: bool = False  # by hand
    recovering: bool = False
    moving: bool = False
    reasons: tuple[str, ...] = ()  # the reflex
    by_hand_first: bool = False  # the reflex ends only after somebody has unlocked and moved a joint

    @property
    def mode(self) -> str:
        happened = (
            (self.locked, "Other"),
            (self.pressed, "UserStopped"),
            (self.guided, "Guiding"),
            (self.recovering, "AutomaticErrorRecovery"),
            (bool(self.reasons), "Reflex"),
            (self.moving, "Move"),
        )
        return next((mode for holds, mode in happened if holds), "Idle")

    def refusal(self, command: str) -> Refusal | None:
        """What the arm says to `command` now, None: it takes it."""
        if command == "recover" and self.mode == "Reflex" and self.by_hand_first:
            return BY_HAND_FIRST
        return ANSWERS[command, self.mode]

    def be(self, mode: str) -> None:
        """Bring about `mode`."""
        self.__init__()  # type: ignore[misc]
        if mode == "Reflex":
            self.reasons = ("joint_reflex",)
        elif mode != "Idle":
            name = {"Other": "locked", "UserStopped": "pressed", "Guiding": "guided", "Move": "moving"}
            setattr(self, name.get(mode, "recovering"), True)


class Limiter:
    """libfranka's `limitRate` of joint positions (rate_limiting.cpp, applied in `convertMotion` of control_loop.cpp
    where `limit_rate` is set): a command is pulled towards the last ones until speed, acceleration and jerk are kept.

    So a jump is not refused: it is chased as fast as the limits allow. The limits are those of rate_limiting.h: the
    arm's, less 1e-3, and less three packets of acceleration for speeds.
    """

    def __init__(self, q_rad: list[float], model: str = "panda") -> None:
        self._limits = LIMITS[model]
        self._q, self._dq, self._ddq = np.array(q_rad), np.zeros(7), np.zeros(7)

    def limited(self, q_rad: list[float]) -> list[float]:
        limits, dt_s = self._limits, 1e-3
        most_ddq, most_dddq = limits.ddq_max_rad_s2 - 1e-3, limits.dddq_max_rad_s3 - 1e-3
        most = limits.dq_max_rad_s - 1e-3 - 3.0 * dt_s * most_ddq
        dq = (np.array(q_rad) - self._q) / dt_s
        dddq = ((dq - self._dq) / dt_s - self._ddq) / dt_s
        ddq = self._ddq + np.clip(dddq, -most_dddq, most_dddq) * dt_s
        steep = most_dddq / most_ddq
        high = np.minimum(steep * (most - self._dq), most_ddq)
        low = np.maximum(steep * (-most - self._dq), -most_ddq)
        before, self._ddq = self._dq, np.clip(ddq, low, high)
        self._dq = before + self._ddq * dt_s
        self._q = self._q + self._dq * dt_s
        return [float(q) for q in self._q]


NOT_FINITE = "Commanding value is infinite or NaN."
"""libfranka sends no such command, and throws std::invalid_argument (`checkFinite` of its control_tools.h)."""

LOST_IN_A_ROW = 20
"""From here on an arm stops (the maker's documentation of the FCI)."""
START_RAD = 1e-3
FLANGE_M_S = {"panda": 1.7, "fr3": 3.0, "fr3v2": 3.0}
RATED_NM = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)


@dataclass
class Monitor:
    """What an arm checks of the joints that it is commanded, cycle by cycle, and how it fills in those that are lost.

    Each rule and its source in the maker's FCI documentation ("Robot and interface specifications", "Troubleshooting")
    or in libfranka 0.9.2:

    * a lost command is replaced by one that keeps the last acceleration; 20 lost in a
      row are a `communication_constraints_violation`;
    * the first command is where the arm is held, else `joint_position_motion_generator_start_pose_invalid`; how near is
      not published, `START_RAD` is ours;
    * position and velocity within the limits, else `..._position_limits_violation`, `..._velocity_limits_violation`:
      those of the tables, without the margin for lost packets, which is libfranka's own (rate_limiting.h);
    * acceleration within its limit, else `joint_motion_generator_velocity_discontinuity`, and jerk, else
      `..._acceleration_discontinuity`: a discontinuity is what a limit of the next derivative forbids;
    * the flange's speed (`cartesian_velocity_violation`) and the joints' torques (`tau_j_range_violation`) within the
      limits of the same tables.

    Which mode takes which command is `ANSWERS`; that the limiter chases a jump is `Limiter`; that a command is finite
    is `NOT_FINITE`. Not imitated, because no number is published: power, instability, the rate of desired torques, how
    near a self-collision may come, and which arguments of a setter the arm rejects; nor libfranka's low-pass filter,
    which the driver turns off.
    """

    model: str
    torque_Nm: Callable[[Array, Array, Array], Array] | None = None  # joints, velocities, accelerations -> torques
    most_lost: int = LOST_IN_A_ROW
    lost: int = 0
    _q: list[Array] = field(default_factory=list)  # the last four commands, lost ones filled in
    _known: int = 4  # how many of them are known for sure
    _first: bool = True

    def begin(self, q_held_rad: Array) -> None:
        self.lost, self._known, self._first = 0, 4, True
        self._q = [np.array(q_held_rad, dtype=np.float64)] * 4

    def gap(self) -> None:
        """Commands are missing that shall not count: nothing is checked until four have come."""
        if not self._first:
            self._known = 0

    def cycle(self, q_rad: Array | None) -> tuple[str, ...]:
        """The errors that the command (7,) of this cycle raises; None: it was lost. Before the first none is missed."""
        if q_rad is None and self._first:
            return ()
        a, b, c = self._q[-3:]
        self.lost = 0 if q_rad is not None else self.lost + 1
        if self.lost >= self.most_lost:
            return ("communication_constraints_violation",)
        now = c + (c - b) + ((c - b) - (b - a)) if q_rad is None else np.array(q_rad, dtype=np.float64)
        first, self._first = self._first, False
        if first and np.abs(now - c).max() > START_RAD:
            return ("joint_position_motion_generator_start_pose_invalid",)
        self._q, self._known = [*self._q[-3:], now], self._known + 1
        return () if q_rad is None or self._known < 4 else self._broken()

    def _broken(self) -> tuple[str, ...]:
        limits, q = LIMITS[self.model], self._q[-1]
        dq, ddq, dddq = (np.diff(self._q, n, axis=0)[-1] * 1000.0**n for n in (1, 2, 3))
        margin = 0.003 * limits.ddq_max_rad_s2  # our own, for lost packets: not the arm's
        low, high = limits.velocity_bounds(q)
        hand = (forward(self._q[-1])[:3, 3] - forward(self._q[-2])[:3, 3]) * 1000.0
        torque_Nm = np.zeros(7) if self.torque_Nm is None else self.torque_Nm(q, dq, ddq)
        checks = (
            ((q < limits.q_min_rad) | (q > limits.q_max_rad), "joint_motion_generator_position_limits_violation"),
            ((dq < low - margin) | (dq > high + margin), "joint_motion_generator_velocity_limits_violation"),
            (np.abs(ddq) > limits.ddq_max_rad_s2, "joint_motion_generator_velocity_discontinuity"),
            (np.abs(dddq) > limits.dddq_max_rad_s3, "joint_motion_generator_acceleration_discontinuity"),
            (np.linalg.norm(hand) > FLANGE_M_S[self.model], "cartesian_velocity_violation"),
            (np.abs(torque_Nm) > RATED_NM, "tau_j_range_violation"),
        )
        return tuple(name for broken, name in checks if np.any(broken))
