"""A touch, found in joint torques: the force on a point of the tool, the moment, and the place where it began.

An external force f on a point of the tool loads the joints with J' f, J being the Jacobian of that point. Seven torques
give three unknowns by least squares. The tare absorbs constant errors of the torque estimate (an inexact payload,
friction), a median removes spikes, and the rise of the force shows where the touch began.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin

import numpy as np

from hw.kinematics import CRAIG, FLANGE_M, JOINTS, forward, jacobian
from hw.types import PATH_RATE_HZ, Array, Contact, Guard, frozen_array

MEDIAN_OF = 25
"""The force is a median of this many samples at 1 kHz: a spike shorter than half of them has no effect."""

STIFFNESS_N_M = 6000.0
"""In N/m, the largest stiffness of an arm under its default joint impedance (docs/decisions/0005: 3600 to 4800)."""
STOP_S = 0.12
"""Longest time from reaching the force to standstill: the delay of the median, then braking from a slow motion."""
IMPACT_NS_M = 500.0
"""Peak force of an impact per m/s: √(contact stiffness 1e5 N/m, nylon on wood, × effective mass 2.5 kg)."""

WINDOW_M = 0.006
"""The last stretch of the path, in m, in which the start of the touch is searched; faster parts of it are left out."""
TORQUE_NOISE_NM = frozen_array((0.22, 0.32, 0.19, 0.31, 0.09, 0.11, 0.03), (JOINTS,), "torque noise")
"""(7,) root mean square of the high-pass filtered joint torques of a real Panda in motion; simulated arms add it."""
RIPPLE_NM, RIPPLE_PER_RAD = 0.15, 30.0
"""Error of the torque estimate that is periodic in each joint's angle (gears)."""


def estimate_errors_Nm(q_rad: Array, rng: np.random.Generator) -> Array:
    """(..., 7) a live estimate of external torques at joints (..., 7) without any contact: the noise of a
    real Panda, and ripple that depends on the posture.
    """
    phase_rad = np.arange(7.0)
    ripple_Nm = RIPPLE_NM * np.sin(RIPPLE_PER_RAD * np.asarray(q_rad) + phase_rad)
    return np.asarray(ripple_Nm + TORQUE_NOISE_NM * rng.standard_normal(np.shape(q_rad)))


LEAST_RISE = 0.25
"""Share of the guard's force that has to rise with travel.

The rest comes at once from the joints' damping, or existed before: gear ripple shifts the estimate by more than 1 N
between the tare and the table.
"""
_STEADY = 1.3
_CANDIDATES = 121


def contact_force(q_rad: Array, torque_Nm: Array, p_F_m: Array) -> Array:
    """Joints and external torques (M, 7) -> force (M, 3) on the flange's point `p_F_m`, in base axes, in N."""
    J = jacobian(q_rad, p_F_m)[..., :3, :]  # (M, 3, 7)
    return np.asarray(np.linalg.solve(J @ np.swapaxes(J, -1, -2), (J @ torque_Nm[..., None]))[..., 0])


def predicted_force_N(guard: Guard, speed_m_s: float) -> float:
    """The largest force to expect of a guarded motion that touches at `speed_m_s`."""
    return guard.force_N + STIFFNESS_N_M * STOP_S * speed_m_s + IMPACT_NS_M * speed_m_s


def vertical_force_N(q_rad: Sequence[float], torque_Nm: Sequence[float], p_F_m: Sequence[float]) -> float:
    """The vertical part of `contact_force` for one posture: joints and torques (7,), the point (3,), in plain floats.

    Arrays of three numbers cost a control cycle far more than the arithmetic does.
    """
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    px = py = pz = 0.0
    joints = []
    for (a, d, sine), angle in zip(CRAIG, q_rad, strict=True):
        if sine:
            yx, yy, yz, zx, zy, zz = sine * zx, sine * zy, sine * zz, -sine * yx, -sine * yy, -sine * yz
        px, py, pz = px + a * xx + d * zx, py + a * xy + d * zy, pz + a * xz + d * zz
        c, s = cos(angle), sin(angle)
        xx, xy, xz, yx, yy, yz = (
            c * xx + s * yx, c * xy + s * yy, c * xz + s * yz, c * yx - s * xx, c * yy - s * xy, c * yz - s * xz,
        )  # fmt: skip
        joints.append((zx, zy, zz, px, py, pz))
    u, v, w = p_F_m[0], p_F_m[1], p_F_m[2] + FLANGE_M
    px, py, pz = px + u * xx + v * yx + w * zx, py + u * xy + v * yy + w * zy, pz + u * xz + v * yz + w * zz
    a11 = a12 = a13 = a22 = a23 = a33 = b1 = b2 = b3 = 0.0  # J J' f = J torque
    for (zx, zy, zz, ox, oy, oz), torque in zip(joints, torque_Nm, strict=True):
        rx, ry, rz = px - ox, py - oy, pz - oz
        j1, j2, j3 = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
        a11, a12, a13 = a11 + j1 * j1, a12 + j1 * j2, a13 + j1 * j3
        a22, a23, a33 = a22 + j2 * j2, a23 + j2 * j3, a33 + j3 * j3
        b1, b2, b3 = b1 + j1 * torque, b2 + j2 * torque, b3 + j3 * torque
    c31, c32, c33 = a12 * a23 - a22 * a13, a12 * a13 - a11 * a23, a11 * a22 - a12 * a12
    return (c31 * b1 + c32 * b2 + c33 * b3) / (c31 * a13 + c32 * a23 + c33 * a33)


