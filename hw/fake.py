"""Scripted arm and clock: no physics, no rendering, no waiting."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from hw.collision import Table, Tool, point_heights
from hw.contact import Detector, estimate_errors_Nm
from hw.errors import ArmFault, DeviceUnavailable, NoContact
from hw.franka.motions import StopReport
from hw.franka.settings import Payload
from hw.kinematics import jacobian, link_poses
from hw.types import ArmState, Array, Contact, Execution, Guard, JointPath, frozen_array
from hw.workcell import Workcell, refuse_unless_safe, refuse_while_stopped, require_guarded

STIFFNESS_N_M = 4000.0
"""Stiffness of the surface that the fake arm touches."""


class FakeArm:
    """`hw.ports.GuardedArm`: refuses what its `cell` refuses; else it jumps to the end of the path.

    Its clock advances by the duration of each motion.

    `executed` holds the paths that were begun, `carried` all loads, oldest first. `faults` maps the number of an
    execution (from 1) to the fault that stops it half way. Its tool meets a table at `plane` (None: there is nothing to
    touch), and measured joints equal the commanded ones. `torque_Nm`, (7,) or (N, 7) for paths of N samples, is added
    to the torque of the contact: noise, spikes, a push by somebody's hand; None: the errors of a live estimate.
    """

    notes: tuple[str, ...] = ()

    def __init__(
        self,
        q_rad: ArrayLike,
        clock: FakeClock,
        cell: Workcell,
        *,
        faults: Mapping[int, ArmFault] | None = None,
        plane: Table | None = None,
        torque_Nm: Array | None = None,
    ) -> None:
        self._q_rad, self._clock = frozen_array(q_rad, (7,), "q_rad"), clock
        self.cell, self._faults = cell, dict(faults or {})
        self._connected = False
        self._fault: str | None = None
        self._plane, self._torque_Nm, self._rng = plane, torque_Nm, np.random.default_rng(0)
        self.executed: list[JointPath] = []
        self.last_stop: StopReport | None = None  # it jumps, so there is none to report
        self.carried: list[Payload] = []

    @property
    def model(self) -> str:
        """See `hw.ports.Arm`."""
        return self.cell.arm.name

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = False

    def state(self) -> ArmState:
        """See `hw.ports.Arm`."""
        self._need_connection()
        return ArmState(self._clock.now_s(), self._q_rad, np.zeros(7), self._fault)

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
        self._need_connection()
        refuse_unless_safe(path, self.cell, self._q_rad, fault=self._fault)
        self.executed.append(path)
        fault = self._faults.get(len(self.executed))
        last = len(path.t_s) - 1 if fault is None else len(path.t_s) // 2
        t_start_s = self._clock.now_s()
        self._clock.sleep(float(path.t_s[last]))
        self._q_rad = frozen_array(path.q_rad[last])
        if fault is not None:
            self._fault = str(fault)
            raise fault
        return Execution(t_start_s, path.t_s, path.q_rad, path.q_rad, 1.0)

    def carry(self, tool: Tool, payload: Payload) -> None:
        """Set the load on the flange from now on."""
        self.cell = self.cell.holding(tool)
        self.carried.append(payload)

    def execute_until_contact(self, path: JointPath, guard: Guard) -> Contact:
        """See `hw.ports.GuardedArm`."""
        self._need_connection()
        refuse_while_stopped(self._fault)
        require_guarded(path, guard, self.cell, self._q_rad)
        torque_Nm = self._torque(path, guard)
        detector = Detector(guard)
        at = detector.feed(path.t_s, path.q_rad, torque_Nm)
        if at is None:
            raise NoContact("the arm came down to the end of its path and touched nothing; it is back at the start")
        felt = slice(0, at + 1)
        return Contact(
            float(path.t_s[at]),
            frozen_array(path.q_rad[at]),
            detector.largest_N,
            path.t_s[felt],
            path.q_rad[felt],
            path.q_rad[felt],
            torque_Nm[felt],
        )

    def recover(self) -> None:
        """See `hw.ports.Arm`."""
        self._need_connection()
        self._fault = None

    def _torque(self, path: JointPath, guard: Guard) -> Array:
        q_rad = self.cell.arm.true_rad(path.q_rad)
        own_Nm = estimate_errors_Nm(q_rad, self._rng) if self._torque_Nm is None else self._torque_Nm
        torque = np.zeros((len(path.t_s), 7)) + own_Nm
        if self._plane is None:
            return torque
        deep_m = np.maximum(-point_heights(link_poses(q_rad), self.cell.tool, self._plane).min(axis=1), 0.0)
        J = jacobian(q_rad, guard.p_F_m)
        return np.asarray(torque + STIFFNESS_N_M * deep_m[:, None] * J[:, 2])

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the fake arm is not connected: use it inside a `with` block")


class FakeClock:
    """Seconds since some origin; sleeping moves it and returns at once."""

    def __init__(self, t_s: float = 0.0) -> None:
        self._t_s = t_s

    def now_s(self) -> float:
        """Seconds since the origin."""
        return self._t_s

    def sleep(self, duration_s: float) -> None:
        """Move on by `duration_s`. Raises ValueError when negative."""
        if duration_s < 0.0:
            raise ValueError(f"cannot sleep for {duration_s:g} s: the duration must be 0 or more")
        self._t_s += duration_s
