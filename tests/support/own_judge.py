"""What a commanded motion does to an arm, by code that shares nothing with `hw`: an independent judge.

Kinematics by the product of exponentials from the arm's zero posture (Lynch and Park, "Modern Robotics", 2017, chapter
4), not by the Denavit-Hartenberg table of `hw.kinematics`. Velocities, accelerations and torques by plain differences
of the places of the links at 1 kHz and d'Alembert's principle, not by recursive Newton-Euler. The limits are the
maker's numbers as written here, and masses and inertias those that the maker publishes for each arm
(tests/data/franka-description). `mesh_judge` adds the maker's meshes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hw.mass import Mass

Array = NDArray[np.float64]

# axis and a point on it, per joint, at q = 0
SCREWS = (
    ((0, 0, 1), (0, 0, 0)),
    ((0, 1, 0), (0, 0, 0.333)),
    ((0, 0, 1), (0, 0, 0)),
    ((0, -1, 0), (0.0825, 0, 0.649)),
    ((0, 0, 1), (0, 0, 0)),
    ((0, -1, 0), (0, 0, 1.033)),
    ((0, 0, -1), (0.088, 0, 0)),
)
_EYE = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_DOWN, _UP = ((1, 0, 0), (0, 0, 1), (0, -1, 0)), ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # Z along +Y, along -Y
_OVER = ((1, 0, 0), (0, -1, 0), (0, 0, -1))
# orientation and origin of base, links 1 to 7 and flange at q = 0
AT_ZERO = (
    (_EYE, (0, 0, 0)),
    (_EYE, (0, 0, 0.333)),
    (_DOWN, (0, 0, 0.333)),
    (_EYE, (0, 0, 0.649)),
    (_UP, (0.0825, 0, 0.649)),
    (_EYE, (0, 0, 1.033)),
    (_UP, (0, 0, 1.033)),
    (_OVER, (0.088, 0, 1.033)),
    (_OVER, (0.088, 0, 0.926)),
)
# q_min, q_max in rad, largest velocity, acceleration and jerk in rad/s, rad/s², rad/s³
MAKERS = {
    "panda": (
        [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
        [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973],
        [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61],
        [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0],
        [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0],
    ),
    "fr3": (
        [-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508],
        [2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508],
        [2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26],
        [10.0] * 7,
        [5000.0] * 7,
    ),
}
MAKERS["fr3v2"] = MAKERS["fr3"]
SLOWER = {
    "fr3": ([0.6599, 0.2517, 0.2, 0.3533, 0.5757, 0.4878, 0.4628], [6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]),
    "fr3v2": ([0.652, 0.25, 0.2005, 0.3542, 0.5738, 0.4885, 0.4592], [6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]),
}
# m/s, m/s², m/s³, then the same of turning
_FR3_FLANGE = (3.0, 9.0, 4500.0, 2.5, 17.0, 8500.0)
MAKERS_FLANGE = {"panda": (1.7, 13.0, 6500.0, 2.5, 25.0, 12500.0), "fr3": _FR3_FLANGE, "fr3v2": _FR3_FLANGE}
MAKERS_NM = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
MOST_NM_S = 1000.0
# link, both ends in its frame in m, radius in m: the maker's coarse model, and the hand on the flange
CAPSULES = (
    (1, (0, 0, -0.333), (0, 0, -0.05), 0.06),
    (2, (0, 0, -0.06), (0, 0, 0.06), 0.06),
    (3, (0, 0, -0.22), (0, 0, -0.07), 0.06),
    (4, (0, 0, -0.06), (0, 0, 0.06), 0.06),
    (5, (0, 0, -0.31), (0, 0, -0.21), 0.06),
    (5, (0, 0.08, -0.20), (0, 0.08, -0.06), 0.025),
    (6, (0, 0, -0.07), (0, 0, 0.01), 0.05),
    (7, (0, 0, -0.06), (0, 0, 0.08), 0.04),
    (7, (0.06, 0, 0.077), (0.06, 0, 0.087), 0.03),
    (8, (-0.0353553, -0.0353553, 0.04), (0.0353553, 0.0353553, 0.04), 0.04),
    (8, (0, 0, 0.08), (0, 0, 0.095), 0.022),
)
DESCRIPTION = Path(__file__).parents[1] / "data" / "franka-description"
HARMLESS = 1.0 + 1e-9
DIFFERENCES = 1.02
"""What differences of samples may be off by, as a factor."""
CLEAR_M, TABLE_M, TOUCH_M, DEEPEST_M = 0.01, 0.002, 0.0005, 0.006
"""What is promised to be kept from a box and from the table, and how deep a tip may go outside and inside a window."""


@dataclass(frozen=True)
class Scene:
    """What stands around the arm, and what it holds."""

    load: Mass  # in the flange, hand included
    tip_F_m: Array  # (3,) the point that may touch the table
    boxes: tuple[tuple[Array, Array], ...]  # lower and upper corners


@dataclass(frozen=True)
class Touching:
    """A declared contact: its times in s and its depth in m."""

    start_s: float
    end_s: float
    depth_m: float


def poses(q: Array) -> Array:
    """(N, 7) -> (N, 9, 4, 4): base, links and flange."""
    at = np.tile(np.eye(4), (len(q), 1, 1))
    found = np.zeros((len(q), 9, 4, 4))
    for link, (R, p) in enumerate(AT_ZERO):
        if 1 <= link <= 7:
            axis, point = (np.array(v, dtype=np.float64) for v in SCREWS[link - 1])
            at = at @ _about(axis, point, q[:, link - 1])
        zero = np.eye(4)
        zero[:3, :3], zero[:3, 3] = R, p
        found[:, link] = at @ zero
    return found


def _about(axis: Array, point: Array, angle: Array) -> Array:
    """Rodrigues' rotation about a line, (N, 4, 4)."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R = np.eye(3) + np.sin(angle)[:, None, None] * K + (1 - np.cos(angle))[:, None, None] * (K @ K)
    X = np.tile(np.eye(4), (len(angle), 1, 1))
    X[:, :3, :3], X[:, :3, 3] = R, point - R @ point
    return X


