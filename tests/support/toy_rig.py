"""A whole bench in memory: a task of two parameters, an arm, a camera of 64 x 48 pixels, no training.

The camera looks straight down from one metre and sees the object as one bright pixel; an action travels through plan,
path and measured joints to the tracker, so a part that mixes something up changes the result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from adaptsim_cli.bench.rig import Paths, Planner, Rig, Tracker, TrackRequest
from adaptsim_cli.config import Config
from adaptsim_cli.session.control import ControlPolicies
from adaptsim_cli.session.rig_target import RigTarget
from adaptsim_cli.session.target import Provenance, SessionParts
from calib.types import HandEye
from hw.mass import NOTHING
from hw.types import ArmState, CameraModel, ContactWindow, Execution, Frame, Intrinsics, JointPath
from perception.errors import ObjectNotFound
from perception.types import ObjectTrack, Outcome
from sim.adaptation.adaptation import Assessment
from sim.adaptation.method import Best, Iteration, Particle
from sim.adaptation.verdict import Kind, Verdict
from sim.tasks.hardware import Hardware
from sim.tasks.task import AdaptationSettings, Observation, Task
from sim.types import Dimension, Space, ToolMotion

PARAMETERS = Space((Dimension("mu", "", 0.2, 0.4), Dimension("e", "Pa", 1e4, 1e6, "log")))
CONTEXT = Space((Dimension("x", "m", 0.66, 0.70), Dimension("y", "m", -0.015, 0.015)))
ACTION = Space((Dimension("pitch", "rad", 0.0, 1.0),))
TIMES_S = np.array([0.0, 0.1, 0.2])
HOME_RAD = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
OUTCOMES = (Outcome.ON_BLADE, Outcome.ON_TABLE, Outcome.LOST)
X_BC = np.array([[1.0, 0, 0, 0.68], [0, -1.0, 0, 0.0], [0, 0, -1.0, 1.0], [0, 0, 0, 1.0]])
_PINHOLE = Intrinsics(64, 48, np.array([[500.0, 0, 31.5], [0, 500.0, 23.5], [0, 0, 1.0]]))
MODEL = CameraModel("toy-camera", _PINHOLE, _PINHOLE, np.eye(4))


def plan(context: np.ndarray, action: np.ndarray) -> ToolMotion:
    t_s = np.linspace(0.0, 0.2, 201)
    X_BT = np.tile(np.eye(4), (201, 1, 1))
    X_BT[:, 0, 3] = action[0]
    return ToolMotion(t_s, X_BT, ContactWindow(0.05, 0.15, 0.001, 5.0))


def reward_of_success(end: np.ndarray, context: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 - np.abs(end[..., 0]))


def still(
    parameters: np.ndarray, context: np.ndarray, action: np.ndarray, nuisance: np.ndarray, unmodelled: Any = None
) -> ObjectTrack:
    """A piece that the tool misses."""
    state = np.tile([*context, 0.0], (2, 1))
    return ObjectTrack(np.array([0.0, 1.0]), state, Outcome.ON_TABLE, np.full(3, np.nan), np.ones(2))


HARDWARE = Hardware(
    X_FT=np.eye(4),
    tool_mass=NOTHING,
    keep_clear=(),
    plan=plan,
    build_scene=lambda *_: (_ for _ in ()).throw(AssertionError("no scene here")),
    time_step_s=lambda _: 0.001,
    rest_pose=lambda *_: np.eye(4),
    tracker="toy",
)

TASK = Task(
    name="toy",
    title="Toy",
    parameters=PARAMETERS,
    margin=PARAMETERS,
    context=CONTEXT,
    action=ACTION,
    nuisance=Space(()),
    action_noise=np.array([0.0]),
    observation=Observation(TIMES_S, (0, 1), np.array([0.5, -0.1]), np.array([0.9, 0.1]), np.zeros(2), np.zeros(2)),
    adaptation=AdaptationSettings(8, 0.15, 0.9, 0.5, 2, 1e-3),
    unmodelled=dict,
    simulate=still,
    reference_context=np.array([0.68, 0.0]),
    relocate=lambda observation, context: observation,
    succeeded=lambda track: track.outcome is Outcome.ON_BLADE,
    end_state=lambda track: track.end_in_tool_m[:1],
    reward_of_success=reward_of_success,
    object_name="toy piece",
    hardware=HARDWARE,
)


@dataclass
class ToyLab:
    """Arm, camera and bench; `hooks` run at named moments and may raise."""

    seed: int
    hooks: dict[str, Callable[[int, int], None]] = field(default_factory=dict)
    misplaced: frozenset[tuple[int, int]] = frozenset()  # (trial, attempt) put outside of the area
    model: str = "panda"
    executions: list[tuple[int, int]] = field(default_factory=list)  # of the middle path only
    _trial: tuple[int, int] = (0, 0)
    _xy_m: np.ndarray = field(default_factory=lambda: np.array([0.68, 0.0]))
    _clock_s: float = 10.0
    _recording: list[Frame] | None = None
    fault: str | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...

    def place(self, xy_m: np.ndarray, trial: int, attempt: int) -> None:
        rng = np.random.default_rng((self.seed, trial, attempt))
        self._trial, self._clock_s = (trial, attempt), 10.0
        self._xy_m = xy_m + rng.uniform(-0.002, 0.002, 2)
        if (trial, attempt) in self.misplaced:
            self._xy_m = np.array([0.63, 0.0])
        self._hook("place")

    def state(self) -> ArmState:
        return ArmState(self._clock_s, HOME_RAD, np.zeros(7), self.fault)

    def execute(self, path: JointPath) -> Execution:
        self._hook("execute")
        if self._recording is not None:
            self.executions.append(self._trial)
            for k in range(6):
                self._recording.append(self._frame(self._clock_s + path.duration_s * k / 5))
        start_s, self._clock_s = self._clock_s, self._clock_s + path.duration_s
        return Execution(start_s, path.t_s, path.q_rad, path.q_rad, 1.0)

    def recover(self) -> None:
        self.fault = None

    def snapshot(self) -> Frame:
        self._hook("snapshot")
        return self._frame(self._clock_s)

    def start_recording(self) -> None:
        self._recording = []

    def stop_recording(self) -> Sequence[Frame]:
        self._hook("stop_recording")
        frames, self._recording = self._recording or [], None
        return frames

    def _frame(self, t_s: float) -> Frame:
        colour = np.full((48, 64, 3), 40, np.uint8)
        u, v = round(31.5 + 500 * (self._xy_m[0] - 0.68)), round(23.5 - 500 * self._xy_m[1])
        colour[np.clip(v, 0, 47), np.clip(u, 0, 63)] = (255, 160, 30)
        return Frame(t_s, colour, np.full((48, 64), 1000, np.uint16))

    def _hook(self, name: str) -> None:
        if name in self.hooks:
            self.hooks[name](*self._trial)


@dataclass
class ToyCamera:
    """The camera's side of the lab: `model` is a method there."""

    lab: ToyLab

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...

    def model(self) -> CameraModel:
        return MODEL

    def snapshot(self) -> Frame:
        return self.lab.snapshot()

    def start_recording(self) -> None:
        self.lab.start_recording()

    def stop_recording(self) -> Sequence[Frame]:
        return self.lab.stop_recording()

    def newest(self) -> np.ndarray | None:
        return self.lab._frame(0.0).colour


