"""Why a Franka arm stopped by itself, in words, and what to do. Names as in libfranka's `Errors`."""

from __future__ import annotations

from collections.abc import Iterable

_PATH = "the arm found the commanded motion itself wrong: keep the session's record and report it"
_TOUCH = "look what it touched, clear it, and check payload and collision thresholds in the rig file"
_LIMIT = "recover it, guide it by hand away from the limit, and let the next motion be planned from there"

REASONS: dict[str, tuple[str, str]] = {
    "joint_position_limits_violation": ("a joint reached the end of its range", _LIMIT),
    "cartesian_position_limits_violation": ("the tool left the workspace set in Desk", _LIMIT),
    "self_collision_avoidance_violation": ("the arm came too close to itself", _LIMIT),
    "joint_velocity_violation": ("a joint moved too fast", _PATH),
    "cartesian_velocity_violation": ("the tool moved too fast", _PATH),
    "force_control_safety_violation": ("the force control left its safe range", _PATH),
    "joint_reflex": ("a joint felt more torque than the collision threshold", _TOUCH),
    "cartesian_reflex": ("the tool felt more force than the collision threshold", _TOUCH),
    "max_goal_pose_deviation_violation": ("the arm did not come close enough to its goal", _TOUCH),
    "max_path_pose_deviation_violation": ("the arm was pushed off its path", _TOUCH),
    "cartesian_velocity_profile_safety_violation": ("the tool's speed left its safe range", _PATH),
    "joint_position_motion_generator_start_pose_invalid": ("the path did not start where the arm was", _PATH),
    "joint_motion_generator_position_limits_violation": ("the path left the range of a joint", _PATH),
    "joint_motion_generator_velocity_limits_violation": ("the path was too fast for a joint", _PATH),
    "joint_motion_generator_velocity_discontinuity": ("the commanded speed jumped as after lost cycles", ""),
    "joint_motion_generator_acceleration_discontinuity": (
        "the commanded acceleration jumped as after lost cycles",
        "",
    ),
    "controller_torque_discontinuity": ("the commanded torque jumped", _PATH),
    "communication_constraints_violation": ("too many control cycles came late", ""),
    "power_limit_violation": ("the arm needed too much power", "move slower, check the payload"),
    "tau_j_range_violation": ("a joint's torque sensor left its range", _TOUCH),
    "instability_detected": ("the arm began to oscillate", "check payload and impedance in the rig file"),
    "joint_move_in_wrong_direction": ("a joint outside of its range was moved further out", _LIMIT),
}

REAL_TIME = (
    "the computer did not keep up: check the real-time kernel, rtprio, the CPU governor and the cable to the arm "
    "(docs/guide/arms.md), and let nothing else run"
)


def in_words(names: Iterable[str]) -> str:
    """Names of reflexes -> what happened and what to do, once each; empty for no names."""
    names = tuple(names)
    happened = [f"{REASONS[n][0] if n in REASONS else n.replace('_', ' ')} ({n})" for n in names]
    remedies = dict.fromkeys((REASONS[n][1] or REAL_TIME) if n in REASONS else _PATH for n in names)
    return "; ".join((", and ".join(happened), *remedies)) if names else ""


BY_HAND = ("UserStopped", "Guiding")
"""The modes that a person brings about, and ends by letting go."""


def of_mode(mode: str, *, busy: bool = False) -> str | None:
    """The arm's mode (libfranka's `RobotMode` without k) -> why it will not move; None where it will.

    `busy`: also for the mode Move, which is a fault only where it lasts.
    """
    if mode == "Move" and busy:
        return "the arm makes a motion that this program has not asked for: end the other program, or the task in Desk"
    return {
        "UserStopped": "the stop button is pressed or the arm is not activated: release it, activate FCI in Desk",
        "Guiding": "somebody guides the arm by hand: let go of its buttons",
        "Reflex": "the arm stopped by itself",
        "AutomaticErrorRecovery": "the arm is recovering: wait",
        "Other": "the joints are locked or Desk holds the control: unlock the joints and activate FCI in Desk",
    }.get(mode)
