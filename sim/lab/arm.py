"""The lab's arm, as `hw.ports.Arm`."""

from __future__ import annotations

from typing import Self

import numpy as np

from hw.braking import brake
from hw.errors import ArmFault, DeviceUnavailable, StoppedByPedal
from hw.refusal import refuse_unless_safe
from hw.types import ArmState, Array, Execution, JointPath
from hw.workcell import Workcell
from sim.lab.motion import DivergedError
from sim.lab.room import Room


class LabArm:
    """A Panda under joint impedance. It refuses the motions that its workcell refuses, and has the world's faults."""

    def __init__(self, room: Room, cell: Workcell) -> None:
        self._room, self._cell = room, cell
        self._connected = False
        self._fault: str | None = None

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
        self._need_connection()
        return ArmState(self._room.t_s, self._room.q_rad, np.zeros(7), self._fault)

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`; physics runs only if the tool touches something on the way."""
        self._need_connection()
        room = self._room
        refuse_unless_safe(path, self._cell, room.q_rad, fault=self._fault)
        if not self._room.needs_physics(path):
            return self._room.travel(path)
        stop_s = self._room.chance.stop_fraction * path.duration_s
        if self._comes("arm_reflex"):
            keep = path.t_s <= stop_s
            self._simulate(path.t_s[keep], path.q_rad[keep])
            raise self._stopped(ArmFault, f"reflex {stop_s:.3f} s into the path: an external force was too large")
        if self._comes("pedal_release"):
            braked = brake(path, stop_s, self._cell.motion)
            self._simulate(braked.t_s, braked.q_rad)
            raise self._stopped(StoppedByPedal, f"the pedal was released {stop_s:.3f} s into the path")
        return self._simulate(path.t_s, path.q_rad)

    def recover(self) -> None:
        """See `hw.ports.Arm`."""
        self._need_connection()
        self._fault = None

    def _comes(self, fault: str) -> bool:
        if fault not in self._room.faults_due:
            return False
        self._room.faults_due.remove(fault)
        return True

    def _simulate(self, t_s: Array, q_rad: Array) -> Execution:
        try:
            return self._room.simulate(t_s, q_rad)
        except DivergedError as error:
            raise self._stopped(ArmFault, str(error)) from error

    def _stopped(self, kind: type[ArmFault], reason: str) -> ArmFault:
        self._fault = reason
        return kind(f"{reason}; the arm is at rest, look at it and recover it, then redo the trial")

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the lab's arm is not connected: use it inside a `with` block")
