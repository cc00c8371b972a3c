"""Paths that an arm should mostly not play: fair motions, and what spoils them. Seeded, without end.

`hunt` offers them to an arm and has an independent judge look at all that reaches its driver, stops included.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
from cells import READY, cell, smooth
from own_judge import MAKERS, Array, Scene, Touching, poses, wrong
from players import InstantPlayer

from hw.braking import STOP_S
from hw.collision import BARE_HAND, HAND_MASS, KeepOut
from hw.errors import MotionRefused
from hw.franka.arm import FrankaArm
from hw.franka.playback import PlayableMotion, Playback
from hw.franka.settings import FrankaSettings
from hw.mass import Mass
from hw.types import ContactWindow, JointPath

TIP_F_M = np.array([0.0, 0.0, 0.2])
LOADED = replace(
    BARE_HAND, mass=HAND_MASS + Mass(1.5, np.array([0.0, 0.02, 0.12]), 0.002 * np.eye(3)), points_F_m=TIP_F_M[None]
)
LOW = np.array([0.0, 0.0, 0.0, -2.0, 0.0, 2.0, np.pi / 4])
ROD = KeepOut("a rod", np.array([0.479, 0.318, 0.15]), np.array([0.488, 0.327, 0.30]))
"""Thin and upright, beside where the other motions go; the tip passes it in an arc about the base."""
SCENE = Scene(LOADED.mass, TIP_F_M, ((ROD.low_m, ROD.high_m),))


@dataclass(frozen=True)
class Offered:
    """One path as offered to an arm."""

    kind: str
    q_rad: Array  # (N, 7)
    q_arm_rad: Array  # (7,) where the arm is
    window: tuple[float, float, float, float] | None = None  # start, end in s, depth in m, force in N


def shares(samples: int) -> Array:
    """(samples, 1) from 0 to 1, at rest at both ends."""
    return smooth(np.linspace(0.0, 1.0, samples)[:, None])


def tip_m(q_rad: Array) -> Array:
    """(N, 7) -> (N, 3) the tip."""
    X = poses(q_rad)[:, 8]
    return np.asarray(X[:, :3, :3] @ TIP_F_M + X[:, :3, 3])


def past_the_rod(rng: np.random.Generator, model: str) -> tuple[Array, Array]:
    """Samples (N, 7) and their beginning: the tip sweeps past the rod, at any distance from a hit to far enough."""
    q_mid = LOW + np.concatenate([[0.0], rng.uniform(-0.02, 0.02, 6)])
    nearest = ROD.low_m[:2]  # the corner towards the base
    wanted_m = np.linalg.norm(nearest) - rng.uniform(-0.002, 0.03)
    reaches = LOW[3] + np.linspace(-0.3, 0.3, 121)  # the elbow opens until the tip is as far out as wanted
    bent = np.repeat(q_mid[None], len(reaches), axis=0)
    bent[:, 3] = reaches
    q_mid[3] = np.interp(wanted_m, np.linalg.norm(tip_m(bent)[:, :2], axis=1), reaches)
    at_m = tip_m(q_mid[None])[0, :2]
    q_mid[0] = np.arctan2(nearest[1], nearest[0]) - np.arctan2(at_m[1], at_m[0]) + rng.uniform(-0.03, 0.03)
    samples, ddq_max = int(rng.integers(300, 900)), MAKERS[model][3]
    travel = rng.uniform(-0.01, 0.01, 7)
    travel[0] = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.9) * ddq_max[0] * (samples / 1e3) ** 2 / 7.52
    travel[0] = np.clip(travel[0], -0.9e-3 * samples, 0.9e-3 * samples)  # its velocity peaks at 2.19 times the mean
    start = q_mid - 0.5 * travel
    return start + shares(samples) * travel, start


def into_the_table(rng: np.random.Generator) -> Offered:
    """The tip goes down to the table or into it, with a window that may say anything."""
    start = LOW + np.concatenate([rng.uniform(-0.4, 0.4, 1), rng.uniform(-0.03, 0.03, 6)])
    tilts = start[1] + np.linspace(0.0, 0.6, 241)
    bent = np.repeat(start[None], len(tilts), axis=0)
    bent[:, 1] = tilts
    heights_m = tip_m(bent)[:, 2]
    begin, end = (float(np.interp(-h, -heights_m, tilts)) for h in (0.02, -rng.uniform(-0.003, 0.015)))
    start[1] = begin
    samples = int(rng.integers(400, 900))
    q = start + np.concatenate([shares(samples), np.ones((50, 1))]) * (end - begin) * (np.arange(7) == 1)
    from_s, to_s = np.sort(rng.uniform(-0.1, len(q) / 1e3 + 0.1, 2))
    depth_m = float(rng.choice([rng.uniform(0.0, 0.012), -1.0, -1e-6, np.nan, np.inf]))
    force_N = float(rng.uniform(-5.0, 90.0))
    if rng.random() < 0.5:  # an honest one
        from_s, to_s, depth_m, force_N = 0.0, len(q) / 1e3, rng.uniform(0.0, 0.006), rng.uniform(1.0, 30.0)
    return Offered("into the table", q, start, (float(from_s), float(to_s), float(depth_m), float(force_N)))


def paths(rng: np.random.Generator, model: str) -> Iterator[Offered]:
    """A fair motion, then what spoils it."""
    q_min, q_max, _, ddq_max, _ = (np.array(v) for v in MAKERS[model])
    while True:
        start = READY + rng.uniform(-0.3, 0.3, 7)
        samples = int(rng.integers(60, 260))
        most = ddq_max * (samples / 1e3) ** 2 / 7.52  # peak acceleration of `smooth` is 7.513 of its travel per time²
        travel = rng.uniform(-1.0, 1.0, 7) * np.minimum(0.4 * most, 0.1)
        fair = start + shares(samples) * travel
        row, joint, tiny = int(rng.integers(samples)), int(rng.integers(7)), 10.0 ** rng.uniform(-9.0, -2.0)
        yield Offered("fair", fair, start)
        alone = np.eye(7)[joint] * np.sign(travel) * most * rng.uniform(0.95, 1.05)
        yield Offered("near the limit", start + shares(samples) * alone, start)
        together = np.sign(travel) * most * rng.uniform(0.2, 1.05)
        yield Offered("all near the limit", start + shares(samples) * together, start)
        yield Offered("fast", start + shares(samples) * travel * rng.uniform(1.0, 20.0), start)
        yield Offered("from elsewhere", fair, start + tiny * np.eye(7)[joint] * 10.0)
        yield Offered("cut short", fair[: max(2, row)], start)
        late = min(row, samples - 2)
        yield Offered("begun late", fair[late:], fair[late])
        yield Offered("spike", fair + tiny * np.eye(samples)[row][:, None] * np.eye(7)[joint], start)
        yield Offered("step", fair + tiny * (np.arange(samples) >= max(row, 1))[:, None] * np.eye(7)[joint], start)
        shaking = np.sin(np.arange(samples) * rng.uniform(0.1, np.pi))[:, None] * np.sin(np.pi * shares(samples)) ** 4
        yield Offered("shaking", fair + tiny * shaking * rng.uniform(-1.0, 1.0, 7), start)
        yield Offered("held sample", np.insert(fair, row, fair[row], axis=0), start)
        yield Offered("lost sample", np.delete(fair, row, axis=0), start)
        yield Offered("backwards in the middle", np.concatenate([fair[: row + 1], fair[row::-1]]), start)
        edge = (q_min, q_max)[int(rng.integers(2))][joint]
        over = start + (edge * rng.uniform(0.98, 1.02) - start[joint]) * np.eye(7)[joint]
        yield Offered("position", np.repeat(over[None], samples, axis=0), over)
        bad = fair.copy()
        bad[row, joint] = rng.choice([np.nan, np.inf, -np.inf, 1e9])
        yield Offered("not a number", bad, start)
        yield Offered("past the rod", *past_the_rod(rng, model))
        yield into_the_table(rng)


@dataclass
class Found:
    """What became of the paths, by kind, and what was wrong."""

    reached: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    stops: int = 0
    longest_stop_s: float = 0.0
    wrong: list[str] = field(default_factory=list)


def hunt(model: str, count: int, seed: int) -> Found:
    """Offer `count` paths to an arm of `model`; every one that it accepts is also stopped at a random moment."""
    found, sink, rng = Found(), InstantPlayer(), np.random.default_rng([seed, 1])
    with FrankaArm(cell(model, LOADED, keep_out=(ROD,)), FrankaSettings("172.16.0.2"), lambda: sink) as arm:
        for _, one in zip(range(count), paths(np.random.default_rng(seed), model), strict=False):
            sink.q_rad = one.q_arm_rad
            before = len(sink.given)
            try:
                window = None if one.window is None else ContactWindow(*one.window)
                arm.execute(JointPath(np.arange(len(one.q_rad)) / 1e3, one.q_rad, window))
            except (MotionRefused, ValueError):
                found.refused[one.kind] += 1
                if len(sink.given) != before:
                    found.wrong.append(f"{one.kind} was refused and played")
                continue
            found.reached[one.kind] += 1
            motion = sink.given.pop()
            touching = None if one.window is None else Touching(*one.window[:3])
            whole = wrong(motion.path.q_rad, one.q_arm_rad, model, SCENE, touching)
            stopped, stop_s = commanded(motion, int(rng.integers(len(motion.path.t_s))))
            stretched = None if touching is None else Touching(touching.start_s, np.inf, touching.depth_m)
            braked = wrong(stopped, one.q_arm_rad, model, SCENE, stretched)
            found.stops += 1
            found.longest_stop_s = max(found.longest_stop_s, stop_s)
            late = f"a stop took {stop_s:.3f} s" if stop_s > STOP_S else ""
            found.wrong += [
                f"{model}, {one.kind}: {text}" for text in (whole, braked and f"stop: {braked}", late) if text
            ]
    return found


def commanded(motion: PlayableMotion, stop_at: int) -> tuple[Array, float]:
    """What the player commands of a motion that is to stop at a sample, (M, 7), and the time that the stop takes."""
    tick = 0
    playback = Playback(motion, lambda: "request" if tick >= stop_at else "", lambda: 0.0)
    q = motion.path.q_rad[0].tolist()
    state = SimpleNamespace(q=q, q_d=q, dq=[0.0] * 7, control_command_success_rate=1.0)
    rows, finished = list[Array](), False
    while not finished:
        q, finished = playback.step(state, 0.001 if rows else 0.0)
        tick += 1
        rows.append(np.asarray(q))
    done = np.array(rows)
    moving = np.flatnonzero(np.abs(np.diff(done, axis=0)).max(axis=1) > 0.0)
    last = int(moving[-1]) + 1 if len(moving) else 0
    return done, max(last - stop_at, 0) / 1e3
