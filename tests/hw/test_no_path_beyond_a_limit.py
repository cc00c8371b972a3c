"""Random and adversarial paths against an arm that counts: none beyond a limit may reach its driver.

What is beyond a limit is judged by the maker's numbers as written here and by plain differences, not by `hw.limits`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from cells import cell
from sink import Sink

from hw.collision import ARM, BARE_HAND, HAND_MASS, KeepOut
from hw.dynamics import torque_Nm
from hw.errors import MotionRefused
from hw.franka.arm import FrankaArm
from hw.franka.settings import FrankaSettings
from hw.kinematics import FLANGE, forward, jacobian, link_poses
from hw.mass import Mass
from hw.types import Array, JointPath

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
FR3_SLOWER = ([0.6599, 0.2517, 0.2, 0.3533, 0.5757, 0.4878, 0.4628], [6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])
READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
HARMLESS = 1.0 + 1e-9
# m/s, m/s², m/s³, then the same of turning
MAKERS_FLANGE = {"panda": (1.7, 13.0, 6500.0, 2.5, 25.0, 12500.0), "fr3": (3.0, 9.0, 4500.0, 2.5, 17.0, 8500.0)}
MAKERS_NM = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]
TIP_F_M = np.array([0.0, 0.0, 0.2])
LOADED = replace(
    BARE_HAND, mass=HAND_MASS + Mass(1.5, np.array([0.0, 0.02, 0.12]), 0.002 * np.eye(3)), points_F_m=TIP_F_M[None]
)
LOW = np.array([0.0, 0.0, 0.0, -2.0, 0.0, 2.0, np.pi / 4])
ROD = KeepOut("a rod", np.array([0.479, 0.318, 0.15]), np.array([0.488, 0.327, 0.30]))
"""Thin and upright, beside where the other motions go; the tip passes it in an arc about the base."""
CLEAR_M, TABLE_M = 0.01, 0.002
"""What `hw.limits` promises to keep between two bodies."""


def beyond(q: Array, q_arm: Array, model: str) -> str:
    """What of the maker's limits the samples at 1 kHz (N, 7) break, begun at `q_arm` (7,) and ended at rest."""
    q_min, q_max, dq_max, ddq_max, dddq_max = (np.array(v) for v in MAKERS[model])
    at_rest = np.concatenate([[q[0]] * 3, q, [q[-1]] * 3])
    dq = np.diff(at_rest, axis=0) * 1e3
    up, down = dq_max, dq_max
    if model == "fr3":  # slower towards the ends of the range
        offset, braking = (np.array(v) for v in FR3_SLOWER)
        room = np.maximum(np.stack([q_max - at_rest[1:], at_rest[1:] - q_min]), 0.0)
        up, down = np.minimum(dq_max, np.maximum(np.sqrt(2.0 * braking * room) - offset, 0.0))
    broken = {
        "not finite": not np.isfinite(q).all(),
        "start": np.abs(q[0] - q_arm).max() > 0.01,
        "position": ((q < q_min) | (q > q_max)).any(),
        "velocity": ((dq > up * HARMLESS) | (-dq > down * HARMLESS)).any(),
        "acceleration": (np.abs(np.diff(dq, axis=0)) * 1e3 > ddq_max * HARMLESS).any(),
        "jerk": (np.abs(np.diff(dq, 2, axis=0)) * 1e6 > dddq_max * HARMLESS).any(),
    }
    return ", ".join(what for what, is_broken in broken.items() if is_broken)


def beyond_together(q: Array, model: str) -> str:
    """The same for all joints together: torques of the loaded arm, and the flange by differences of its positions."""
    q = np.concatenate([[q[0]] * 3, q, [q[-1]] * 3])
    dq = np.gradient(q, 1e-3, axis=0)
    torque = torque_Nm(q[2:-1], np.diff(q, axis=0)[1:-1] * 1e3, np.diff(q, 2, axis=0)[1:] * 1e6, LOADED.mass)
    at_m = forward(q)[:, :3, 3]
    m_s, m_s2, m_s3, rad_s, _, _ = MAKERS_FLANGE[model]
    turning = np.einsum("nij,nj->ni", jacobian(q)[:, 3:], dq)
    sizes = {
        "travel": (np.linalg.norm(np.diff(at_m, axis=0), axis=1) * 1e3, m_s),
        "travel acceleration": (np.linalg.norm(np.diff(at_m, 2, axis=0), axis=1) * 1e6, m_s2),
        "travel jerk": (np.linalg.norm(np.diff(at_m, 3, axis=0), axis=1) * 1e9, m_s3),
        "turning": (np.linalg.norm(turning, axis=1), rad_s),
        "torque": (np.abs(torque) / MAKERS_NM, 1.0),
        "torque rate": (np.abs(np.diff(torque, axis=0)) * 1e3, 1000.0),
    }
    return ", ".join(name for name, (values, most) in sizes.items() if values.max() > most * 1.02)


