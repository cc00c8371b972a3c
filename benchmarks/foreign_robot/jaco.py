"""A Kinova Jaco that pushes a bottle, as a robot of one's own: a program for `--answer-with`.

    adaptsim run-iteration --task pushing --hw own --answer-moves nothing --yes \\
        --answer-with "python benchmarks/foreign_robot/jaco.py"

The arm is DeepMind's model in dm_control (`pip install --no-deps dm_control`; only its files are read), the scene and
the controller are of this file: a plate on the wrist, a bottle of 0.25 kg, a table, and a rubber mat that no parameter
describes exactly. No part of adaptsim is imported, so that it stands for any robot: one question on stdin, one answer
on stdout. `--picture FILE` draws the scene in the middle of a push.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S, WATCHED_S, EVERY_S = 0.0005, 2.5, 0.02
BASE_M = np.array([0.08, 0.0, 0.0])  # the arm's foot in the task's frame
BOTTLE_M = np.array([0.56, 0.0])
RADIUS_M, HEIGHT_M, MASS_KG, BAND_M = 0.030, 0.12, 0.25, 0.028
MIDDLE_M = 0.035  # the height of the reported point
TABLE_FRICTION, MAT_FRICTION = 0.11, 0.45
MAT_X_M, MAT_Y_M = (0.80, 0.98), (-0.02, 0.16)
FEET = 12
PLATE_M = (0.005, 0.06, 0.03)  # half sizes: thickness, width, height
BELOW_WRIST_M, CLEARANCE_M = 0.17, 0.006
RAMP_S, HOLD_S, SLOW_S, RISE_M = 0.35, 0.10, 0.40, 0.03
GAP_M = 0.012
KNOWN_M, KNOWN_RAD, LED = np.array([0.408, -0.008, 0.006]), (0.22, 2.28, 5.38, 0.01, -0.04, -4.43), 40
STIFFNESS_1_S2, DAMPING_1_S = 2500.0, 100.0
TIPPED_COS = np.cos(np.deg2rad(30.0))


@dataclass(frozen=True)
class Push:
    """The view of the camera of this lab."""

    t_s: Array  # (N,) from the start of the motion
    xyz_m: Array  # (N, 3) the bottle's reported point
    outcome: str


def scene() -> Any:
    """The arm with its plate, the table and the bottle, as an MjSpec. Raises SystemExit without dm_control."""
    package = find_spec("dm_control")
    if package is None or package.origin is None:
        raise SystemExit("the arm's model is a file of dm_control: pip install --no-deps dm_control")
    spec = mujoco.MjSpec.from_file(str(Path(package.origin).parent / "third_party/kinova/jaco_arm.xml"))
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    spec.body("b_base").pos = BASE_M
    spec.visual.headlight.ambient = (0.5, 0.5, 0.5)
    spec.worldbody.add_light(pos=(0.3, -1.0, 2.5), dir=(0.2, 0.4, -1.0))
    world, untouched = spec.worldbody, {"contype": 0, "conaffinity": 0}
    world.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(2, 2, 0.1), rgba=(0.8, 0.75, 0.65, 1), **untouched
    )
    mat = [(low + high) / 2 for low, high in (MAT_X_M, MAT_Y_M)], [(high - low) / 2 for low, high in (MAT_X_M, MAT_Y_M)]
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, pos=(*mat[0], 0.0), size=(*mat[1], 0.0005), rgba=(0.2, 0.3, 0.5, 1), **untouched
    )
    bottle = world.add_body(name="bottle", pos=(*BOTTLE_M, 0.0))
    bottle.add_freejoint(name="free")
    inertia = MASS_KG * (3 * RADIUS_M**2 + HEIGHT_M**2) / 12
    bottle.explicitinertial, bottle.mass, bottle.ipos = True, MASS_KG, (0, 0, MIDDLE_M)
    bottle.inertia = (inertia, inertia, MASS_KG * RADIUS_M**2 / 2)
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    bottle.add_geom(
        name="wall",
        type=cylinder,
        pos=(0, 0, HEIGHT_M / 2),
        size=(RADIUS_M, HEIGHT_M / 2, 0),
        rgba=(0.2, 0.6, 0.4, 1),
        **untouched,
    )
    for i in range(FEET):
        angle = 2 * np.pi * i / FEET
        at = (BAND_M * np.cos(angle), BAND_M * np.sin(angle), 0.002)
        bottle.add_geom(name=f"foot{i}", type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=at, size=(0.002, 0, 0), **untouched)
        pair = spec.add_pair(geomname1="table", geomname2=f"foot{i}", condim=3)
        pair.friction, pair.solref = [TABLE_FRICTION] * 2 + [0, 0, 0], (0.004, 1.0)
    site = spec.site("wristsite")
    plate = spec.body("b_6").add_body(name="plate", pos=site.pos, quat=site.quat)
    below = (0.0, 0.0, BELOW_WRIST_M)
    plate.add_geom(
        name="plate",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=below,
        size=PLATE_M,
        mass=0.08,
        rgba=(0.8, 0.3, 0.2, 1),
        **untouched,
    )
    plate.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=(0, 0, 0.02, 0, 0, BELOW_WRIST_M),
        size=(0.01, 0, 0),
        mass=0.05,
        **untouched,
    )
    touch = spec.add_pair(geomname1="plate", geomname2="wall", condim=3)
    touch.friction, touch.solref = [0.4, 0.4, 0, 0, 0], (0.008, 0.7)
    return spec


@cache
def model() -> Any:
    """The compiled scene, made once per process."""
    return scene().compile()


def tool_path(yaw_rad: float, speed_m_s: float, t_s: Array) -> tuple[Array, Array]:
    """(N, 3) middle of the plate's lower edge, and its yaw: from rest behind the bottle, a push, then a rise."""
    hold_s = GAP_M / speed_m_s + HOLD_S
    u = np.clip(t_s / RAMP_S, 0, 1)
    v = np.clip((t_s - RAMP_S - hold_s) / SLOW_S, 0, 1)
    speed = speed_m_s * (_smooth(u) - _smooth(v))
    along = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t_s))])
    behind = RADIUS_M + PLATE_M[0] + GAP_M + speed_m_s * RAMP_S / 2
    forward = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    start = np.append(BOTTLE_M, CLEARANCE_M) - behind * forward
    return start + along[:, None] * forward + RISE_M * _smooth(v)[:, None] * [0, 0, 1], np.full(len(t_s), yaw_rad)


