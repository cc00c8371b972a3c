"""Explains why a Franka arm stopped by itself, with the remedy. Names as in libfranka's `Errors`.

Every error of both arms has its own text: what happened, what to check, what to do. The meanings are the maker's, from
the documentation of `franka::Errors`. This program commands joint positions. So an error of Cartesian commands, of
elbows or of the arm's own movements can only come from another program or from a task in Desk, and its text says so.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Reflex:
    """One error of the arm."""

    happened: str
    look: str  # what to check, and the right value
    do: str


_RECOVER = "then recover; the next motion is planned from where the arm is"
_REPORT = "recover; if it happens again, keep the session's record and report it"
_ELSEWHERE = "this program commands only joints: look for another program, or a task in Desk, that moves the arm"
_END_IT = "end it, then recover"
_FREE = "recover, guide the arm by hand away from there, and run the same command again"

_REAL_TIME = (
    "check real-time kernel, rtprio, CPU governor and cable (docs/guide/arms.md), end other programs, then recover"
)

_FROM_ELSEWHERE = {
    "force_control_safety_violation": "the arm's force control left its safe range",
    "cartesian_position_motion_generator_start_pose_invalid": "a Cartesian motion did not begin where the tool was",
    "cartesian_motion_generator_elbow_limit_violation": "a Cartesian motion moved the elbow beyond its range",
    "cartesian_motion_generator_velocity_limits_violation": "a Cartesian motion was commanded too fast",
    "cartesian_motion_generator_velocity_discontinuity": "the commanded speed of a Cartesian motion jumped",
    "cartesian_motion_generator_acceleration_discontinuity": "the commanded acceleration of a Cartesian motion jumped",
    "cartesian_motion_generator_elbow_sign_inconsistent": "a Cartesian motion required the elbow on its other side",
    "cartesian_motion_generator_start_elbow_invalid": (
        "a Cartesian motion began with a different elbow position from the arm's"
    ),
    "force_controller_desired_force_tolerance_violation": "the arm's force control could not hold the commanded force",
    "start_elbow_sign_inconsistent": "a motion began with the elbow on the wrong side",
    "cartesian_motion_generator_joint_position_limits_violation": "a Cartesian motion led a joint beyond its range",
    "cartesian_motion_generator_joint_velocity_limits_violation": "a Cartesian motion made a joint too fast",
    "cartesian_motion_generator_joint_velocity_discontinuity": "a Cartesian motion made the speed of a joint jump",
    "cartesian_motion_generator_joint_acceleration_discontinuity": (
        "a Cartesian motion made the acceleration of a joint jump"
    ),
    "cartesian_position_motion_generator_invalid_frame": "a Cartesian motion was commanded with an invalid pose",
    "cartesian_spline_motion_generator_violation": "the arm could not plan its own movement along a tool curve",
    "joint_via_motion_generator_planning_joint_limit_violation": (
        "the arm's own movement through given joint positions would have left their range"
    ),
}
"""Errors of motions that this program never commands."""

REASONS: dict[str, Reflex] = {
    "joint_position_limits_violation": Reflex(
        "a joint reached the end of its range",
        "check which joint is at its stop, and whether somebody pushed the arm there",
        "recover (through the joint limit recovery in Desk, if Desk asks for it), guide that joint towards "
        "its middle, and run the same command again",
    ),
    "cartesian_position_limits_violation": Reflex(
        "the tool left the workspace that is set in Desk",
        "check the workspace limits in Desk: they must contain the whole table and the home posture",
        _FREE,
    ),
    "self_collision_avoidance_violation": Reflex(
        "the arm came too close to itself",
        "check whether the tool is longer than the rig file says, or mounted differently",
        _FREE,
    ),
    "joint_velocity_violation": Reflex(
        "a joint moved faster than it may",
        "check whether somebody or something pushed the arm; the commanded speeds were within the limits",
        f"clear the way, {_RECOVER}",
    ),
    "cartesian_velocity_violation": Reflex(
        "the tool moved faster than it may",
        "check the end effector in Desk: a centre far from the flange moves faster than the flange, whose speed is "
        "checked",
        f"correct it there, {_RECOVER}",
    ),
    "joint_reflex": Reflex(
        "a joint felt more torque than the collision threshold",
        "check what it touched; if nothing, compare the payload in the rig file with what the hand holds",
        f"clear it, or correct payload and collision thresholds in the rig file, {_RECOVER}",
    ),
    "cartesian_reflex": Reflex(
        "the tool felt more force than the collision threshold",
        "check what the tool touched, and whether the table is where the touch-off found it",
        f"clear it, repeat the touch-off if table or tool moved, {_RECOVER}",
    ),
    "max_goal_pose_deviation_violation": Reflex(
        "the arm did not come close enough to the end of its motion",
        "check whether something held it back, and compare payload and impedance in the rig file with the arm",
        f"clear the way, {_RECOVER}",
    ),
    "max_path_pose_deviation_violation": Reflex(
        "the arm was pushed off its path",
        "check what was in the way, or who pushed",
        f"clear the way, {_RECOVER}",
    ),
    "cartesian_velocity_profile_safety_violation": Reflex(
        "the tool was faster than the arm's safety controller allows there",
        "check the safety settings in Desk: with a reduced tool speed, every motion is a fault",
        f"set a speed that the motions need, or run slower ones, {_RECOVER}",
    ),
    "joint_position_motion_generator_start_pose_invalid": Reflex(
        "the motion did not begin where the arm was",
        "check whether somebody moved the arm between the check and the motion",
        f"hands off the arm, {_RECOVER}",
    ),
    "joint_motion_generator_position_limits_violation": Reflex(
        "a commanded joint lay beyond the end of its range",
        "check whether the rig file names the right model: panda, fr3 and fr3v2 have different ranges",
        f"correct arm.model; otherwise {_REPORT}",
    ),
    "joint_motion_generator_velocity_limits_violation": Reflex(
        "a joint was commanded faster than it may move",
        "check whether the rig file names the right model: panda, fr3 and fr3v2 have different limits",
        f"correct arm.model; otherwise {_REPORT}",
    ),
    "joint_motion_generator_velocity_discontinuity": Reflex(
        "the commanded speed jumped, as after lost cycles",
        "check the success rate of this trial and of earlier ones: below 0.95 the computer did not keep up",
        _REAL_TIME,
    ),
    "joint_motion_generator_acceleration_discontinuity": Reflex(
        "the commanded acceleration jumped, as after lost cycles",
        "check the success rate of this trial and of earlier ones: below 0.95 the computer did not keep up",
        _REAL_TIME,
    ),
    "communication_constraints_violation": Reflex(
        "too many control cycles came late, twenty in a row or too many in all",
        "check the success rate of earlier trials, and what else the computer is doing: it did not keep up",
        _REAL_TIME,
    ),
    "power_limit_violation": Reflex(
        "the arm needed more power than allowed",
        "compare the payload in the rig file with the tool in the hand, and check whether something held the arm back",
        f"correct it, or take a slower action, {_RECOVER}",
    ),
    "controller_torque_discontinuity": Reflex(
        "the torque of the arm's controller jumped",
        "check the joint impedance in the rig file and the success rate: a stiff arm or lost cycles cause this",
        f"return to the default impedance, {_RECOVER}",
    ),
    "joint_p2p_insufficient_torque_for_planning": Reflex(
        "the arm does not have enough torque for a movement that it planned by itself",
        f"check the payload in Desk and in the rig file; {_ELSEWHERE}",
        _END_IT,
    ),
    "tau_j_range_violation": Reflex(
        "a joint's torque left the range of its sensor",
        "check what the arm pushed against, and whether the hand holds more than the payload in the rig file",
        f"clear it, correct the payload, {_RECOVER}",
    ),
    "instability_detected": Reflex(
        "the arm began to oscillate",
        "check joint impedance and payload in the rig file, and whether arm and table stand firmly",
        f"return to the default impedance, fasten what is loose, {_RECOVER}",
    ),
    "joint_move_in_wrong_direction": Reflex(
        "a joint beyond its range moved further out",
        "check which joint is beyond its range (Desk shows it)",
        _FREE,
    ),
    "base_acceleration_initialization_timeout": Reflex(
        "the sensor of the base's acceleration did not start in time",
        "check the arm's light and its page in Desk for a hardware error",
        "switch the arm off and on, unlock it and activate FCI; if it happens again, ask the maker's support",
    ),
    "base_acceleration_invalid_reading": Reflex(
        "the sensor of the base's acceleration gave an invalid value",
        "check whether the base stands firmly: the sensor feels a knock or a shaking table",
        "fasten the base; if it happens again, switch the arm off and on, and ask the maker's support",
    ),
} | {name: Reflex(happened, _ELSEWHERE, _END_IT) for name, happened in _FROM_ELSEWHERE.items()}


def reason(name: str) -> Reflex:
    """The text for an error, including errors that only newer arms report."""
    return REASONS.get(name) or Reflex(
        name.replace("_", " "),
        "this error is unknown to the program: look at the arm's page in Desk",
        "do what Desk says, then recover",
    )


def in_words(names: Iterable[str]) -> str:
    """Names of errors -> what happened, what to check, what to do, each once; empty for no names."""
    explanations = {name: reason(name) for name in names}
    happened = [f"{one.happened} ({name})" for name, one in explanations.items()]
    looks = dict.fromkeys(one.look for one in explanations.values())
    does = dict.fromkeys(one.do for one in explanations.values())
    return "; ".join((", and ".join(happened), *looks, *does)) if explanations else ""


BY_HAND = ("UserStopped", "Guiding")
"""The modes that a person causes, and ends by letting go."""


def of_mode(mode: str, *, busy: bool = False) -> str | None:
    """The arm's mode (libfranka's `RobotMode` without k) -> why it will not move; None if it will.

    `busy`: also explain the mode Move, which is a fault only if it lasts.
    """
    if mode == "Move" and busy:
        return (
            "the arm is making a motion that this program has not asked for: end the other program, or the task in Desk"
        )
    return {
        "UserStopped": "the stop button is pressed or the arm is not activated: release it, activate FCI in Desk",
        "Guiding": "somebody guides the arm by hand: let go of its buttons",
        "Reflex": "the arm stopped by itself",
        "AutomaticErrorRecovery": "the arm is recovering: wait",
        "Other": "the joints are locked or Desk holds the control: unlock the joints and activate FCI in Desk",
    }.get(mode)
