"""The postures to which a person guides the arm, with the board before the camera or the spatula set down; computed
with MuJoCo.
"""

from __future__ import annotations

import mujoco
import numpy as np
from world import (
    COLOUR,
    COLOUR_F,
    ENDS_M,
    HALF_WIDTH_M,
    Room,
    camera_pose,
    quaternion,
    table_height_m,
    table_rotation,
    turn,
)

LOW = np.array([-2.70, -1.70, -2.70, -2.95, -2.70, 0.60, -2.90])
HIGH = np.array([2.70, 1.70, 2.70, -0.25, 2.70, 4.40, 2.90])
START = np.array([0.0, -0.8, 0.0, -2.2, 0.0, 1.9, -0.785])
HALF_M = (0.130, 0.093)
HAND_M = 0.0003
"""How far a hand leaves both corners above the table, and each corner once more (standard deviations)."""


def guided(room: Room, count: int, seed: int = 5) -> list[list[float]]:
    """Up to `count` postures, each with the board whole in the picture, tilted, and clear of the table."""
    rng, found = np.random.default_rng(seed), list[np.ndarray]()
    X_BC, data = camera_pose(room.truth), mujoco.MjData(room.model)
    for _ in range(60 * count):
        if len(found) == count:
            break
        target = X_BC @ wanted(rng)
        q = reach(room, data, "board", target, rng)
        if q is not None and clear(room, data) and all(np.abs(q - other).max() > 0.05 for other in found):
            found.append(q)
    return [q.tolist() for q in found]


def wanted(rng: np.random.Generator) -> np.ndarray:
    """(4, 4) a board in the camera: X right on the print, Y up, Z out of it, towards the camera."""
    while True:
        z = rng.uniform(0.5, 1.0)
        u, v = rng.uniform(0.15, 0.85) * COLOUR[0], rng.uniform(0.18, 0.82) * COLOUR[1]
        tilt, about = np.deg2rad(rng.uniform(12.0, 38.0)), rng.uniform(0.0, 2.0 * np.pi)
        X = np.eye(4)
        lean = turn("z", about) @ turn("x", tilt) @ turn("z", -about)
        X[:3, :3] = lean @ turn("z", rng.uniform(-0.35, 0.35)) @ np.diag([1.0, -1.0, -1.0])
        X[:3, 3] = z * np.array([(u - COLOUR[0] / 2) / COLOUR_F, (v - COLOUR[1] / 2) / COLOUR_F, 1.0])
        corners = np.array([[sx * HALF_M[0], sy * HALF_M[1], 0.0] for sx in (-1, 1) for sy in (-1, 1)])
        seen = corners @ X[:3, :3].T + X[:3, 3]
        px = COLOUR_F * seen[:, :2] / seen[:, 2:] + np.array(COLOUR) / 2
        if (px > 15).all() and (px < np.array(COLOUR) - 15).all():
            return X


def set_down(
    room: Room, end: str, pitch_rad: float, xy_m: tuple[float, float], rng: np.random.Generator
) -> list[float]:
    """Joints with both corners of an end of the spatula on the table, as near as a hand comes. Raises ValueError."""
    data = mujoco.MjData(room.model)
    lifts_m = np.abs(HAND_M * rng.standard_normal(2)) + abs(HAND_M * rng.standard_normal())
    target = np.eye(4)
    leaning = np.arctan2(lifts_m[0] - lifts_m[1], 2.0 * HALF_WIDTH_M)
    target[:3, :3] = table_rotation(room.truth) @ turn("x", leaning) @ turn("y", pitch_rad)
    middle = np.array([*xy_m, table_height_m(room.truth, *xy_m) + lifts_m.mean()])
    target[:3, 3] = middle - target[:3, :3] @ np.array(ENDS_M[end])
    for _ in range(40):
        q = reach(room, data, "spatula", target, rng)
        if q is not None:
            return [float(value) for value in q]
    raise ValueError(f"no posture sets the {end} down at {xy_m} with a pitch of {np.degrees(pitch_rad):.0f} degrees")


def reach(
    room: Room, data: mujoco.MjData, name: str, target: np.ndarray, rng: np.random.Generator
) -> np.ndarray | None:
    """(7,) joints that bring the held thing there; None if none were found."""
    model = room.model
    at = [int(model.joint(f"robot0_fr3_joint{i}").qposadr[0]) for i in range(1, 8)]
    dof = [int(model.joint(f"robot0_fr3_joint{i}").dofadr[0]) for i in range(1, 8)]
    body = model.body(name).id
    q = START + rng.uniform(-0.4, 0.4, 7)
    jp, jr = np.zeros((3, model.nv)), np.zeros((3, model.nv))
    for _ in range(60):
        data.qpos[at] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        R, p = data.xmat[body].reshape(3, 3), data.xpos[body]
        turned = np.zeros(3)
        mujoco.mju_quat2Vel(turned, quaternion(target[:3, :3] @ R.T), 1.0)
        error = np.concatenate([target[:3, 3] - p, turned])
        if np.abs(error).max() < 1e-5:
            return q
        mujoco.mj_jacBody(model, data, jp, jr, body)
        J = np.vstack([jp, jr])[:, dof]
        q = np.clip(q + np.clip(J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), error), -0.3, 0.3), LOW, HIGH)
    return None


def clear(room: Room, data: mujoco.MjData) -> bool:
    """Whether the board is well over the table and the arm touches nothing."""
    body = data.body("board")
    corners = np.array([[sx * 0.15, sy * 0.107, 0.0] for sx in (-1, 1) for sy in (-1, 1)])
    lowest = (corners @ body.xmat.reshape(3, 3).T + body.xpos)[:, 2].min()
    mujoco.mj_forward(room.model, data)
    return bool(lowest > 0.04) and not touching(room.model, data)


def touching(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """Whether the arm touches itself or the table; what lies on the table does not count."""
    objects = {model.body(name).id for name in ("piece", "bottle")}
    bodies = (model.geom_bodyid[data.contact.geom]) if data.ncon else np.zeros((0, 2), int)
    return any(not objects & set(pair.tolist()) for pair in bodies)