def too_close(q: Array) -> str:
    """Whether tool or arm come closer to rod or table than promised, four times as often as the samples.

    Bodies as points along their axes, without any of `hw.limits` or of the distances of `hw.collision`.
    """
    rows = np.linspace(0, len(q) - 1, 4 * (len(q) - 1) + 1)
    fine = np.stack([np.interp(rows, np.arange(len(q)), joint) for joint in q.T], axis=1)
    poses, share = link_poses(fine), np.linspace(0.0, 1.0, 9)[:, None]
    bodies = [(c.link, c.start_m + share * (c.end_m - c.start_m), c.radius_m) for c in (*ARM, *LOADED.capsules)]
    for link, points_m, radius_m in (*bodies, (FLANGE, TIP_F_M[None], 0.0)):
        at_m = poses[:, None, link, :3, :3] @ points_m[..., None]
        at_m = at_m[..., 0] + poses[:, None, link, :3, 3]
        gap_m = np.linalg.norm(at_m - np.clip(at_m, ROD.low_m, ROD.high_m), axis=-1) - radius_m
        if link >= 1 and gap_m.min() < CLEAR_M - 1e-4:
            return f"{1e3 * gap_m.min():.2f} mm from the rod"
        if link >= 2 and radius_m and (at_m[..., 2] - radius_m).min() < TABLE_M - 1e-4:
            return "table"
    return ""


def past_the_rod(rng: np.random.Generator, model: str) -> tuple[Array, Array]:
    """Samples (N, 7) and their beginning: the tip sweeps past the rod, at any distance from a hit to far enough."""
    q_mid = LOW + np.concatenate([[0.0], rng.uniform(-0.02, 0.02, 6)])
    nearest = ROD.low_m[:2]  # the corner towards the base
    wanted_m = np.linalg.norm(nearest) - rng.uniform(-0.002, 0.03)
    reaches = LOW[3] + np.linspace(-0.3, 0.3, 121)  # the elbow opens until the tip is as far out as wanted
    bent = np.repeat(q_mid[None], len(reaches), axis=0)
    bent[:, 3] = reaches
    tip_m = (forward(bent) @ np.append(TIP_F_M, 1.0))[:, :2]
    q_mid[3] = np.interp(wanted_m, np.linalg.norm(tip_m, axis=1), reaches)
    tip_m = (forward(q_mid) @ np.append(TIP_F_M, 1.0))[:2]
    q_mid[0] = np.arctan2(nearest[1], nearest[0]) - np.arctan2(tip_m[1], tip_m[0]) + rng.uniform(-0.03, 0.03)
    samples, ddq_max = int(rng.integers(300, 900)), MAKERS[model][3]
    travel = rng.uniform(-0.01, 0.01, 7)
    travel[0] = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.9) * ddq_max[0] * (samples / 1e3) ** 2 / 7.52
    travel[0] = np.clip(travel[0], -0.9e-3 * samples, 0.9e-3 * samples)  # its velocity peaks at 2.19 times the mean
    start = q_mid - 0.5 * travel
    return start + smooth(samples) * travel, start


def smooth(samples: int) -> Array:
    u = np.linspace(0.0, 1.0, samples)[:, None]
    return u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)


