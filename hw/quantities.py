"""The quantities that are recorded during a motion beside the joints; each has one row.

A row is all that a further quantity needs: the player logs it, `Execution.measured` carries it, a recording keeps it on
its topic, and every export writes it. An arm that does not report it has none; it is never computed from a model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class MeasuredQuantity:
    """A quantity that an arm reports in every cycle."""

    name: str  # in `Execution.measured`
    state: str  # field of libfranka's RobotState
    labels: tuple[str, ...]  # a column per value, with its unit
    topic: str  # of a recording; several quantities share one if they fill different fields of its message
    field: Literal["position", "velocity", "effort", "wrench"]  # of a JointState, or a whole WrenchStamped in the base
    meaning: str

    @property
    def size(self) -> int:
        """The number of its values."""
        return len(self.labels)


def _of_joints(name: str, unit: str) -> tuple[str, ...]:
    return tuple(f"{name}_{joint}_{unit}" for joint in range(1, 8))


QUANTITIES = (
    MeasuredQuantity(
        "joint_torque_Nm",
        "tau_J",
        _of_joints("joint_torque", "Nm"),
        "/joints/measured",
        "effort",
        "torque of every joint, measured behind its gear: weight, acceleration and contact together",
    ),
    EXTERNAL_TORQUE := MeasuredQuantity(
        "external_torque_Nm",
        "tau_ext_hat_filtered",
        _of_joints("external_torque", "Nm"),
        "/joints/external",
        "effort",
        "the arm's filtered estimate of the torque that external forces put on every joint",
    ),
    MeasuredQuantity(
        "external_wrench",
        "O_F_ext_hat_K",
        tuple(f"external_{part}_{axis}_{unit}" for part, unit in (("force", "N"), ("torque", "Nm")) for axis in "xyz"),
        "/wrench/external",
        "wrench",
        "the arm's estimate of the external force and torque on the end effector's stiffness frame, along the base",
    ),
)
