"""What an operator can get wrong with pushing and the pendulum: a clear message, an exit code, and nothing lost."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from clocks import FakeClock
from lab_session import ADAPTSIM, environment
from players import InstantArm

from adaptsim_cli.bench.devices.trackers import tracker_of
from adaptsim_cli.bench.rig import Planner, Rig
from adaptsim_cli.commands import app
from adaptsim_cli.config import Config
from adaptsim_cli.session import opening
from adaptsim_cli.session.rig_target import RigTarget
from adaptsim_cli.session.target import Provenance, SessionParts
from calib.types import HandEye
from hw.collision import KeepOut
from hw.kinematics import forward
from hw.types import Array, CameraModel, Frame, JointPath
from hw.workcell import Workcell
from sim.adaptation.adaptation import Assessment
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


@dataclass
class Asked:
    """A bench that remembers who was asked last: (trial, attempt)."""

    last: tuple[int, int] | None = None

    def place(self, xy_m: np.ndarray, trial: int, attempt: int) -> None:
        self.last = trial, attempt


@dataclass(eq=False)
class BottleBench:
    """`before(trial, attempt)` is what the camera sees before a motion, `during` a hand while the arm moves."""

    before: Callable[[int, int], Scene] = lambda trial, attempt: Scene()
    during: tuple[float, float, float] | None = None
    keep_out: tuple[KeepOut, ...] = ()
    clock: FakeClock = field(default_factory=FakeClock)
    bench: Asked = field(default_factory=Asked)

    @cached_property
    def cell(self) -> Workcell:
        return replace(cell_as_shipped(HARDWARE, "panda"), keep_out=self.keep_out)

    @cached_property
    def arm(self) -> InstantArm:
        return InstantArm(home(HARDWARE.X_FT, self.cell), self.cell, self.clock)

    @property
    def pushes(self) -> int:
        """How many motions were made."""
        return len(self.arm.executed) // 3

    @contextmanager
    def open_parts(self, config: Config, learnt: Path, **_: object) -> Iterator[SessionParts]:
        """In the place of `opening.open_parts`."""
        eye = HandEye(default_X_BC(), 1.0, 0.1, "known", "2026-01-01T00:00:00+00:00")
        with self.arm as arm, _Camera(self) as camera:
            rig = Rig("fake", "bench in memory", arm, camera, self.bench, eye, 10**6)
            origin = Provenance("none", "c" * 64, "w" * 64, "known", "h" * 64, {"adaptsim": "0"})
            target = RigTarget(TASK, rig, tracker_of(TASK), self._planner())
            yield SessionParts(TASK, target, MiddleAdaptation(), origin)  # type: ignore[arg-type]  # without a method

    def _planner(self) -> Planner:
        def paths(motion: ToolMotion) -> tuple[JointPath, JointPath, JointPath]:
            return trial_paths(motion, HARDWARE.X_FT, self.cell, home(HARDWARE.X_FT, self.cell))

        return Planner(paths, self.cell.require, forward)

    def scene(self) -> Scene:
        """Before a motion."""
        return Scene() if self.bench.last is None else self.before(*self.bench.last)


class MiddleAdaptation:
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

    def assess(self, history: Sequence[Iteration]) -> Assessment:
        verdict = Verdict(kind=Kind.TOO_FEW, reward=0.5, ci95=(0.0, 1.0), trials=1, strange=0)
        return Assessment(Best(history[-1][0].particle, 0.5, (0.0, 1.0), 1), verdict, None, ())


class _Middle:
    def __call__(self, context: Array) -> Array:
        return TASK.action.middle

    def actions(self, contexts: Array) -> Array:
        return np.array([self(context) for context in contexts])

    def predict(self, context: Array) -> tuple[float, float, float]:
        return (0.5, 0.0, 1.0)


class _Camera:
    """Depth images of the scene, without the arm; while a recording runs, the bottle moves ahead of the plate."""

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

    def newest(self) -> np.ndarray | None:
        return None

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


SESSION = ["run-iteration", "--task", "pushing", "--session", "s", "--yes", "--json"]
ROLLOUT = ["rollout", "--task", "pushing", "--yes"]
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch) -> Callable[[BottleBench], BottleBench]:
    def use(bench: BottleBench) -> BottleBench:
        monkeypatch.setattr(opening, "open_parts", bench.open_parts)
        return bench

    return use


def trials(home_folder: Path) -> list[str]:
    """Folders of trials of the session, whole ones and rejected ones."""
    return sorted(p.name for p in home_folder.glob("home/data/sessions/s/iteration-01/trial-*") if p.is_dir())


# What was typed ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--task", "pushing", "--context", "goal_x=1.4"], "goal_x [m] = 1.4 lies outside of [0.7, 1]"),
        (["--task", "pushing", "--context", "goal_bearing=12"], "goal_bearing [rad] = 12 lies outside of [-0.1745"),
        (["--task", "pushing", "--action", "speed=1.5"], "speed [m/s] = 1.5 lies outside of [0.4, 0.8]"),
        (["--task", "pushing", "--action", "speed=nan"], "speed [m/s] = nan lies outside of [0.4, 0.8]"),
        (["--task", "pushing", "--action", "sped=0.5"], "did you mean speed? write name=value, e.g. yaw=0"),
        (["--task", "pushing", "--action", "speed=fast"], "'fast' is not a number"),
        (["--task", "pushing", "--param", "y_p=0.2"], "y_p [m] = 0.2 lies outside of [-0.1, 0.1]"),
        (["--task", "pushing", "--world", "moon"], "no world 'moon' for pushing; there are half-full"),
        (["--task", "pendulum", "--action", "k11=1000"], "k11 [N m/rad] = 1000 lies outside of [0, 160]"),
        (["--task", "pendulum", "--hw", "fr3"], "pendulum runs in simulation only, so no arm can execute it"),
    ],
)
def test_a_wrong_word_is_a_usage_error(arguments: list[str], said: str, tmp_path: Path, capfd: Capture) -> None:
    assert app.run(["rollout", *arguments, "--yes"]) == 2
    shown = capfd.readouterr()
    assert said in shown.err
    assert shown.err.count("Error:") == 1
    assert shown.out.strip() in ("", "Loading the task, the policies and the devices")
    assert not (tmp_path / "home" / "data" / "rollouts").exists()


def test_a_session_of_the_pendulum_needs_no_arm_and_says_so(tmp_path: Path, capfd: Capture) -> None:
    assert app.run(["run-iteration", "--task", "pendulum", "--hw", "fr3", "--yes"]) == 2
    assert "Leave --hw out, or choose another --task" in capfd.readouterr().err
    assert not (tmp_path / "home" / "data" / "sessions").exists()


# What stands on the table --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (Scene(bottles=()), "no bottle: nothing stands in"),
        (Scene(((0.572, -0.009),)), "15 mm from its mark"),
        (Scene((MARK, (0.80, 0.12))), "2 bottles are on the table"),
        (Scene(hand=(0.75, 0.15, 0.08)), "clear the table, and keep hands away"),
        (Scene(hand=(0.56, 0.078, 0.05)), "keep hands and other things away from it"),
    ],
    ids=["no bottle", "misplaced", "two bottles", "a hand beside it", "a hand at it"],
)
def test_a_wrong_table_is_refused_before_anything_moves(
    scene: Scene, said: str, use: Callable[[BottleBench], BottleBench], tmp_path: Path, capfd: Capture
) -> None:
    bench = use(BottleBench(before=lambda trial, attempt: scene))
    assert app.run(SESSION) == 6
    shown = capfd.readouterr()
    assert said in shown.err.partition("Error:")[2]
    assert "Continue with: adaptsim run-iteration --session s" in shown.err
    assert shown.out == ""
    assert bench.arm.executed == []
    assert trials(tmp_path) == []


@pytest.mark.long
def test_a_second_bottle_half_way_costs_no_finished_trial_and_the_session_goes_on(
    use: Callable[[BottleBench], BottleBench], tmp_path: Path, capfd: Capture
) -> None:
    two = Scene((MARK, (0.80, 0.12)))
    bench = use(BottleBench(before=lambda trial, attempt: Scene() if trial == 1 else two))
    assert app.run(SESSION) == 6
    assert "leave one, on the mark" in capfd.readouterr().err
    assert bench.pushes == 1
    assert trials(tmp_path) == ["trial-001-attempt-1"]

    bench = use(BottleBench())
    assert app.run(SESSION) == 0
    summary = json.loads(capfd.readouterr().out)
    assert [len(particle["trials"]) for particle in summary["particles"]] == [2, 2]
    assert bench.pushes == 3, "the finished trial is kept"
    assert trials(tmp_path)[0] == "trial-001-attempt-1"
    assert len(trials(tmp_path)) == 4


@pytest.mark.long
def test_the_message_says_where_to_move_the_bottle(use: Callable[[BottleBench], BottleBench], capfd: Capture) -> None:
    use(BottleBench(before=lambda trial, attempt: Scene(((0.572, -0.009),)) if attempt == 0 else Scene()))
    assert app.run(ROLLOUT) == 0
    out = " ".join(capfd.readouterr().out.split())
    assert "5 mm are allowed; move it 12 mm towards the robot and 9 mm to the robot's left" in out


@pytest.mark.long
def test_four_millimetres_off_the_mark_are_accepted(use: Callable[[BottleBench], BottleBench], capfd: Capture) -> None:
    bench = use(BottleBench(before=lambda trial, attempt: Scene(((0.5628, 0.0028),))))
    assert app.run([*ROLLOUT, "--context", "goal_x=1.0"]) == 0
    assert bench.pushes == 1
    assert re.search(
        r"Tracked: upright, reward \d\.\d\d .*, \d+ mm from the goal$", capfd.readouterr().out, re.MULTILINE
    )


@pytest.mark.long
def test_a_hand_in_the_picture_during_the_motion_is_flagged_and_the_trial_kept(
    use: Callable[[BottleBench], BottleBench], capfd: Capture
) -> None:
    use(BottleBench())
    assert app.run([*ROLLOUT, "--json"]) == 0
    alone = json.loads(capfd.readouterr().out)
    use(BottleBench(during=(0.80, 0.22, 0.08)))
    assert app.run([*ROLLOUT, "--json"]) == 0
    shown = capfd.readouterr()
    record = json.loads(shown.out)
    assert alone["flags"] == []
    assert any(flag.startswith("a hand or another object") for flag in record["flags"])
    assert "note: a hand or another object" in shown.err
    assert np.allclose(record["observation"], alone["observation"], atol=0.005), "it is not tracked for the bottle"


# What cannot be executed ---------------------------------------------------------------------------------------------


def test_a_push_into_what_must_be_kept_clear_is_refused(
    use: Callable[[BottleBench], BottleBench], tmp_path: Path, capfd: Capture
) -> None:
    box = KeepOut("the balance", np.array([0.62, -0.10, 0.0]), np.array([0.70, 0.10, 0.2]))
    bench = use(BottleBench(keep_out=(box,)))
    assert app.run([*ROLLOUT, "--action", "speed=0.8", "--action", "yaw=0.1"]) == 4
    said = capfd.readouterr().err
    assert "the balance" in said
    assert "Nothing has moved. Choose another --action: adaptsim preview --task pushing" in said
    assert bench.arm.executed == []
    assert not list((tmp_path / "home" / "data").glob("rollouts/*"))


def test_a_scoop_beyond_the_arm_is_refused_with_joint_value_and_limit(capfd: Capture) -> None:
    where = ["--context", "x=0.64", "--context", "y=-0.03"]
    how = ["--action", "pitch_rate=0.2", "--action", "pitch=0.1745", "--action", "distance=0.005"]
    assert app.run(["preview", "--task", "scooping", "--arm", "fr3", *where, *how, "--json"]) == 4
    shown = capfd.readouterr()
    assert re.search(r"fr3: no joint path keeps every limit .* joint \d at t = .* limit .* another action", shown.err)
    assert shown.out == ""


# The whole lab -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_camera_that_was_moved_stops_the_whole_lab_before_the_arm_moves(tmp_path: Path) -> None:
    world = tmp_path / "moved.toml"
    world.write_text(
        'task = "pushing"\ndescription = "a camera that was pushed aside"\n[params]\nmu = 0.1\ne = 1e5\nmu_p = 0.4\n'
        "y_p = 0.0\n[sensing]\nextrinsic_error_mm = 60.0\n"
    )
    command = [*ADAPTSIM, "run-iteration", "--task", "pushing", "--world", str(world), "--yes", "--json"]
    for _ in range(2):
        done = subprocess.run(
            command, env=environment(tmp_path / "home"), capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert done.returncode == 6, done.stderr
        assert done.stderr.count("Error:") == 1
        assert "Traceback" not in done.stderr
        assert done.stdout == ""
        assert not [p for p in (tmp_path / "home").rglob("trial-*") if p.is_dir()]