def _smooth(u: Array) -> Array:
    return u**3 * (10 - 15 * u + 6 * u**2)


def joints_along(at_m: Array, yaw_rad: Array) -> Array:
    """(N, 6) joints that carry the plate's lower edge along (N, 3), its face along the yaw. Raises SystemExit."""
    m, d = model(), mujoco.MjData(model())
    body, jac = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, "plate"), np.zeros((6, m.nv))
    q = np.array(KNOWN_RAD)
    share = np.linspace(0.0, 1.0, LED)[:, None]  # from a posture that is known, so that the elbow stays up
    at_m = np.concatenate([(1.0 - share) * KNOWN_M + share * at_m[0], at_m])
    yaw_rad = np.concatenate([share[:, 0] * yaw_rad[0], yaw_rad])
    path, tip = np.empty((len(at_m), 6)), np.array([0.0, 0.0, BELOW_WRIST_M + PLATE_M[2]])
    for i, (p, yaw) in enumerate(zip(at_m, yaw_rad, strict=True)):
        wanted = np.array([[np.cos(yaw), np.sin(yaw), 0], [np.sin(yaw), -np.cos(yaw), 0], [0, 0, -1.0]]).T
        for _ in range(400):
            d.qpos[:6] = q
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            R = d.xmat[body].reshape(3, 3)
            now = d.xpos[body] + R @ tip
            turn = sum(np.cross(R[:, k], wanted[:, k]) for k in range(3)) / 2
            error = np.concatenate([p - now, turn])
            if np.abs(error).max() < 1e-5:
                break
            mujoco.mj_jac(m, d, jac[:3], jac[3:], now, body)
            J = jac[:, :6]
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), np.clip(error, -0.1, 0.1))
        else:
            raise SystemExit(f"the arm does not reach {np.round(p, 3).tolist()} m")
        path[i] = q
    path, (low, high) = path[LED:], m.jnt_range[:6].T
    if (m.jnt_limited[:6].astype(bool) & ((path < low) | (path > high)).any(axis=0)).any():
        raise SystemExit("a joint would leave its range")
    return path