def paths(rng: np.random.Generator, model: str) -> Iterator[tuple[str, Array, Array]]:
    """(kind, samples (N, 7), where the arm is (7,)), without end: a fair motion, then what spoils it."""
    q_min, q_max, _, ddq_max, _ = (np.array(v) for v in MAKERS[model])
    while True:
        start = READY + rng.uniform(-0.3, 0.3, 7)
        samples = int(rng.integers(60, 260))
        most = ddq_max * (samples / 1e3) ** 2 / 7.52  # peak acceleration of `smooth` is 7.513 of its travel per time²
        travel = rng.uniform(-1.0, 1.0, 7) * np.minimum(0.4 * most, 0.1)
        fair = start + smooth(samples) * travel
        row, joint, tiny = int(rng.integers(samples)), int(rng.integers(7)), 10.0 ** rng.uniform(-9.0, -2.0)
        yield "fair", fair, start
        alone = np.eye(7)[joint] * np.sign(travel) * most * rng.uniform(0.95, 1.05)
        yield "near the limit", start + smooth(samples) * alone, start
        yield "all near the limit", start + smooth(samples) * np.sign(travel) * most * rng.uniform(0.2, 1.05), start
        yield "fast", start + smooth(samples) * travel * rng.uniform(1.0, 20.0), start
        yield "from elsewhere", fair, start + tiny * np.eye(7)[joint] * 10.0
        yield "cut short", fair[: max(2, row)], start
        yield "begun late", fair[min(row, samples - 2) :], fair[min(row, samples - 2)]
        yield "spike", fair + tiny * np.eye(samples)[row][:, None] * np.eye(7)[joint], start
        yield "step", fair + tiny * (np.arange(samples) >= max(row, 1))[:, None] * np.eye(7)[joint], start
        shaking = np.sin(np.arange(samples) * rng.uniform(0.1, np.pi))[:, None] * np.sin(np.pi * smooth(samples)) ** 4
        yield "shaking", fair + tiny * shaking * rng.uniform(-1.0, 1.0, 7), start
        yield "held sample", np.insert(fair, row, fair[row], axis=0), start
        yield "lost sample", np.delete(fair, row, axis=0), start
        yield "backwards in the middle", np.concatenate([fair[: row + 1], fair[row::-1]]), start
        edge = (q_min, q_max)[int(rng.integers(2))][joint]
        over = start + (edge * rng.uniform(0.98, 1.02) - start[joint]) * np.eye(7)[joint]
        yield "position", np.repeat(over[None], samples, axis=0), over
        bad = fair.copy()
        bad[row, joint] = rng.choice([np.nan, np.inf, -np.inf, 1e9])
        yield "not a number", bad, start
        yield "past the rod", *past_the_rod(rng, model)


def hunt(model: str, count: int, seed: int) -> tuple[Counter[str], Counter[str]]:
    """Offer `count` paths to an arm of `model`: how many of each kind reached its driver, how many were refused."""
    reached: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    sink = Sink()
    with FrankaArm(cell(model, LOADED, keep_out=(ROD,)), FrankaSettings("172.16.0.2"), lambda: sink) as arm:
        for _, (kind, q, q_arm) in zip(range(count), paths(np.random.default_rng(seed), model), strict=False):
            sink.q_rad = q_arm
            before = len(sink.given)
            try:
                arm.execute(JointPath(np.arange(len(q)) / 1e3, q))
            except (MotionRefused, ValueError):
                refused[kind] += 1
                assert len(sink.given) == before, f"{kind} was refused and played"
                continue
            given = sink.given.pop().path.q_rad
            broken = beyond(given, q_arm, model) or beyond_together(given, model) or too_close(given)
            assert not broken, f"a path beyond the {model}'s limits reached the driver: {kind}, {broken}"
            reached[kind] += 1
    return reached, refused


def check(model: str, count: int, seed: int) -> None:
    reached, refused = hunt(model, count, seed)
    assert reached.total() + refused.total() == count
    assert reached["fair"] > 0.5 * (reached["fair"] + refused["fair"]), "an arm that refuses everything proves nothing"
    assert reached["near the limit"] > 0
    assert reached["spike"] > 0  # a nanoradian is nothing
    assert reached["past the rod"] > 0
    for kind in (
        "near the limit",
        "all near the limit",
        "fast",
        "from elsewhere",
        "cut short",
        "begun late",
        "spike",
        "step",
        "shaking",
        "past the rod",
    ):
        assert refused[kind] > 0, kind
    assert reached["not a number"] == 0


@pytest.mark.long
@pytest.mark.parametrize("model", ["panda", "fr3"])
def test_none_of_1000_paths_beyond_a_limit_reaches_the_driver(model: str) -> None:
    check(model, 1000, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["panda", "fr3"])
@pytest.mark.timeout(3600)
def test_none_of_5000_paths_beyond_a_limit_reaches_the_driver(model: str) -> None:
    check(model, 5000, seed=2)
