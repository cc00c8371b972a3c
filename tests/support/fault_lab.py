"""Motions of a real lab's arm under faults, judged by `mesh_judge`: trials and calibration motions.

Every motion goes through the operator's consent, the pedal and the whole driver. Boxes stand close to it.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from arm_meshes import placed
from cells import cell, smooth
from fault_world import BY_THE_ARM, LOSING, SILENT, SimulatedPlayer, World
from hard_paths import LOADED
from hard_paths import TIP_F_M as TRIAL_TIP_F_M
from living_sdk import LivingSdk
from mesh_judge import judged, surfaces
from own_judge import MAKERS, Array, Scene, poses, wrong_within
from real_lab import waiver
from rich.console import Console

from adaptsim_cli.bench.calibration_in_use import BOARD_HOME_RAD, held_board
from adaptsim_cli.bench.devices.attended import ToolWatch
from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.devices.known_arm import KnownArm
from adaptsim_cli.errors import CliError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.storage import durable
from hw.collision import KeepOut, Tool
from hw.errors import ArmFault, HardwareError, MotionRefused
from hw.franka.arm import FrankaArm
from hw.franka.connection import DRIVES, Connection
from hw.franka.settings import FrankaSettings
from hw.grasping import FakeHand
from hw.ports import Pedal
from hw.serial.pedal_protocol import line_for
from hw.types import JointPath
from perception.board.types import Board
from sim.errors import NotExecutable
from sim.panda.postures import way

HOME = np.array([0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.7])
SETTINGS = FrankaSettings("172.16.0.2")
AT_REST_S, IN_SILENCE_S = 0.40, 0.47
"""From a fault that the player hears at once, or from a silence, to the last command that differs: what the
documents promise."""
ABOVE_M, BOX_M = (-0.01, 0.08), 0.05
"""How far a box stands from the surface at one moment of the motion; what the program then refuses is drawn again."""

TYPED = {
    "terminal: ends": "",
    "terminal: stopped": "q\n",
    "terminal: escape": "\x1b\n",
    "terminal: wrong": "yes\n\nq\n",
    "terminal: Enter": 20 * "\n",
}
HANDS = {"hand: tool lost": (0.0, False), "hand: tool slipped": (0.008, True)}
DISKS = ("disk: full before", "disk: full after")


@dataclass
class Outcome:
    """What the faults of one motion did."""

    kind: str
    effective: bool
    wrong: list[str]
    stop_s: float = 0.0
    motion: str = ""  # "trial", "calibration"
    refused: int = 0  # boxes too near, drawn again


@dataclass(frozen=True, eq=False)
class Course:
    """A motion, and what holds for it."""

    motion: str
    path: JointPath
    tool: Tool
    tip_F_m: Array


@cache
def board_tool() -> Tool:
    return held_board(Board()).tool()


def drawn(motion: str, model: str, rng: np.random.Generator) -> Course:
    """A random motion of its sort."""
    if motion == "calibration":
        home, tool = np.array(BOARD_HOME_RAD), board_tool()
        while True:
            start, end = (home + rng.uniform(-0.3, 0.3, 7) for _ in range(2))
            try:
                path = way(start, end, home, cell(model, tool))
            except NotExecutable:
                continue
            return Course(motion, path, tool, np.zeros(3))
    samples = int(rng.integers(600, 1000))
    travel = rng.uniform(-0.25, 0.25, 7) * np.array([1.0, 0.6, 1.0, 0.6, 1.0, 0.8, 1.0])
    share = smooth(np.linspace(0.0, 1.0, samples)[:, None])
    return Course(motion, JointPath(np.arange(samples) / 1e3, HOME + share * travel), LOADED, TRIAL_TIP_F_M)


def box_near(course: Course, model: str, rng: np.random.Generator, gap_m: float) -> KeepOut:
    """A cube whose nearest corner or face lies about `gap_m` from a point of the surface at one moment."""
    q = course.path.q_rad[int(rng.integers(len(course.path.q_rad)))]
    part = surfaces(model)[int(rng.integers(3, len(surfaces(model))))]
    X = poses(q[None])[0, part.link]
    point = part.coarse_m[int(rng.integers(len(part.coarse_m)))]
    outward = X[:3, :3] @ (point - part.coarse_m.mean(axis=0))
    at_m = placed(point[None], X)[0] + (gap_m + BOX_M) * outward / np.linalg.norm(outward)
    return KeepOut("a box", at_m - BOX_M / 2, at_m + BOX_M / 2)


@dataclass
class Lab:
    """A real lab's arm over a stand-in SDK, with its operator, pedal and hand."""

    kinds: tuple[str, ...]
    model: str
    course: Course
    boxes: tuple[KeepOut, ...]
    world: World
    folder: Path
    rng: np.random.Generator
    sdk: Any = field(init=False)

    def __post_init__(self) -> None:
        world, model, course = self.world, self.model, self.course
        start_rad = course.path.q_rad[0]
        self.sdk = LivingSdk(k=model == "panda", when=world.cycle, q_rad=start_rad.tolist(), rng=self.rng)
        self.sdk.feels = lambda q: [0.4] * 7
        made = self.sdk.Robot

        def robot(host: str, realtime: str) -> Any:
            return _Spoilt(made(host, realtime), world)

        def start() -> SimulatedPlayer:
            sdk = self.sdk
            driver = Connection(model, sdk, DRIVES[model], SETTINGS, realtime=True, clock=sdk.clock)
            playing = SimulatedPlayer(driver)
            playing.world = world
            return playing

        self.sdk.Robot = robot
        pedal = cast(Pedal, world)
        self.bare = FrankaArm(cell(model, course.tool, keep_out=self.boxes), SETTINGS, start, pedal=pedal)
        world.sdk, world.arm = self.sdk, self.bare
        self.known = KnownArm(self.folder / "known")
        self.consent = Consent(
            Screen(console=Console(file=io.StringIO(), markup=False)),
            model,
            operator="Kim",
            pedal=True,
            each="motion",
            known_arm=self.known,
            waivers=(waiver("stop_button"), waiver("slow_start")),
        )
        self.hand = FakeHand(0.012, holds=True).__enter__()
        watch = ToolWatch(self.hand, "tool", "touch-off")
        watch.require()

        def wait(_: float) -> None:
            world.pass_ms(20)

        self.arm = ConfirmedArm(self.bare, self.consent, pedal, before=watch.require, now_s=world.now_s, pause=wait)

    def move(self) -> BaseException | None:
        """Execute the motion with its faults; what it raised."""
        world, written = self.world, durable.replace_file
        typed = next((TYPED[kind] for kind in self.kinds if kind in TYPED), f"{self.model}\ny\n")
        stdin, sys.stdin = sys.stdin, io.StringIO(typed)
        world.box = lambda count: line_for(count, count > 5)  # a press that is seen from its beginning
        world.pass_ms(200)
        world.box = lambda count: line_for(count, True)
        try:
            with self.arm:
                for kind in self.kinds:
                    if kind in HANDS:
                        self.hand.width_m, self.hand.holds = HANDS[kind]
                    if kind in DISKS:
                        durable.replace_file = _full(1 if kind == DISKS[0] else 2, written)
                world.fire(lambda at: at < 0)
                if world.fired:
                    world.pass_ms(100)
                self.arm.execute(self.course.path)
        except (HardwareError, CliError, KeyboardInterrupt) as found:
            return found
        finally:
            durable.replace_file = written
            sys.stdin = stdin
        return None

    def motions(self) -> list[Array]:
        """(M, 7) all that the arm was commanded, a motion each."""
        whole: list[list[Any]] = [[]]
        for name, what in self.sdk.calls:
            if name == "command":
                whole[-1].append(what[0])
                if what[1]:
                    whole.append([])
        return [np.array(one) for one in whole if one]