@dataclass(frozen=True, eq=False)
class Found:
    xy_m: np.ndarray


def find(frame: Frame, model: CameraModel, X_BC: np.ndarray) -> Found:
    red = frame.colour[..., 0].astype(int)
    if red.max() < 200:
        raise ObjectNotFound("no bright pixel")
    v, u = np.unravel_index(int(red.argmax()), red.shape)
    return Found(np.array([0.68 + (u - 31.5) / 500, -(v - 23.5) / 500]))


def track(request: TrackRequest) -> ObjectTrack:
    pitch = float(request.X_BT_at(request.recording.execution.t_start_s + 0.1)[0, 3])
    start = request.detection.xy_m
    state = np.stack([start[0] + pitch * TIMES_S * 0.2, np.full(3, start[1]), np.full(3, 0.01)], axis=1)
    miss = abs(pitch - 0.6)
    outcome = Outcome.ON_BLADE if miss < 0.4 else Outcome.ON_TABLE
    end = np.array([miss, 0.0, 0.0]) if miss < 0.4 else np.full(3, np.nan)
    return ObjectTrack(TIMES_S, state, outcome, end, np.ones(3))


@dataclass(frozen=True)
class ToyPolicy:
    particle: Particle
    noise: float

    def __call__(self, context: np.ndarray) -> np.ndarray:
        unit = PARAMETERS.normalise(self.particle.mean)
        return np.asarray(np.clip([unit[0] + self.noise + (context[0] - 0.68)], 0.0, 1.0))

    def actions(self, contexts: np.ndarray) -> np.ndarray:
        return np.array([self(context) for context in contexts])

    def predict(self, context: np.ndarray) -> tuple[float, float, float]:
        return (0.9, 0.8, 1.0)


