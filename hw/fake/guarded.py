"""An arm that feels a plane, for tests of the code around guarded motions: no physics, no waiting."""

from __future__ import annotations

import numpy as np

from hw.around import AroundArm
from hw.collision import Table, Tool, point_heights
from hw.contact import Detector
from hw.errors import NoContact
from hw.fake.arm import FakeArm
from hw.franka.settings import Payload
from hw.guarding import require_guarded
from hw.kinematics import jacobian, link_poses
from hw.types import Array, Contact, Execution, Guard, JointPath, frozen_array
from hw.workcell import refuse_while_stopped

STIFFNESS_N_M = 4000.0


class FakeGuardedArm(AroundArm[FakeArm]):
    """`arm` with a table that its tool meets at `plane`; measured joints equal the commanded ones.

    `torque_Nm(path)` (N, 7) is added to the torque of the contact: noise, spikes, a push by somebody's hand.
    """

    def __init__(
        self,
        arm: FakeArm,
        plane: Table | None,
        *,
        torque_Nm: Array | None = None,
    ) -> None:
        """`plane` None: there is nothing to touch. `torque_Nm` (7,) or (N, 7) for paths of N samples."""
        super().__init__(arm)
        self._plane = plane
        self.carried: list[Payload] = []
        self._torque_Nm = np.zeros(7) if torque_Nm is None else torque_Nm

    @property
    def notes(self) -> tuple[str, ...]:
        """Nothing is missing."""
        return ()

    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
        return self._arm.execute(path)

    def carry(self, tool: Tool, payload: Payload) -> None:
        """Set the load on the flange from now on; `carried` records all loads."""
        self._arm.cell = self._arm.cell.holding(tool)
        self.carried.append(payload)

    def execute_until_contact(self, path: JointPath, guard: Guard) -> Contact:
        """See `hw.ports.GuardedArm`."""
        state = self._arm.state()
        refuse_while_stopped(state.fault)
        require_guarded(path, guard, self._arm.cell, state.q_rad)
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

    def _torque(self, path: JointPath, guard: Guard) -> Array:
        torque = np.zeros((len(path.t_s), 7)) + self._torque_Nm
        if self._plane is None:
            return torque
        cell = self._arm.cell
        q_rad = cell.arm.true_rad(path.q_rad)
        deep_m = np.maximum(-point_heights(link_poses(q_rad), cell.tool, self._plane).min(axis=1), 0.0)
        J = jacobian(q_rad, guard.p_F_m)
        return np.asarray(torque + STIFFNESS_N_M * deep_m[:, None] * J[:, 2])
