"""An arm that plays paths instantly, for tests of the code around an arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from hw.errors import ArmFault, DeviceUnavailable
from hw.fake.clock import FakeClock
from hw.types import ArmState, Execution, JointPath, frozen_array
from hw.workcell import Workcell, refuse_unless_safe


class FakeArm:
    """Refuses what its `cell` refuses; else it jumps to the end of the path and advances its clock by the duration.

    `executed` holds the paths that were begun, oldest first. `faults` maps the number of an execution (from 1)
    to the fault that stops it half way. To change the tool, replace `cell`.
    """

    def __init__(
        self,
        q_rad: ArrayLike,
        clock: FakeClock,
        cell: Workcell,
        *,
        faults: Mapping[int, ArmFault] | None = None,
    ) -> None:
        self._q_rad, self._clock = frozen_array(q_rad, (7,), "q_rad"), clock
        self.cell, self._faults = cell, dict(faults or {})
        self._connected = False
        self._fault: str | None = None
        self.executed: list[JointPath] = []

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

    def recover(self) -> None:
        """See `hw.ports.Arm`."""
        self._need_connection()
        self._fault = None

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the fake arm is not connected: use it inside a `with` block")