def push(yaw_rad: float, speed_m_s: float, friction: float = TABLE_FRICTION, picture: Path | None = None) -> Push:
    """One push of the bottle on a table of that friction, seen until it rests."""
    m, d = model(), mujoco.MjData(model())
    t_s: Array = np.arange(round(WATCHED_S / STEP_S) + 1, dtype=np.float64) * STEP_S
    coarse: Array = t_s[::20]
    knots = joints_along(*tool_path(yaw_rad, speed_m_s, coarse))
    q = np.stack([np.interp(t_s, coarse, column) for column in knots.T], axis=1)
    dq = np.gradient(q, STEP_S, axis=0)
    feet = [
        i for i in range(m.npair) if "foot" in (mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_GEOM, m.pair_geom2[i]) or "")
    ]
    bottle = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, "bottle")
    d.qpos[:6] = q[0]
    rows, every, torque = [], round(EVERY_S / STEP_S), np.zeros(m.nv)
    for i in range(len(t_s)):
        mujoco.mj_step1(m, d)
        for pair in feet:
            x, y = d.geom_xpos[m.pair_geom2[pair]][:2]
            on_mat = MAT_X_M[0] < x < MAT_X_M[1] and MAT_Y_M[0] < y < MAT_Y_M[1]
            m.pair_friction[pair][:2] = MAT_FRICTION if on_mat else friction
        wanted = STIFFNESS_1_S2 * (q[i] - d.qpos[:6]) + DAMPING_1_S * (dq[i] - d.qvel[:6])
        mujoco.mj_mulM(m, d, torque, np.append(wanted, np.zeros(m.nv - 6)))
        d.qfrc_applied[:6] = torque[:6] + d.qfrc_bias[:6] - d.qfrc_passive[:6]
        mujoco.mj_step2(m, d)
        if i % every == 0:
            R = d.xmat[bottle].reshape(3, 3)
            rows.append((t_s[i], *(d.xpos[bottle] + MIDDLE_M * R[:, 2]), R[2, 2]))
        if picture is not None and i == round((RAMP_S + 0.1) / STEP_S):
            _draw(m, d, picture)
    seen = np.array(rows)
    outcome = "tipped" if seen[:, 4].min() < TIPPED_COS else "upright"
    return Push(seen[:, 0], seen[:, 1:4], outcome)


def _draw(m: Any, d: Any, file: Path) -> None:
    import cv2  # noqa: PLC0415 - for pictures alone

    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.5, 0.0, 0.15), 1.5, 130.0, -25.0
    with mujoco.Renderer(m, 480, 640) as renderer:
        renderer.update_scene(d, camera)
        cv2.imwrite(str(file), renderer.render()[:, :, ::-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--friction", type=float, default=TABLE_FRICTION, help="of the table")
    parser.add_argument("--picture", type=Path, help="draw a push into this file instead of answering")
    given = parser.parse_args()
    if given.picture is not None:
        push(0.05, 0.6, given.friction, given.picture)
        return
    question = json.load(sys.stdin)
    done = push(question["action"]["yaw"], question["action"]["speed"], given.friction)
    answer = {
        "trial": question["trial"],
        "t_s": done.t_s.tolist(),
        "state": done.xyz_m.tolist(),
        "outcome": done.outcome,
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
