"""The bottle: pushes by the whole arm, and the same pushes with a hand in the picture.

Only depth images are rendered, which is all that the tracker reads, from the measured joints and the true motion of the
bottle, with a new sensor for each push.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from adaptsim_cli.bench.devices.trackers import BOTTLE_AREA, tracker_of
from adaptsim_cli.bench.rig import Recording, Tracker, TrackRequest
from hw.kinematics import FLANGE, forward, link_poses
from hw.poses import pose
from hw.types import Array, CameraModel, Execution, Frame, JointPath
from hw.workcell import Workcell
from perception.errors import PerceptionError
from perception.types import Outcome
from sim.errors import NotExecutable
from sim.lab.calibrating import with_extrinsic_error
from sim.lab.kinect import default_X_BC, kinect_model
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Sensing, load_world
from sim.panda.model import HAND_NAME
from sim.panda.planning import home, trial_paths
from sim.panda.shapes import visuals
from sim.panda.tool import cell_as_shipped
from sim.render.bodies import Body
from sim.render.depth import DepthView
from sim.render.sensor import SensorNoise, sense_depth
from sim.tasks.pushing import HARDWARE, TASK
from sim.tasks.pushing.mount import pusher_visuals
from sim.tasks.pushing.params import START_M
from sim.tasks.pushing.scene import bottle_visual
from sim.tasks.shared.readings import READ_EVERY_S
from sim.tasks.shared.shapes import box, table_visual
from sim.tasks.task import Task
from sim.types import Visual

WORLDS = ("wd", "ood-2")
SENSING = Sensing(extrinsic_error_mm=2.0, extrinsic_error_deg=0.2)
FRAME_S = 1 / 30
TRIES = 20
TIPPED_DEG = 30.0
REPEATS = 3
HAND_M = np.array([0.08, 0.10, 0.06])
GONE = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, -3.0], [0, 0, 0, 1.0]])


@dataclass(frozen=True, eq=False)
class Push:
    """The true course of one push, on the arm's clock."""

    execution: Execution
    t_s: Array  # (N,)
    X_BO: Array  # (N, 4, 4) the bottle

    @property
    def end_s(self) -> float:
        return float(self.t_s[-1])

    def bottle(self, t_s: float) -> Array:
        t_s = float(np.clip(t_s, self.t_s[0], self.t_s[-1]))
        R = Slerp(self.t_s, Rotation.from_matrix(self.X_BO[:, :3, :3]))(t_s).as_matrix()
        return pose(R, [np.interp(t_s, self.t_s, column) for column in self.X_BO[:, :3, 3].T])

    @cached_property
    def fell_s(self) -> float:
        """The time at which training would count it as fallen: its first reading past `TIPPED_DEG`; else inf."""
        start_s = self.execution.t_start_s
        for t_s in np.arange(start_s, self.end_s, READ_EVERY_S):
            if lean_deg(self.bottle(float(t_s))) > TIPPED_DEG:
                return float(t_s)
        return float("inf")

    def counted_m(self, t_s: float) -> Array:
        """(2,) of the bottle as training counts it: after a fall, where it fell."""
        return self.bottle(min(t_s, self.fell_s))[:2, 3]

    def tool(self, t_s: float) -> Array:
        return np.asarray(forward(self.execution.q_at(t_s)) @ HARDWARE.X_FT)


def lean_deg(X_BO: Array) -> float:
    return float(np.rad2deg(np.arccos(np.clip(X_BO[2, 2], -1, 1))))


def run(count: int, seed: int) -> None:
    tracker, cameras = tracker_of(TASK), np.random.default_rng(seed + 1)
    eye = DepthEye(kinect_model())
    rows: dict[str, list[Result | None]] = {"camera pose exact": [], "camera off by 2 mm, 0.2°": [], "with a hand": []}
    for number, push in enumerate(pushes(count, seed), start=1):
        noise = SensorNoise.draw(cameras)
        film = eye.film(push, noise, cameras, lambda _: GONE)
        off = with_extrinsic_error(default_X_BC(), SENSING, cameras)
        rows["camera pose exact"].append(judged(tracker, eye.model, default_X_BC(), push, film, REPEATS))
        rows["camera off by 2 mm, 0.2°"].append(judged(tracker, eye.model, off, push, film, 1))
        handy = eye.film(push, noise, cameras, hand(push, cameras))
        rows["with a hand"].append(judged(tracker, eye.model, default_X_BC(), push, (film[0], *handy[1:]), 1))
        if number % 5 == 0 or number == count:
            print(f"after {number} pushes")
            shown(rows)


