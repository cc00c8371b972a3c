"""From an action to the motion of the spatula.

The tool frame T sits on the top face of the blade at the middle of its leading edge: X points forward out of
the edge, Y to the left, Z up from the face. Pitch is about +Y: positive holds the edge down and the handle up.

The paper prescribes velocities of the wrist point F (A4.1; knots of the public code). Taken literally, they command the
edge up to 11 mm into the table, which stops a real arm with a reflex. So X and pitch are those of the paper. The height
of the edge is that of the paper too, but lifted so that the edge is commanded at most `DEPTH_LIMIT_M` below the table.
There the arm's compliance matters: `VERTICAL_STIFFNESS_N_M` is that of a Franka under its default joint impedance
(3000, 2500 and 2000 Nm/rad in joints 2, 4, 6 with levers of about 0.75, 0.4 and 0.25 m).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from hw.types import PATH_RATE_HZ, Array, ContactWindow
from sim.tasks.scooping.params import ACTION, CONTEXT, CORNER_M, EDGE_M, WRIST_IN_TOOL_M
from sim.types import ToolMotion

DURATION_S = 1.0
DEPTH_LIMIT_M = 0.003
VERTICAL_STIFFNESS_N_M = 4000.0
VERTICAL_DAMPING_NS_M = 130.0
"""Critical damping for an effective mass of 1 kg at the edge."""

_KNOTS_S = np.array([0.0, 0.25, 0.35, 0.60, 0.70, 1.00])
_WRIST_VX_M_S = np.array([0.0, 0.6, 0.7, 0.2, 0.0, 0.0])
_WRIST_VZ_M_S = np.array([0.0, -0.01, -0.01, 0.01, 0.0, 0.0])
_PITCH_RATE_RAD_S = np.array([0.0, 0.0, -0.6, -0.6, 0.0, 0.0])  # the second one is set by the action
_HANN = 0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, 2 * 90 + 1))
_LIFT_WINDOW = _HANN / _HANN.sum()  # samples at 1 kHz
_RELEASE_S = 0.05
"""The time for which the edge may still touch after its command rises, because of the compliance, with reserve."""


def plan(context: Array, action: Array) -> ToolMotion:
    """The motion for `action` (pitch rate, pitch, distance) at a piece whose near side lies at `context` (x, y).

    It starts with the edge on the table, `distance` behind that side, and is at rest with zero acceleration at both
    ends. `contact` holds the deepest command and the force it predicts.
    """
    a, place = ACTION.named(action), CONTEXT.named(context)
    pitch_rad, p_m = edge_path(a.pitch_rate, a.pitch)
    t_s = _times()
    start_m = np.array([place.x - a.distance, place.y])
    X_BT = np.tile(np.eye(4), (len(t_s), 1, 1))
    cos, sin = np.cos(pitch_rad), np.sin(pitch_rad)
    X_BT[:, 0, 0], X_BT[:, 0, 2], X_BT[:, 2, 0], X_BT[:, 2, 2] = cos, sin, -sin, cos
    X_BT[:, 0, 3] = start_m[0] + p_m[:, 0]
    X_BT[:, 1, 3] = start_m[1]
    X_BT[:, 2, 3] = p_m[:, 1] + edge_height_m(pitch_rad)
    return ToolMotion(t_s, X_BT, _contact(t_s, p_m[:, 1]))


def edge_path(pitch_rate_rad_s: float, pitch_rad: float) -> tuple[Array, Array]:
    """Pitch (N,) and the edge's (x, z) (N, 2) at 1 kHz: x from its start, z the height of its lowest point.

    A clamped cubic spline of the wrist's velocity, lifted where it goes deeper than `DEPTH_LIMIT_M` below the table.
    """
    wrist_m, turned_rad = _profile()
    pitch = pitch_rad + turned_rad[:, 0] + pitch_rate_rad_s * turned_rad[:, 1]
    cos, sin = np.cos(pitch), np.sin(pitch)
    ahead, below = -WRIST_IN_TOOL_M[0], -WRIST_IN_TOOL_M[2]  # T as seen from the wrist
    p_m = wrist_m + np.stack([ahead * cos + below * sin, below * cos - ahead * sin], axis=-1)
    p_m = p_m - p_m[0]
    return pitch, np.stack([p_m[:, 0], _lifted(p_m[:, 1])], axis=-1)


def _lifted(height_m: Array) -> Array:
    """(N,) heights with the minimum -`DEPTH_LIMIT_M`: the depth below some level is added back, smoothed in time.

    The smoothing protects the arm: with a Hann window of 2 x 90 ms the motion needs at most 2 m/s²; a plain saturation
    needs 6 (docs/decisions/0002).
    """

    def with_floor(floor_m: float) -> Array:
        missing_m = np.maximum(floor_m - height_m, 0.0)
        return np.asarray(height_m + np.convolve(missing_m, _LIFT_WINDOW, mode="same"))

    if height_m.min() >= -DEPTH_LIMIT_M:
        return height_m
    from scipy.optimize import brentq  # noqa: PLC0415 - slow to import, and tasks are named without planning

    return with_floor(brentq(lambda floor_m: with_floor(floor_m).min() + DEPTH_LIMIT_M, height_m.min(), DEPTH_LIMIT_M))


def edge_height_m(pitch_rad: Array) -> Array:
    """Height of T over the lowest point of the edge: a rounded corner of radius `CORNER_M` under T."""
    return (EDGE_M - CORNER_M) * np.cos(pitch_rad) + CORNER_M


def _contact(t_s: Array, height_m: Array) -> ContactWindow:
    rate_m_s = np.gradient(height_m, t_s)
    touching = height_m <= 0.0
    force_N = VERTICAL_STIFFNESS_N_M * -height_m + VERTICAL_DAMPING_NS_M * np.maximum(-rate_m_s, 0.0)
    return ContactWindow(
        start_s=0.0,
        end_s=min(float(t_s[touching][-1]) + _RELEASE_S, DURATION_S),
        depth_m=float(max(-height_m.min(), 0.0)),
        force_N=float(force_N[touching].max()),
    )


def _times() -> Array:
    return np.linspace(0.0, DURATION_S, round(DURATION_S * PATH_RATE_HZ) + 1)


@lru_cache(maxsize=1)
def _profile() -> tuple[Array, Array]:
    """Wrist (x, z) (N, 2) from its start; pitch travelled with pitch rate 0, and per unit of pitch rate (N, 2)."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - as above

    unit = (np.arange(len(_KNOTS_S)) == 1).astype(float)
    rates = np.stack([_WRIST_VX_M_S, _WRIST_VZ_M_S, _PITCH_RATE_RAD_S, unit], axis=-1)
    moved = CubicSpline(_KNOTS_S, rates, bc_type="clamped").antiderivative()(_times())
    return moved[:, :2], moved[:, 2:]