def one_motion(
    kinds: tuple[str, ...],
    faults: Callable[[int], tuple[tuple[int, Any], ...]],
    motion: str,
    model: str,
    rng: np.random.Generator,
    folder: Path,
) -> Outcome:
    """A motion with the faults that `faults` puts into it, given its length in ms; boxes as near as they may be."""
    label, refused, course = " + ".join(kinds), 0, drawn(motion, model, rng)
    for gap_m in (*rng.uniform(*ABOVE_M, 2), 0.3):
        boxes = (box_near(course, model, rng, float(gap_m)),)
        lab = Lab(kinds, model, course, boxes, World(faults(len(course.path.t_s))), folder / str(refused), rng)
        error = lab.move()
        if isinstance(error, MotionRefused) and "keep-out" in str(error) and not lab.motions():
            refused += 1
            continue
        break
    moved = lab.motions()
    begun = bool(moved) and len(moved[0]) > 1
    if not begun:
        said = [] if error else ["nothing moved and nothing was said"]
        return Outcome(label, error is not None, said, motion=motion, refused=refused)
    notes = ["moved without consent"] if lab.consent.given_at is None else []
    stop_s = after(lab, moved) if error is not None else 0.0
    heard = all(kind not in SILENT and not kind.startswith("pedal") for kind in kinds)
    if not BY_THE_ARM.intersection(kinds) and stop_s > (AT_REST_S if heard else IN_SILENCE_S):
        notes.append(f"the last command that differs came {stop_s:.3f} s after the fault")
    notes += broken(lab, moved, error, kinds)
    if error is not None and DISKS[0] not in kinds:
        notes += [] if lab.known.unended() else ["an unfinished motion was forgotten"]
        notes += latched(lab) if isinstance(error, ArmFault) else []
    late = lab.bare.last_execution is not None and lab.bare.last_execution.control_success_rate < 1.0
    changed = error is not None or (bool(LOSING.intersection(kinds)) and late)
    return Outcome(label, changed, notes, stop_s, motion, refused)