def pushes(count: int, seed: int) -> Iterator[Push]:
    """Random executable actions, in turn in each world."""
    rng, cell = np.random.default_rng(seed), cell_as_shipped(HARDWARE, "panda")
    q_home = home(HARDWARE.X_FT, cell)
    for i, name in enumerate(WORLDS):
        wanted = count // len(WORLDS) + (i < count % len(WORLDS))
        with SimulatedLab(TASK, load_world(name, TASK), seed, cell, home_q_rad=q_home) as lab:
            yield from islice(pushed(lab, cell, rng, TRIES * wanted), wanted)


def pushed(lab: SimulatedLab, cell: Workcell, rng: np.random.Generator, tries: int) -> Iterator[Push]:
    """A push of the bottle at its mark by every executable action out of this many random ones."""
    for trial, _, approach, path in executable(TASK, cell, rng, tries):
        lab.bench.place(START_M, trial, 0)
        lab.arm.execute(approach)
        execution = lab.arm.execute(path)
        truth = lab.truth()["trials"][-1]["motions"][-1]
        yield Push(execution, np.array(truth["t_s"]) + truth["t_start_s"], np.array(truth["X_BO"]))


def executable(
    task: Task, cell: Workcell, rng: np.random.Generator, tries: int
) -> Iterator[tuple[int, Array, JointPath, JointPath]]:
    """(number from 1, context, approach, path) of those random actions of a task that an arm in `cell` can execute."""
    hardware = task.require_hardware()
    q_home = home(hardware.X_FT, cell)
    for trial in range(1, 1 + tries):
        context, action = task.context.sample(rng, 1)[0], task.action.sample(rng, 1)[0]
        try:
            approach, path, _ = trial_paths(hardware.plan(context, action), hardware.X_FT, cell, q_home)
        except NotExecutable:
            continue
        yield trial, context, approach, path


class DepthEye:
    """The lab's depth camera before table, arm, pusher, bottle and hand."""

    def __init__(self, model: CameraModel) -> None:
        self.model = model
        arm = visuals()
        self._links = {name: Body([v for v in arm if v.body == name]) for name in {v.body for v in arm}}
        self._tool, self._bottle = Body(pusher_visuals("tool")), Body([bottle_visual("bottle")])
        self._hand = Body([Visual("hand", *box(HAND_M, np.zeros(3)), (0.55, 0.32, 0.22))])
        self._view = DepthView(model.depth, default_X_BC() @ model.X_CD, Body([table_visual()]))
        self._colour = np.zeros((model.colour.height, model.colour.width, 3), np.uint8)

    def film(
        self, push: Push, noise: SensorNoise, rng: np.random.Generator, hand_at: Callable[[float], Array]
    ) -> tuple[Frame, ...]:
        """A picture before the approach, with the arm out of it, then all frames of the motion until rest."""
        start_s = push.execution.t_start_s
        times = np.arange(start_s + rng.uniform(0, FRAME_S), push.end_s, FRAME_S)
        before = Frame(start_s - 1.0, self._colour, self._shot([(self._bottle, push.bottle(start_s))], noise, rng))
        frames = []
        for t_s in times:
            poses = link_poses(push.execution.q_at(t_s))
            moving = [(body, _link(poses, name)) for name, body in self._links.items() if name != "world"]
            moving += [(self._tool, push.tool(t_s)), (self._bottle, push.bottle(t_s)), (self._hand, hand_at(t_s))]
            frames.append(Frame(float(t_s), self._colour, self._shot(moving, noise, rng)))
        return before, *frames

    def _shot(
        self, moving: list[tuple[Body, Array]], noise: SensorNoise, rng: np.random.Generator
    ) -> NDArray[np.uint16]:
        return sense_depth(*self._view.render(moving), noise, rng)


def _link(poses: Array, name: str) -> Array:
    if name != HAND_NAME:
        return np.asarray(poses[int(name.removeprefix("panda_link"))])
    turned = np.eye(4)
    turned[:3, :3] = Rotation.from_rotvec([0, 0, -np.pi / 4]).as_matrix()
    return np.asarray(poses[FLANGE] @ turned)


def hand(push: Push, rng: np.random.Generator) -> Callable[[float], Array]:
    """It comes in from one side, passes near the bottle's path, and leaves."""
    side, reach_m = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 0.15)
    x_m, start_s = rng.uniform(0.6, 0.9), push.execution.t_start_s

    def at(t_s: float) -> Array:
        X = np.eye(4)
        X[:3, 3] = x_m, side * (reach_m + 0.6 * abs(t_s - start_s - 0.6)), 0.09
        return X

    return at


@dataclass(frozen=True, eq=False)
class Result:
    """Errors of one push."""

    xy_mm: Array  # (N,) a frame in which the bottle was located and had not fallen
    fell_mm: float  # where it is counted from its fall on; NaN for one that stands
    frames: int
    rest_mm: float  # in the last frame; NaN where it was not located there
    found_mm: float
    agrees: bool
    tipped: bool
    ms_per_frame: float
    observed_mm: Array  # (M,) at the times of the task's observation
    flags: tuple[str, ...]
    silent_mm: float  # largest error that no flag and no low confidence goes with


