"""From joint torques to a touch: the force on a point of the tool, when it was reached, and where it began.

An external force f on a point of the tool loads the joints with J' f, J being the Jacobian of that point. Three
unknowns against seven torques: least squares. Constant errors of the torque estimate (a payload that is not quite
known, friction) go into the tare, spikes are filtered, and where the touch began is read from how the force rises.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.kinematics import forward, jacobian
from hw.types import PATH_RATE_HZ, Array, Contact, Guard

MEDIAN_OF = 25
"""Samples of the force, at 1 kHz, whose median counts: a spike of less than half of these does not."""

STIFFNESS_N_M = 6000.0
"""The most that an arm under its default joint impedance presses back (docs/decisions/0005: 3600 to 4800)."""
STOP_S = 0.12
"""Longest time from reaching the force to standstill: the median, and braking from a slow motion."""
IMPACT_NS_M = 500.0
"""Peak force of an impact per m/s: root of contact stiffness (1e5 N/m, nylon on wood) times effective mass (2.5 kg)."""

WINDOW_M = 0.006
"""How much of the way before the end is used to find where the touch began: of it what is no faster than the end."""
_STEADY = 1.3
_CANDIDATES = 121


def contact_force(q_rad: Array, torque_Nm: Array, p_F_m: Array) -> Array:
    """Joints and external torques (M, 7) -> force (M, 3) on the flange's point `p_F_m`, in base axes, in N."""
    J = jacobian(q_rad, p_F_m)[..., :3, :]  # (M, 3, 7)
    return np.asarray(np.linalg.solve(J @ np.swapaxes(J, -1, -2), (J @ torque_Nm[..., None]))[..., 0])


def predicted_force_N(guard: Guard, speed_m_s: float) -> float:
    """The largest force to expect of a guarded motion that touches at `speed_m_s`."""
    return guard.force_N + STIFFNESS_N_M * STOP_S * speed_m_s + IMPACT_NS_M * speed_m_s


class Detector:
    """Says when a guarded motion has touched; fed with what the arm measures, 1 kHz, in pieces of any length.

    The magnitude counts, not the sign: drivers differ in which way round they report, and a pull is a touch too.
    """

    def __init__(self, guard: Guard) -> None:
        self._guard = guard
        self._tared: list[Array] = []
        self._zero_Nm: Array | None = None
        self._last_N = np.zeros(MEDIAN_OF - 1)
        self.largest_N = 0.0

    def feed(self, t_s: Array, q_rad: Array, torque_Nm: Array) -> int | None:
        """Path times (M,), measured joints and torques (M, 7) -> the index at which it has touched, or None."""
        in_tare = t_s < self._guard.tare_s
        self._tared += list(torque_Nm[in_tare])
        if in_tare.all():
            return None
        if self._zero_Nm is None:
            self._zero_Nm = np.mean(self._tared, axis=0) if self._tared else np.zeros(7)
        first = int(np.argmin(in_tare))
        force = contact_force(q_rad[first:], torque_Nm[first:] - self._zero_Nm, self._guard.p_F_m)[:, 2]
        longer = np.concatenate([self._last_N, force])
        self._last_N = longer[len(longer) - MEDIAN_OF + 1 :]
        quiet = np.abs(np.median(np.lib.stride_tricks.sliding_window_view(longer, MEDIAN_OF), axis=-1))
        above = np.flatnonzero(quiet >= self._guard.force_N)
        seen = quiet[: above[0] + 1] if len(above) else quiet
        self.largest_N = max(self.largest_N, float(seen.max()))
        return first + int(above[0]) if len(above) else None


@dataclass(frozen=True, eq=False)
class Touch:
    """Where a contact began: before any force bent anything."""

    q_rad: Array  # (7,) measured joints at that moment
    stiffness_N_m: float  # how steeply the force rose with the commanded way
    sigma_m: float  # one standard deviation of the way at which it began, from the noise of the force


def began(contact: Contact, guard: Guard) -> Touch | None:
    """Where the touch began: a flat stretch, a step and a rising line, fitted to force over commanded way down.

    None where the force does not rise like that: it came at once, or without way (a knock, something that gave in).
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
    if after.sum() < 20 or (~after).sum() < 20 or abs(slope) * (way_m[-1] - start) < 0.5 * guard.force_N:
        return None
    noise_N = float(np.sqrt(cost[best] / len(way_m)))
    sigma_m = 2.0 * noise_N / abs(slope) / float(np.sqrt(min(after.sum(), (~after).sum())))
    at = min(int(np.searchsorted(way_m, start)), len(way_m) - 1)
    around = slice(max(at - 5, 0), at + 6)
    return Touch(measured[around].mean(axis=0), abs(slope), sigma_m)


def _hinges(x: Array, y: Array, starts: Array) -> tuple[Array, Array]:
    """Least squares of y = b + c [x > start] + k max(0, x - start) for each start (S,) -> (squared error (S,), k (S,)).

    The step is what the joints' damping carries once the tool stands and the path goes on. It may not oppose the rise.
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
