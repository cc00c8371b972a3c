"""Offers hard paths to an arm, and has an independent judge look at all that reaches its driver, stops included."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from cells import cell
from hard_paths import LOADED, ROD, SCENE, paths
from own_judge import Array, Touching, wrong
from sink import Sink

from hw.braking import STOP_S
from hw.errors import MotionRefused
from hw.franka.arm import FrankaArm
from hw.franka.playback import PlayableMotion, Playback
from hw.franka.settings import FrankaSettings
from hw.types import ContactWindow, JointPath


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
    found, sink, rng = Found(), Sink(), np.random.default_rng([seed, 1])
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