def judged(
    tracker: Tracker, model: CameraModel, X_BC: Array, push: Push, film: tuple[Frame, ...], repeats: int
) -> Result | None:
    """None where the bottle was refused before the motion."""
    before, *frames = film
    start_s = push.execution.t_start_s
    try:
        detection = tracker.find(before, model, X_BC)
    except PerceptionError as error:
        print(f"    refused: {error}")
        return None
    duration_s = float(push.execution.t_s[-1])
    request = TrackRequest(Recording(before, frames, model, X_BC, push.execution), detection, push.tool, duration_s)
    spent_s = []
    for _ in range(repeats):
        began_s = time.process_time()
        track = tracker.track(request)
        spent_s.append(time.process_time() - began_s)
    times_s = TASK.observation.times_s
    xy_mm = _apart_mm(push, track.t_s, track.state[:, :2])
    observed_mm = _apart_mm(push, times_s, track.at(times_s)[:, :2])
    tipped = lean_deg(push.X_BO[-1]) > TIPPED_DEG
    located = track.confidence > 0
    stood = located & (track.t_s + start_s < push.fell_s)
    out = not (
        BOTTLE_AREA[0] < push.X_BO[-1, 0, 3] < BOTTLE_AREA[1] and BOTTLE_AREA[2] < push.X_BO[-1, 1, 3] < BOTTLE_AREA[3]
    )
    silent = xy_mm[track.confidence > 0.9] if not track.flags else np.zeros(1)
    return Result(
        xy_mm[stood],
        float(xy_mm[-1]) if tipped else float("nan"),
        len(located),
        float(xy_mm[-1]) if located[-1] else float("nan"),
        1e3 * float(np.linalg.norm(detection.xy_m - push.X_BO[0, :2, 3])),
        track.outcome is Outcome.LOST if out else (track.outcome is Outcome.TIPPED) == bool(tipped),
        bool(tipped),
        1e3 * min(spent_s) / len(frames),
        observed_mm,
        track.flags,
        float(silent.max(initial=0.0)),
    )


def _apart_mm(push: Push, times_s: Array, xy_m: Array) -> Array:
    """(N,) between tracked places (N, 2) at `times_s` since the start and the true ones as training counts them."""
    true_m = np.stack([push.counted_m(float(t) + push.execution.t_start_s) for t in times_s])
    return np.asarray(1e3 * np.linalg.norm(xy_m - true_m, axis=1))


def shown(rows: dict[str, list[Result | None]]) -> None:
    for name, all_results in rows.items():
        results = [r for r in all_results if r is not None]
        if not results:
            print(f"{name}: none tracked")
            continue
        xy = np.concatenate([r.xy_mm for r in results])
        fell = np.array([r.fell_mm for r in results if r.tipped] or [np.nan])
        rest, found_mm = np.array([r.rest_mm for r in results]), np.array([r.found_mm for r in results])
        flagged, tipped = sum(bool(r.flags) for r in results), sum(r.tipped for r in results)
        print(
            f"{name}: {len(results)} of {len(all_results)} pushes, "
            f"{len(xy)} of {sum(r.frames for r in results)} frames located before a fall, {tipped} tipped\n"
            f"  XY mm: mean {xy.mean():.2f}  p95 {np.percentile(xy, 95):.2f}  max {xy.max():.2f}   "
            f"where it fell: mean {fell.mean():.2f}, max {fell.max():.2f}\n  "
            f"at rest: mean {np.nanmean(rest):.2f}, max {np.nanmax(rest):.2f}   before: mean {found_mm.mean():.2f}, "
            f"max {found_mm.max():.2f}\n"
            f"  observation mm, mean / largest: {_observed(results, tipped=False)} where it stands, "
            f"{_observed(results, tipped=True)} where it fell\n"
            f"  outcomes {sum(r.agrees for r in results)}/{len(results)}   flagged {flagged}/{len(results)}   "
            f"largest unflagged error {max(r.silent_mm for r in results):.2f} mm   "
            f"{np.median([r.ms_per_frame for r in results]):.1f} ms a frame",
            flush=True,
        )
        for flag in sorted({f.rsplit(" in ", 1)[0].split(" (")[0] for r in results for f in r.flags}):
            print(f"    flagged: {flag}")


def _observed(results: list[Result], *, tipped: bool) -> str:
    some = [r.observed_mm for r in results if r.tipped is tipped]
    return f"{np.mean(some):.2f} / {np.max(some):.2f}" if some else "-"
