"""A pushing rig in memory: real task, tracker, planner and limits; an arm that plays at once and never misses; and the
lab's depth camera over a table on which a test puts bottles and hands."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from adaptsim_cli.config import Config
from adaptsim_cli.devices.trackers import tracker_of
from adaptsim_cli.session.on_rig import OnRig
from adaptsim_cli.session.target import Assessment, Parts, Planner, Provenance, Rig
from calib.types import HandEye
from hw.collision import KeepOut
from hw.fake import FakeArm, FakeBench, FakeClock
from hw.kinematics import forward
from hw.types import Array, CameraModel, Frame, JointPath
from hw.workcell import Workcell
from sim.adaptation.method import Best, Iteration, Particle
from sim.adaptation.verdict import Kind, Verdict
from sim.lab.kinect import default_X_BC, kinect_model
from sim.panda.planning import home, trial_paths
from sim.panda.tool import cell_as_shipped
from sim.render.bodies import Body
from sim.render.depth import DepthView
from sim.render.sensor import SensorNoise, sense_depth
from sim.tasks.pushing import HARDWARE, TASK
from sim.tasks.pushing.params import BOTTLE_HEIGHT_M, BOTTLE_RADIUS_M, START_M
from sim.tasks.pushing.scene import bottle_visual
from sim.tasks.shared.shapes import box, table_visual
from sim.tasks.task import SolvedPolicy
from sim.types import ToolMotion, Visual

FRAME_S = 0.1
REST_S = 0.4
"""How long a recording goes on after the motion."""

MARK = (float(START_M[0]), float(START_M[1]))
_HAND_M = np.array([0.08, 0.10, 0.06])


@dataclass(frozen=True)
class Scene:
    """What stands on the table: bottles upright at (x, y), a hand around (x, y, z)."""

    bottles: tuple[tuple[float, float], ...] = (MARK,)
    hand: tuple[float, float, float] | None = None


@dataclass(eq=False)
class BottleBench:
    """`before(trial, attempt)` is what the camera sees before a motion, `during` a hand while the arm moves."""

    before: Callable[[int, int], Scene] = lambda trial, attempt: Scene()
    during: tuple[float, float, float] | None = None
    keep_out: tuple[KeepOut, ...] = ()
    clock: FakeClock = field(default_factory=FakeClock)
    bench: FakeBench = field(default_factory=FakeBench)

    @cached_property
    def cell(self) -> Workcell:
        return replace(cell_as_shipped(HARDWARE, "panda"), keep_out=self.keep_out)

    @cached_property
    def arm(self) -> FakeArm:
        return FakeArm(home(HARDWARE.X_FT, self.cell), self.clock, self.cell)

    @property
    def pushes(self) -> int:
        """How many motions were made."""
        return len(self.arm.executed) // 3

    @contextmanager
    def open_parts(self, config: Config, learnt: Path, **_: object) -> Iterator[Parts]:
        """In the place of `wiring.open_parts`."""
        eye = HandEye(default_X_BC(), 1.0, 0.1, "known", "2026-01-01T00:00:00+00:00")
        with self.arm as arm, _Camera(self) as camera:
            rig = Rig("fake", "bench in memory", arm, camera, self.bench, eye, 10**6)
            origin = Provenance("none", "c" * 64, "w" * 64, "known", "h" * 64, {"adaptsim": "0"})
            target = OnRig(TASK, rig, tracker_of(TASK), self._planner())
            yield Parts(TASK, target, MiddleLearner(), origin)

    def _planner(self) -> Planner:
        def paths(motion: ToolMotion) -> tuple[JointPath, JointPath, JointPath]:
            return trial_paths(motion, HARDWARE.X_FT, self.cell, home(HARDWARE.X_FT, self.cell))

        return Planner(paths, self.cell.require, forward)

    def scene(self) -> Scene:
        """Before a motion."""
        placing = self.bench.placed[-1] if self.bench.placed else None
        return Scene() if placing is None else self.before(placing.trial, placing.attempt)


class MiddleLearner:
    """Always the middle of the action space; learns nothing."""

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        return tuple(Particle(row[None]) for row in TASK.parameters.sample(rng, n))

    def train(self, particle: Particle, history: Sequence[Iteration]) -> SolvedPolicy:
        return _Middle()

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        return tuple(seen.particle for seen in history[-1])

    def final(self, history: Sequence[Iteration]) -> SolvedPolicy:
        return _Middle()

    def posterior(self, history: Sequence[Iteration]) -> None:
        return None

    def judge(self, history: Sequence[Iteration]) -> Assessment:
        verdict = Verdict(kind=Kind.TOO_FEW, reward=0.5, ci95=(0.0, 1.0), trials=1, strange=0)
        return Assessment(Best(history[-1][0].particle, 0.5, (0.0, 1.0), 1), verdict, None)


class _Middle:
    def __call__(self, context: Array) -> Array:
        return TASK.action.middle

    def actions(self, contexts: Array) -> Array:
        return np.array([self(context) for context in contexts])

    def predict(self, context: Array) -> tuple[float, float, float]:
        return (0.5, 0.0, 1.0)


class _Camera:
    """Depth images of the scene, without the arm; the bottle goes before the plate while a recording runs."""

    def __init__(self, rig: BottleBench) -> None:
        self._rig, self._rng = rig, np.random.default_rng(0)
        self._noise, self._since_s = SensorNoise.draw(self._rng), 0.0
        model = kinect_model()
        self._dark = np.zeros((model.colour.height, model.colour.width, 3), np.uint8)
        self._bottle, self._hand = Body([bottle_visual("bottle")]), Body([_hand()])
        self._view = DepthView(model.depth, default_X_BC() @ model.X_CD, Body([table_visual()]))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...

    def model(self) -> CameraModel:
        return kinect_model()

    def snapshot(self) -> Frame:
        return self._frame(self._rig.clock.now_s(), self._rig.scene())

    def start_recording(self) -> None:
        self._since_s = self._rig.clock.now_s()

    def stop_recording(self) -> Sequence[Frame]:
        self._rig.clock.sleep(REST_S)
        times_s, path = np.arange(self._since_s, self._rig.clock.now_s(), FRAME_S), self._rig.arm.executed[-1]
        pushed_m = _pushed_m(path, times_s - self._since_s)
        return [
            self._frame(float(t_s), Scene(((xy_m[0], xy_m[1]),), self._rig.during))
            for t_s, xy_m in zip(times_s, pushed_m, strict=True)
        ]

    def _frame(self, t_s: float, scene: Scene) -> Frame:
        moving = [(self._bottle, _at(*xy, BOTTLE_HEIGHT_M / 2)) for xy in scene.bottles]
        if scene.hand is not None:
            moving.append((self._hand, _at(*scene.hand)))
        return Frame(t_s, self._dark, sense_depth(*self._view.render(moving), self._noise, self._rng))


def _pushed_m(path: JointPath, since_s: Array) -> Array:
    """(N, 2) of a bottle that the plate pushes ahead and leaves where it turns back."""
    X_BT = np.array([forward(q) @ HARDWARE.X_FT for q in path.q_rad[::10]])
    ahead = np.array([X_BT[0, 1, 1], -X_BT[0, 0, 1]])  # the plate's left, turned to the right
    gone_m = np.maximum.accumulate((X_BT[:, :2, 3] - START_M) @ ahead + BOTTLE_RADIUS_M)
    return np.asarray(START_M + np.interp(since_s, path.t_s[::10], np.maximum(gone_m, 0.0))[:, None] * ahead)


def _hand() -> Visual:
    return Visual("hand", *box(_HAND_M, np.zeros(3)), (0.55, 0.32, 0.22))


def _at(x_m: float, y_m: float, z_m: float) -> Array:
    X = np.eye(4)
    X[:3, 3] = x_m, y_m, z_m
    return X