@dataclass
class ToyAdaptation:
    trained: list[tuple[float, ...]] = field(default_factory=list)

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        return tuple(Particle(row[None]) for row in PARAMETERS.sample(rng, n))

    def train(self, particle: Particle, history: Sequence[Iteration]) -> ToyPolicy:
        self.trained.append(tuple(particle.mean))
        return ToyPolicy(particle, 0.02 * float(np.sin(1e3 * particle.mean.sum())))

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        directions = rng.integers(-1, 2, (len(history[-1]), 2))
        return tuple(
            Particle(PARAMETERS.step(seen.particle.mean, step, 0.15)[None])
            for seen, step in zip(history[-1], directions, strict=True)
        )

    def final(self, history: Sequence[Iteration]) -> ToyPolicy:
        return self.train(history[-1][0].particle, history)

    def posterior(self, history: Sequence[Iteration]) -> None:
        return None

    def assess(self, history: Sequence[Iteration]) -> Assessment:
        trials = [(t.reward, seen.particle) for it in history for seen in it for t in seen.trials]
        reward, particle = max(trials, key=lambda pair: pair[0])
        best = Best(particle, reward, (max(0.0, reward - 0.2), min(1.0, reward + 0.2)), len(trials))
        verdict = Verdict(kind=Kind.CONVERGED, reward=reward, ci95=best.ci95, trials=len(trials), strange=0)
        return Assessment(best, verdict, None, (1 + [r for r, _ in trials].index(reward),))


def paths(motion: ToolMotion) -> Paths:
    pitch = motion.X_BT[0, 0, 3]
    target = np.tile(HOME_RAD, (len(motion.t_s), 1))
    target[:, 0] = pitch
    still = JointPath(np.linspace(0.0, 0.01, 11), np.tile(HOME_RAD, (11, 1)))
    return still, JointPath(motion.t_s, target, motion.contact), still


def flange(q_rad: np.ndarray) -> np.ndarray:
    X = np.eye(4)
    X[0, 3] = q_rad[0]
    return X


def toy_parts(
    lab: ToyLab,
    name: str = "fake",
    check: Callable[[JointPath], None] = lambda _: None,
    control: ControlPolicies | None = None,
    **origin: Any,
) -> SessionParts:
    """`origin` are fields of the provenance that differ."""
    provenance = replace(Provenance("toy", "c" * 64, "w" * 64, "toy", "h" * 64, {"adaptsim": "0.1.0"}), **origin)
    eye = HandEye(X_BC, 1.0, 0.1, "toy", "2024-01-01T00:00:00+00:00", provenance.camera_late_s)
    rig = Rig(name, "toy lab", lab, ToyCamera(lab), lab, eye)
    tracker = Tracker(
        find, lambda frame, *_: frame.colour, track, lambda drawn: drawn, lambda drawn, found: found.xy_m, OUTCOMES
    )
    target = RigTarget(TASK, rig, tracker, Planner(paths, check, flange))
    return SessionParts(TASK, target, ToyAdaptation(), provenance, control)  # type: ignore[arg-type]  # without a method


def opener(lab: ToyLab, **kinds: Any) -> Callable[[Config, Path], Any]:
    @contextmanager
    def open_parts(config: Config, learnt: Path, **_: object) -> Iterator[SessionParts]:
        with lab:
            yield toy_parts(lab, **kinds)

    return open_parts


def rig_target(parts: SessionParts) -> RigTarget:
    """The target of `parts`, which is one with an arm."""
    assert isinstance(parts.target, RigTarget)
    return parts.target