@cache
def published(model: str) -> tuple[Mass, ...]:
    """Mass and inertia of links 1 to 7, each in its link's frame, from the maker's `inertials.yaml`."""
    folder = DESCRIPTION / {"panda": "fer"}.get(model, model)
    numbers: dict[str, dict[str, list[float]]] = {}
    for line in (folder / "inertials.yaml").read_text(encoding="utf-8").splitlines():
        key, _, value = line.strip().partition(":")
        if line and not line.startswith((" ", "#")):
            numbers[key] = {}
        elif value.strip():
            numbers[list(numbers)[-1]][key] = [float(part) for part in value.split()]
    bodies = []
    for i in range(1, 8):
        of = numbers[f"link{i}"]
        assert not any(of["rpy"])
        (xx,), (xy,), (xz,), (yy,), (yz,), (zz,) = (of[key] for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        bodies.append(Mass(of["mass"][0], np.array(of["xyz"]), inertia))
    return tuple(bodies)


def torques(q: Array, load: Mass, links: Sequence[Mass]) -> Array:
    """Samples (N, 7) of a motion at 1 kHz -> (N - 2, 7) torques at all but the first and the last.

    Every body's weight, and what its acceleration and its change of spin need, turns each joint below it.
    """
    X = poses(q)
    axes = [X[:, i, :3, 2] for i in range(1, 8)]
    origins = [X[:, i, :3, 3] for i in range(1, 8)]
    found = np.zeros((len(q) - 2, 7))
    bodies = [*enumerate(links, start=1), (8, load)]
    for link, body in bodies:
        R, p = X[:, link, :3, :3], X[:, link, :3, 3]
        com = p + R @ body.com_m
        push = body.kg * (np.diff(com, 2, axis=0) * 1e6 + np.array([0.0, 0.0, 9.81]))
        turn = R[1:] @ np.swapaxes(R[:-1], 1, 2)  # from one sample to the next
        half = np.stack(
            [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], 1
        )
        omega = half / 2.0 * 1e3  # small angles: sine and angle agree to 1e-6
        inertia = R @ body.inertia_kg_m2 @ np.swapaxes(R, 1, 2)
        between = (inertia[1:] + inertia[:-1]) / 2.0
        spin = np.einsum("nij,nj->ni", between, omega)
        twist = np.diff(spin, axis=0) * 1e3
        for joint in range(min(link, 7)):
            arm = com[1:-1] - origins[joint][1:-1]
            found[:, joint] += np.einsum("ni,ni->n", axes[joint][1:-1], np.cross(arm, push) + twist)
    return found


def wrong(
    q: Array, q_arm: Array, model: str, scene: Scene, touching: Touching | None = None, *, rests: bool = True
) -> str:
    """What the samples at 1 kHz (N, 7) break, begun at `q_arm` (7,) and ended at rest; "": nothing.

    Not `rests`: the arm stopped by itself after the last sample.
    """
    if not rests and len(q) > 6:
        rest = wrong_within(q, q_arm, model)
        return rest or _places(q, scene, touching)
    return _joints(q, q_arm, model) or _together(q, model, scene.load) or _places(q, scene, touching)


def wrong_alone(q: Array, q_arm: Array, model: str, load: Mass, *, rests: bool = True) -> str:
    """The same without the surroundings: joints, torques and flange. Not `rests`: joints alone, without a rest."""
    if not rests:
        return _joints(q, q_arm, model, rests=False)
    return _joints(q, q_arm, model) or _together(q, model, load)


def wrong_within(q: Array, q_arm: Array, model: str) -> str:
    """The same for the joints alone, without a rest at the end: as if the motion went on with its last acceleration."""
    return _joints(q, q_arm, model, rests=False)


def _joints(q: Array, q_arm: Array, model: str, *, rests: bool = True) -> str:
    q_min, q_max, dq_max, ddq_max, dddq_max = (np.array(v) for v in MAKERS[model])
    if not np.isfinite(q).all():
        return "not finite"
    at_rest = np.concatenate([[q[0]] * 3, q, q[-1:].repeat(3 * rests, axis=0)])
    dq = np.diff(at_rest, axis=0) * 1e3
    up, down = dq_max, dq_max
    if model in SLOWER:  # towards the ends of the range
        offset, braking = (np.array(v) for v in SLOWER[model])
        room = np.maximum(np.stack([q_max - at_rest[1:], at_rest[1:] - q_min]), 0.0)
        up, down = np.minimum(dq_max, np.maximum(np.sqrt(2.0 * braking * room) - offset, 0.0))
    broken = {
        "start": np.abs(q[0] - q_arm).max() > 0.01,
        "position": ((q < q_min) | (q > q_max)).any(),
        "velocity": ((dq > up * HARMLESS) | (-dq > down * HARMLESS)).any(),
        "acceleration": (np.abs(np.diff(dq, axis=0)) * 1e3 > ddq_max * HARMLESS).any(),
        "jerk": (np.abs(np.diff(dq, 2, axis=0)) * 1e6 > dddq_max * HARMLESS).any(),
    }
    return ", ".join(what for what, is_broken in broken.items() if is_broken)


def _together(q: Array, model: str, load: Mass) -> str:
    q = np.concatenate([[q[0]] * 3, q, [q[-1]] * 3])
    X = poses(q)[:, 8]
    at_m, R = X[:, :3, 3], X[:, :3, :3]
    turn = R[1:] @ np.swapaxes(R[:-1], 1, 2)
    angle = np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    m_s, m_s2, m_s3, rad_s, _, _ = MAKERS_FLANGE[model]
    torque = torques(q, load, published(model))
    sizes = {
        "travel": (np.linalg.norm(np.diff(at_m, axis=0), axis=1) * 1e3, m_s),
        "travel acceleration": (np.linalg.norm(np.diff(at_m, 2, axis=0), axis=1) * 1e6, m_s2),
        "travel jerk": (np.linalg.norm(np.diff(at_m, 3, axis=0), axis=1) * 1e9, m_s3),
        "turning": (angle * 1e3, rad_s),
        "torque": ((np.abs(torque) / MAKERS_NM).ravel(), 1.0),
        "torque rate": (np.abs(np.diff(torque, axis=0)).ravel() * 1e3, MOST_NM_S),
    }
    return ", ".join(name for name, (values, most) in sizes.items() if values.max() > most * DIFFERENCES)


def _places(q: Array, scene: Scene, touching: Touching | None) -> str:
    """Boxes, table and tip, four times as often as the samples; bodies as points along their axes."""
    rows = np.linspace(0, len(q) - 1, 4 * (len(q) - 1) + 1)
    fine = np.stack([np.interp(rows, np.arange(len(q)), joint) for joint in q.T], axis=1)
    X, share = poses(fine), np.linspace(0.0, 1.0, 9)[:, None]
    tip = (8, scene.tip_F_m, scene.tip_F_m, 0.0)
    for link, start, end, radius_m in (*CAPSULES, tip):
        points = np.array(start) + share * (np.array(end, dtype=np.float64) - np.array(start))
        at_m = np.einsum("nij,pj->npi", X[:, link, :3, :3], points) + X[:, None, link, :3, 3]
        for low, high in scene.boxes:
            gap_m = float(np.linalg.norm(at_m - np.clip(at_m, low, high), axis=-1).min()) - radius_m
            if gap_m < CLEAR_M - 1e-4:
                return f"{1e3 * gap_m:.2f} mm from a box"
        if link >= 2 and radius_m and float((at_m[..., 2] - radius_m).min()) < TABLE_M - 1e-4:
            return "table"
    depth_m = -(X[:, 8, 2, :3] @ scene.tip_F_m + X[:, 8, 2, 3])
    allowed_m = np.full(len(depth_m), TOUCH_M)
    if touching is not None:
        t_s = rows / 1e3
        inside = (t_s >= touching.start_s - 1e-3) & (t_s <= touching.end_s + 1e-3)
        allowed_m[inside] += min(max(touching.depth_m, 0.0), DEEPEST_M)
    over = float((depth_m - allowed_m).max())
    return f"tip {1e3 * over:.2f} mm too deep" if over > 1e-4 else ""