class Detector:
    """Detects when a guarded motion has touched; fed with the arm's measurements at 1 kHz.

    The magnitude counts, not the sign: drivers differ in sign, and a pull is a touch too.
    """

    def __init__(self, guard: Guard) -> None:
        self._force_N, self._tare_s, self._p_F_m = guard.force_N, guard.tare_s, guard.p_F_m.tolist()
        self._tared, self._sum_Nm = 0, [0.0] * JOINTS
        self._zero_Nm: list[float] | None = None
        self._last_N: deque[float] = deque([0.0] * MEDIAN_OF)
        self._in_order_N = [0.0] * MEDIAN_OF
        self.touched = False
        self.largest_N = 0.0

    def feel(self, t_s: float, q_rad: Sequence[float], torque_Nm: Sequence[float]) -> bool:
        """Path time, measured joints and torques (7,) of one cycle -> whether it has touched, in it or before."""
        if t_s < self._tare_s:
            self._sum_Nm = [total + torque for total, torque in zip(self._sum_Nm, torque_Nm, strict=True)]
            self._tared += 1
            return False
        if self._zero_Nm is None:
            self._zero_Nm = [total / max(self._tared, 1) for total in self._sum_Nm]
        above_zero = [torque - zero for torque, zero in zip(torque_Nm, self._zero_Nm, strict=True)]
        force = vertical_force_N(q_rad, above_zero, self._p_F_m)
        del self._in_order_N[bisect_left(self._in_order_N, self._last_N.popleft())]
        insort(self._in_order_N, force)
        self._last_N.append(force)
        quiet = abs(self._in_order_N[MEDIAN_OF // 2])
        self.largest_N = max(self.largest_N, quiet)
        self.touched = self.touched or quiet >= self._force_N
        return self.touched

    def feed(self, t_s: Array, q_rad: Array, torque_Nm: Array) -> int | None:
        """Path times (M,), joints and torques (M, 7) -> the index of the first touch, or None.

        Samples after that index are ignored: the arm brakes there, and its new measurements are fed by another call.
        """
        before = self.touched
        for i, sample in enumerate(zip(t_s.tolist(), q_rad.tolist(), torque_Nm.tolist(), strict=True)):
            if self.feel(*sample) and not before:
                return i
        return None


@dataclass(frozen=True, eq=False)
class Touch:
    """Where a contact began, before any force bent arm or tool."""

    q_rad: Array  # (7,) measured joints at that moment
    stiffness_N_m: float  # rise of the force per commanded travel
    sigma_m: float  # one standard deviation of the travel at which it began, from the noise of the force


def began(contact: Contact, guard: Guard) -> Touch | None:
    """Where the touch began: a flat stretch, a step and a rising line, fitted to force over commanded downward travel.

    None if the force does not rise like that: it came at once, or without travel (a knock, something that gave way).
    """
    way_m = -_height(contact.felt_commanded_rad, guard.p_F_m)
    rate_m_s = np.gradient(way_m) * PATH_RATE_HZ
    other = (rate_m_s > _STEADY * rate_m_s[-1]) | (contact.felt_t_s < guard.tare_s) | (way_m < way_m[-1] - WINDOW_M)
    first = int(np.flatnonzero(other)[-1]) + 1 if other.any() else 0
    way_m, measured = way_m[first:], contact.felt_measured_rad[first:]
    if len(way_m) < 50:
        return None
    force = contact_force(measured, contact.felt_torque_Nm[first:], guard.p_F_m)[:, 2]
    low, high = float(way_m[0]), float(way_m[-1])
    for _ in range(2):  # a coarse search, then one around its best
        starts = np.linspace(low, high, _CANDIDATES)[1:-1]
        cost, slopes = _hinges(way_m, force, starts)
        best = int(np.argmin(cost))
        low, high = starts[max(best - 1, 0)], starts[min(best + 1, len(starts) - 1)]
    start, slope = float(starts[best]), float(slopes[best])
    after = way_m > start
    if after.sum() < 20 or (~after).sum() < 20 or abs(slope) * (way_m[-1] - start) < LEAST_RISE * guard.force_N:
        return None
    noise_N = float(np.sqrt(cost[best] / len(way_m)))
    sigma_m = 2.0 * noise_N / abs(slope) / float(np.sqrt(min(after.sum(), (~after).sum())))
    at = min(int(np.searchsorted(way_m, start)), len(way_m) - 1)
    around = slice(max(at - 5, 0), at + 6)
    return Touch(measured[around].mean(axis=0), abs(slope), sigma_m)


def _hinges(x: Array, y: Array, starts: Array) -> tuple[Array, Array]:
    """Least squares of y = b + c [x > start] + k max(0, x - start) for each start (S,) -> (squared error (S,), k (S,)).

    The step is the force of the joints' damping once the tool is stopped and the path continues. It may not oppose the
    rise.
    """
    step = (x > starts[:, None]).astype(np.float64)
    rise = np.maximum(x - starts[:, None], 0.0)
    step, rise, off = (a - a.mean(axis=-1, keepdims=True) for a in (step, rise, y))
    ss, rr, sr = (np.maximum((a * b).sum(axis=1), 1e-30) for a, b in ((step, step), (rise, rise), (step, rise)))
    sy, ry = step @ off, rise @ off
    det = np.maximum(ss * rr - sr**2, 1e-30)
    c, k = (rr * sy - sr * ry) / det, (ss * ry - sr * sy) / det
    against = c * k <= 0.0
    c, k = np.where(against, 0.0, c), np.where(against, ry / rr, k)
    error = (off**2).sum() - 2.0 * (c * sy + k * ry) + c**2 * ss + 2.0 * c * k * sr + k**2 * rr
    return np.maximum(error, 0.0), np.asarray(k)


def _height(q_rad: Array, p_F_m: Array) -> Array:
    X_BF = forward(q_rad)
    return np.asarray((X_BF[:, 2, :3] @ p_F_m) + X_BF[:, 2, 3])
