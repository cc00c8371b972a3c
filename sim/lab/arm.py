"""The lab's arm, as `hw.ports.Arm`, and the person who guides it by hand."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from hw.braking import brake
from hw.errors import ArmFault, DeviceUnavailable, StoppedByPedal
from hw.joint_limits import LIMITS
from hw.poses import pose
from hw.types import ArmState, Array, Execution, JointPath
from hw.workcell import Workcell, refuse_unless_safe
from sim.errors import SimError
from sim.lab.board import THICKNESS_M, HeldBoard
from sim.lab.cell import DivergedError
from sim.lab.room import Room
from sim.panda.model import postures


class ArmInLab(ABC):
    """The common part of the lab's arms: connection, state and fault. See `hw.ports.Arm`."""

    def __init__(self, cell: Workcell, again: str) -> None:
        """`again` tells a person what to do after a fault."""
        self._cell, self._again, self._connected = cell, again, False
        self._fault: str | None = None

    @abstractmethod
    def _now(self) -> tuple[float, Array]:
        """Clock (s) and reported joints (7,)."""

    @property
    def model(self) -> str:
        """See `hw.ports.Arm`."""
        return self._cell.arm.name

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = False

    def state(self) -> ArmState:
        """See `hw.ports.Arm`."""
        self.need_connection()
        return ArmState(*self._now(), np.zeros(7), self._fault)

    def recover(self) -> None:
        """See `hw.ports.Arm`."""
        self.need_connection()
        self._fault = None

    def need_connection(self) -> None:
        """Raises DeviceUnavailable."""
        if not self._connected:
            raise DeviceUnavailable("the lab's arm is not connected: use it inside a `with` block")

    def _stopped(self, kind: type[ArmFault], reason: str) -> ArmFault:
        self._fault = reason
        return kind(f"{reason}; the arm is at rest, look at it and recover it, then {self._again}")


class LabArm(ArmInLab):
    """A Panda under joint impedance. It refuses the motions that its workcell refuses, and has the world's faults."""

    def __init__(self, room: Room, cell: Workcell) -> None:
        super().__init__(cell, "redo the trial")
        self._room = room

    def _now(self) -> tuple[float, Array]:
        return self._room.t_s, self._room.q_rad

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`; physics runs only if the tool touches something on the way."""
        self.need_connection()
        room = self._room
        refuse_unless_safe(path, self._cell, room.q_rad, fault=self._fault)
        if not room.needs_physics(path):
            return room.travel(path)
        stop_s = room.chance.stop_fraction * path.duration_s
        if room.fault_comes("arm_reflex"):
            keep = path.t_s <= stop_s
            self._simulate(path.t_s[keep], path.q_rad[keep])
            raise self._stopped(ArmFault, f"reflex {stop_s:.3f} s into the path: an external force was too large")
        if room.fault_comes("pedal_release"):
            braked = brake(path, stop_s, self._cell.motion)
            self._simulate(braked.t_s, braked.q_rad)
            raise self._stopped(StoppedByPedal, f"the pedal was released {stop_s:.3f} s into the path")
        return self._simulate(path.t_s, path.q_rad)

    def _simulate(self, t_s: Array, q_rad: Array) -> Execution:
        try:
            return self._room.simulate(t_s, q_rad)
        except DivergedError as error:
            raise self._stopped(ArmFault, str(error)) from error


PLACE_M = (0.62, 0.0)
"""Approximate place of the board's centre, in the base."""
PLACE_STD_M, TURN_STD_RAD = 0.01, 0.05
AIM_STD_M = 3e-4
"""Accuracy of a guided tip at a corner, per axis, m."""
TIP_M = (0.002, -0.001, 0.165)
"""The tip in the flange: a slightly tilted pin in the closed fingers."""
LEAN_RAD = 0.5
NEAR_RAD = (0.0, 0.2, 0.0, -2.2, 0.0, 2.4, 0.785)
_LEAN_STD_RAD = 0.05
_LEAN_SHARES = (1.0, 0.7, 0.4, 0.0)
_AZIMUTHS_RAD = (0.0, np.pi, np.pi / 2, -np.pi / 2)  # towards the camera, away from it, left, right


def laid_board(board: HeldBoard, rng: np.random.Generator) -> Array:
    """(4, 4) X_BM of the board flat on the table, face up, upright in the view of the camera opposite the arm."""
    width, height = board.size_m
    upright = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # print's right: +Y, down: +X, into: -Z
    R = Rotation.from_rotvec([0.0, 0.0, TURN_STD_RAD * rng.standard_normal()]).as_matrix() @ upright
    middle = np.array([*(PLACE_M + PLACE_STD_M * rng.standard_normal(2)), THICKNESS_M])
    return pose(R, middle - R @ np.array([width / 2, height / 2, 0.0]))


def touching_q_rad(p_B_m: Array, number: int, rng: np.random.Generator) -> Array:
    """(7,) true joints with the tip at `p_B_m` (3,), with the accuracy of a hand, tilted to the side of `number`.

    The tilt is smaller if the arm cannot reach, as a person would do it. Raises SimError if it cannot reach even
    upright.
    """
    lean = LEAN_RAD + _LEAN_STD_RAD * rng.standard_normal()
    azimuth = _AZIMUTHS_RAD[number % len(_AZIMUTHS_RAD)] + _LEAN_STD_RAD * rng.standard_normal()
    aimed_m = p_B_m + AIM_STD_M * rng.standard_normal(3)
    for share in _LEAN_SHARES:
        q = _within_limits(aimed_m, share * lean, azimuth)
        if len(q):
            return np.asarray(q[np.linalg.norm(q - NEAR_RAD, axis=1).argmin()])
    raise SimError(f"the tip cannot be guided to {np.round(p_B_m, 3)} m: the board lies outside the arm's reach")


def _within_limits(p_B_m: Array, lean_rad: float, azimuth_rad: float) -> Array:
    """(N, 7) joints, away from their limits, with the tip at that place and the hand at that tilt."""
    axis = np.array([-np.sin(azimuth_rad), np.cos(azimuth_rad), 0.0])
    R_BF = Rotation.from_rotvec(lean_rad * axis).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    limits = LIMITS["panda"]
    q = postures(pose(R_BF, p_B_m - R_BF @ np.array(TIP_M)), limits, 61)
    return np.asarray(q[((q > limits.q_min_rad + 0.05) & (q < limits.q_max_rad - 0.05)).all(axis=1)])
