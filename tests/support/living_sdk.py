"""The stand-in of an SDK with an arm that follows as a real one does: behind its commands, with speeds and noise.

Measured joints follow the commands with a lag, velocities are reported, torques have the noise of a real arm, and an
arm that stops by itself needs some time to come to rest. Gaps in the arm's clock come where `gaps` says.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from franka_modes import Monitor
from sdk_fake import Duration, FakeRobot, FakeSdk, JointPositions

from hw.joint_limits import LIMITS

LAG_MS = 8.0
COAST_MS = 25.0
NOISE_RAD_S, NOISE_NM = 1e-3, np.array([0.22, 0.32, 0.19, 0.31, 0.09, 0.11, 0.03])
"""Root mean square; the torques' is that of a real Panda in motion."""


class JointMonitor(Monitor):
    """What the arm checks of its joints; the flange, which takes longest, is left to whoever judges afterwards."""

    def _broken(self) -> tuple[str, ...]:
        a, b, c, q = self._q
        limits, dq = LIMITS[self.model], (q - c) * 1e3
        ddq = dq - (c - b) * 1e3
        dddq = ddq - (c - 2.0 * b + a) * 1e3
        low, high = limits.velocity_bounds(q)
        margin = 0.003 * limits.ddq_max_rad_s2
        checks = (
            ((q < limits.q_min_rad) | (q > limits.q_max_rad), "joint_motion_generator_position_limits_violation"),
            ((dq < low - margin) | (dq > high + margin), "joint_motion_generator_velocity_limits_violation"),
            (np.abs(ddq) * 1e3 > limits.ddq_max_rad_s2, "joint_motion_generator_velocity_discontinuity"),
            (np.abs(dddq) * 1e6 > limits.dddq_max_rad_s3, "joint_motion_generator_acceleration_discontinuity"),
        )
        return tuple(name for broken, name in checks if broken.any())


@dataclass
class LivingSdk(FakeSdk):
    """`gaps` maps a cycle to the milliseconds since the one before it; `stuck_Nm` (7,) is a torque estimate that stands
    still; `coast_ms` is the time constant with which an arm comes to rest that stops by itself.
    """

    coast_ms: float = COAST_MS
    gaps: dict[int, int] = field(default_factory=dict)
    stuck_Nm: tuple[float, ...] | None = None
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def Robot(self, host: str, realtime: str) -> LivingRobot:
        self.robot = robot = LivingRobot(self)
        robot.did("Robot", (host, realtime))
        return robot


class LivingRobot(FakeRobot):
    """Every state is a millisecond after the one before."""

    sdk: LivingSdk

    def __init__(self, sdk: LivingSdk) -> None:
        super().__init__(sdk)
        self._monitor = JointMonitor(self._monitor.model)
        self._felt, self._dq = np.array(self._q, dtype=np.float64), np.zeros(7)
        self._coast_rad_s = np.zeros(7)

    def _state(self) -> Any:
        state = super()._state()
        if self._coast_rad_s.any():
            self._coast_rad_s *= np.exp(-1.0 / self.sdk.coast_ms) * (np.abs(self._coast_rad_s).max() > 1e-3)
            self._q = (np.array(self._q) + 1e-3 * self._coast_rad_s).tolist()
        before = self._felt
        self._felt = before + (np.array(self._q) - before) * (1.0 - np.exp(-1.0 / LAG_MS))
        self._dq = 1e3 * (self._felt - before)
        noise = self.sdk.rng.standard_normal((2, 7))
        state.q, state.q_d = self._felt.tolist(), list(self._q)
        state.dq = (self._dq + NOISE_RAD_S * np.clip(noise[0], -3.0, 3.0)).tolist()
        live_Nm = np.array(self.sdk.feels(self._q)) + NOISE_NM * noise[1]
        state.tau_ext_hat_filtered = live_Nm.tolist() if self.sdk.stuck_Nm is None else list(self.sdk.stuck_Nm)
        return state

    def take(self, command: JointPositions) -> None:
        before = np.array(self._q)
        try:
            super().take(command)
        except Exception:
            self._coast_rad_s = self._dq.copy()
            self._q = before.tolist()
            raise

    def _since(self) -> Duration:
        """As the stand-in's, and longer after a gap."""
        since = super()._since()
        ms = self.sdk.gaps.get(self._cycle)
        return since if ms is None else Duration(ms / 1e3)