def after(lab: Lab, moved: list[Array]) -> float:
    """Seconds from the first fault to the last command that differs from the one before it."""
    q = np.concatenate(moved)
    changed = np.flatnonzero(np.abs(np.diff(q, axis=0)).max(axis=1) > 0.0)
    first = lab.world.fired[0] if lab.world.fired else 0
    return max(int(changed[-1]) + 1 - first, 0) / 1e3 if len(changed) else 0.0


def broken(lab: Lab, moved: list[Array], error: BaseException | None, kinds: tuple[str, ...]) -> list[str]:
    """What the commanded motions break, by the judge."""
    course, model = lab.course, lab.model
    scene = Scene(course.tool.mass, course.tip_F_m, tuple((box.low_m, box.high_m) for box in lab.boxes))
    if LOSING.intersection(kinds):
        refusal = "motion_generator" in str(error)  # braking while cycles are lost may ask for more than the arm allows
        said = [f"the arm refused a command: {error}"] if refusal and len(kinds) == 1 else []
        return said + in_time(lab, moved[0])
    notes, before = [], course.path.q_rad[0]
    for number, q in enumerate(moved):
        rests = not BY_THE_ARM.intersection(kinds) or number < len(moved) - 1
        if len(q) > 6:
            found = judged(q, before, model, scene, rests=rests)
            notes += [f"{course.motion}: {found}"] if found else []
        elif text := wrong_within(q, before, model):
            notes.append(text)
        before = q[-1]
    return notes


def in_time(lab: Lab, q: Array) -> list[str]:
    """Whether every command of the first motion lies within reach of the one before, in the time between them."""
    since = np.ones(len(q) - 1)
    for cycle in lab.sdk.lost_cycles:
        if 2 <= cycle <= len(q):
            since[cycle - 2] = 2.0
    for cycle, ms in lab.sdk.gaps.items():
        if 2 <= cycle <= len(q):
            since[cycle - 2] = ms
    most = np.array(MAKERS[lab.model][2]) * 1e-3
    over = np.abs(np.diff(q, axis=0)) / (most * since[:, None])
    notes = [f"a command {over.max():.1f} times too far for the time since the last"] if over.max() > 1.0 else []
    late = np.flatnonzero(since > 20.0)
    if len(late) and np.abs(np.diff(q[late[0] :], axis=0)).max(initial=0.0) > most.max():
        notes.append(f"after a gap of {since[late[0]]:.0f} ms the motion went on")
    return notes


def latched(lab: Lab) -> list[str]:
    """After its cause is gone, a stopped arm moves only after a recovery."""
    lab.sdk.fails.clear()
    lab.sdk.modes.be("Idle")
    lab.world.nan, lab.world.words = False, True
    lab.world.box = lambda count: line_for(count, count % 50 > 2)
    lab.world.pass_ms(1500)
    before = len(lab.motions())
    samples = np.linspace(0.0, 1.0, 600)[:, None]
    path = JointPath(np.arange(600) / 1e3, np.array(lab.sdk.robot._q) + 0.01 * smooth(samples))
    try:
        with lab.bare:
            lab.bare.execute(path)
    except ArmFault:
        return [] if len(lab.motions()) == before else ["moved without a recovery"]
    except HardwareError as error:
        return [f"a stopped arm was not refused as such: {error}"]
    return ["moved without a recovery"]


class _Spoilt:
    """A robot whose measured joints become nonsense once the world says so."""

    def __init__(self, robot: Any, world: World) -> None:
        self._robot, self._world = robot, world

    def __getattr__(self, name: str) -> Any:
        return getattr(self._robot, name)

    def read_once(self) -> Any:
        return self._spoilt(self._robot.read_once())

    def start_joint_position_control(self, mode: str) -> Any:
        control = self._robot.start_joint_position_control(mode)
        read = control.readOnce

        def spoilt() -> tuple[Any, Any]:
            state, since = read()
            return self._spoilt(state), since

        control.readOnce = spoilt
        return control

    def control_joint_position(self, callback: Any, **options: Any) -> None:
        self._robot.control_joint_position(lambda state, since: callback(self._spoilt(state), since), **options)

    def _spoilt(self, state: Any) -> Any:
        if self._world.nan:
            state.q = [float("nan"), *state.q[1:]]
        return state


def _full(at: int, write: Callable[..., None]) -> Callable[..., None]:
    """The disk is full at the write number `at` and after it."""
    count = 0

    def fails(path: Path, content: bytes) -> None:
        nonlocal count
        count += 1
        if count >= at:
            with durable.explained(path):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, content)

    return fails
