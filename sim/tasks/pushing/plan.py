"""From an action to the motion of the pusher.

The plate moves along a line through the bottle's start, turned by the action's yaw. It reaches the action's speed
before it touches the bottle, and pushes for `HOLD_S`. Then it slows down over `SLOW_S` and rises, which releases the
bottle. During the whole motion it pitches up about its lower edge, upright at the moment of touch. It stays clear of
the table. For the tool frame T see mount.py.

Hold, slowing, pitch rate and rise are those of the paper (A4.1) and its public code. Our own choices are a ramp of 0.35
s instead of 0.2 s, the lean before the touch, and rounded corners everywhere, because an arm needs finite jerk
(docs/decisions/0008).
"""

from __future__ import annotations

import numpy as np

from hw.types import PATH_RATE_HZ, Array
from sim.tasks.pushing.params import ACTION, BOTTLE_RADIUS_M, START_M
from sim.types import ToolMotion

RAMP_S = 0.35
HOLD_S = 0.10
SLOW_S = 0.50
PITCH_RATE_RAD_S = 0.8
RISE_M_S = 0.1

GAP_M = 0.010
"""Distance that the plate moves at full speed before it touches: more than the bottle may be misplaced."""

CLEARANCE_M = 0.005
"""Height of the plate's lower edge over the table during the push."""

_ROUND = 0.3
"""Share of a speed change during which the acceleration builds up, and again during which it fades."""

_TURN_S = 0.30
"""How long the pitch rate takes to build up, and to fade."""

_RISE_TURN_S = 0.15


def plan(context: Array, action: Array) -> ToolMotion:
    """The motion for `action` (yaw, speed), in units. The goal in `context` does not enter.

    It starts behind the bottle, is at rest with zero acceleration at both ends, and never touches the table.
    """
    a = ACTION.named(action)
    yaw_rad, speed_m_s = a.yaw, a.speed
    touch_s, slow_s, end_s = phases_s(speed_m_s)
    t_s = np.arange(round(end_s * PATH_RATE_HZ) + 1) / PATH_RATE_HZ
    along_m = speed_m_s * (_ramp(t_s, 0.0, RAMP_S) - _ramp(t_s, slow_s, SLOW_S))
    pitch_rad = PITCH_RATE_RAD_S * (_ramp(t_s, 0.0, _TURN_S) - _ramp(t_s, end_s - _TURN_S, _TURN_S))
    rise_m = RISE_M_S * (_ramp(t_s, slow_s, _RISE_TURN_S) - _ramp(t_s, end_s - _RISE_TURN_S, _RISE_TURN_S))
    before_m, leaning_rad = (float(np.interp(touch_s, t_s, v)) for v in (along_m, pitch_rad))
    return ToolMotion(t_s, _poses(yaw_rad, along_m - before_m - BOTTLE_RADIUS_M, pitch_rad - leaning_rad, rise_m))


def phases_s(speed_m_s: float) -> tuple[float, float, float]:
    """Times at which the plate touches the bottle, begins to slow down, and rests; whole milliseconds."""
    touch_s = RAMP_S + GAP_M / speed_m_s
    slow_s = round((touch_s + HOLD_S) * PATH_RATE_HZ) / PATH_RATE_HZ
    return touch_s, slow_s, slow_s + SLOW_S


def _poses(yaw_rad: float, along_m: Array, pitch_rad: Array, rise_m: Array) -> Array:
    """(N, 4, 4) T at `along_m` (N,) past the bottle's start along the line, `pitch_rad` (N,) nose up."""
    X_BT = np.tile(np.eye(4), (len(along_m), 1, 1))
    cos_yaw, sin_yaw, cos, sin = np.cos(yaw_rad), np.sin(yaw_rad), np.cos(pitch_rad), np.sin(pitch_rad)
    forward, left, up = np.array([cos_yaw, sin_yaw, 0.0]), np.array([-sin_yaw, cos_yaw, 0.0]), np.array([0.0, 0.0, 1.0])
    X_BT[:, :3, 0] = cos[:, None] * forward + sin[:, None] * up
    X_BT[:, :3, 1] = left
    X_BT[:, :3, 2] = cos[:, None] * up - sin[:, None] * forward
    X_BT[:, :3, 3] = np.append(START_M, CLEARANCE_M) + along_m[:, None] * forward + rise_m[:, None] * up
    return X_BT


def _ramp(t_s: Array, start_s: float, duration_s: float) -> Array:
    """(N,) integral over time of a speed that rises from 0 to 1 within `duration_s`, from `start_s` on.

    Its acceleration rises and falls as a half wave of a cosine over the share `_ROUND`, and is constant in between.
    """
    u = np.clip((t_s - start_s) / duration_s, 0.0, 1.0)
    r = _ROUND
    peak = 1.0 / (1.0 - r)

    def rising(v: Array) -> Array:
        """Integral of the speed while the acceleration builds up."""
        return peak * (v**2 / 4.0 - r**2 / (2.0 * np.pi**2) * (1.0 - np.cos(np.pi * v / r)))

    middle = peak * ((u - r / 2.0) ** 2 / 2.0 - r**2 / 8.0) + rising(np.array(r))
    falling = u - 0.5 + rising(1.0 - u)
    area = np.where(u < r, rising(u), np.where(u <= 1.0 - r, middle, falling))
    return np.asarray(duration_s * area + np.maximum(t_s - start_s - duration_s, 0.0))
