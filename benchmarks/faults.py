"""A campaign of faults: kinds x moments over arm, pedal, hand, disk, process, clock, terminal and camera, seeded.

    PYTHONPATH=tests/support python benchmarks/faults.py --motions 500 --cameras 60 --sessions 60 --out faults.jsonl

A motion is one of a real lab's arm: consent, pedal protocol, checks, player and the pipe between them are the program's
own, in simulated time; only the SDK is a stand-in (`tests/support/sdk_fake.py`). A recording is one of the camera's
driver over a stand-in of libk4a. A session is a whole toy session that a fault stops at a random moment and that the
same command then continues. A fault that changed nothing does not count. `--out` keeps a line for each fault; the same
command goes on after the last.

After each fault:

* no command was beyond a limit, by code that shares nothing with the program (`tests/support/own_judge.py`);
* the last command that differs came within `hw.braking.STOP_S` after the player could know, 0.06 s more where it had
  to hear silence;
* nothing was commanded without the typed model;
* a motion that did not end is remembered, and nothing moves before a recovery;
* a recording is an error, or each of its frames has its true time and at most a quarter of them is missing;
* of a session no completed trial changed, none is missing and none counted twice.
"""

from __future__ import annotations

import argparse
import errno
import io
import os
import signal
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, cast

import fake_k4a
import numpy as np
import toy_rig
import toy_session
from camera_stage import DELAY_S, Shown
from cells import cell
from fake_k4a import PERIOD_S, FakeK4a, running
from hard_paths import LOADED, SCENE, shares
from kept import Kept
from own_judge import wrong
from players import InProcess
from real_lab import waiver
from rich.console import Console
from sdk_fake import FakeSdk, NetworkException, alive
from toy_rig import ToyLab

from adaptsim_cli.devices.attended import ToolWatch
from adaptsim_cli.devices.confirmed import ConfirmedArm
from adaptsim_cli.devices.consent import Consent
from adaptsim_cli.devices.known_arm import KnownArm
from adaptsim_cli.errors import CliError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session import running as session_running
from adaptsim_cli.storage import durable
from hw.braking import STOP_S
from hw.errors import ArmFault, CameraError, HardwareError, StoppedByPedal
from hw.franka import player
from hw.franka.arm import FrankaArm
from hw.franka.connection import DRIVES, Connection
from hw.franka.playback import PlayOutcome
from hw.franka.settings import FrankaSettings
from hw.grasping import FakeHand
from hw.ports import Pedal
from hw.serial.pedal_protocol import PedalState, line_for
from hw.types import Array, JointPath
from hw.watchdog import SILENCE_S, Watchdog

WORD_EVERY, LINE_EVERY = 5, 20
HOME = np.array([0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.7])
SETTINGS = FrankaSettings("172.16.0.2")


@dataclass
class World:
    """Simulated milliseconds, the pedal's box, the program's words, and one fault at one of them."""

    fault: Callable[[World], None]
    at: int  # ms into the motion; negative: before it is checked; 0: between the check and the motion
    t_ms: int = 0
    asleep_s: float = 0.0
    box: Callable[[int], bytes] = lambda count: line_for(count, True)
    words: bool = True  # the program lives and speaks
    pedal: PedalState = field(default_factory=PedalState)
    lines: int = 0
    moving: bool = False
    fired: bool = False
    sdk: Any = None
    arm: Any = None
    pipe: tuple[int, int] = (-1, -1)
    word: Callable[[], bytes] = lambda: b"."
    nan: bool = False

    def now_s(self) -> float:
        return self.t_ms / 1e3 + self.asleep_s

    def pass_ms(self, count: int = 1) -> None:
        for _ in range(count):
            self.t_ms += 1
            if self.t_ms % LINE_EVERY == 0:
                self.lines += 1
                self.pedal = self.pedal.feed(self.box(self.lines), self.now_s())

    def enabled(self) -> bool:
        return self.pedal.enabled(self.now_s())

    def why_not(self) -> str:
        return self.pedal.why_not(self.now_s())

    def fire(self) -> None:
        if not self.fired:
            self.fired = True
            self.fault(self)

    def cycle(self, cycle: int) -> None:
        """A millisecond of a motion."""
        self.pass_ms()
        if cycle == self.at:
            self.fire()
        if self.words and self.pipe[1] >= 0 and cycle % WORD_EVERY == 0:
            os.write(self.pipe[1], self.word())


class SimulatedPlayer(InProcess):
    """The player's own loop and listener over a pipe, in simulated time."""

    world: World

    def play(self, motion: Any, word: Callable[[], bytes], guard: Any = None) -> PlayOutcome:
        world, ends = self.world, os.pipe()
        world.pipe, world.word = ends, word
        if world.at == 0:
            world.fire()
        try:
            return player.play(self.driver, motion, Watchdog(ends[0], SILENCE_S, world.now_s), guard, 1e9)
        finally:
            world.pipe = (-1, -1)
            for end in ends:
                try:
                    os.close(end)
                except OSError:
                    continue


def reflex(world: World) -> None:
    world.sdk.modes.reasons = ("joint_reflex",)


def user_stop(world: World) -> None:
    world.sdk.modes.pressed = True


def guiding(world: World) -> None:
    world.sdk.modes.guided = True


def network(world: World) -> None:
    world.sdk.fails["read_once"] = NetworkException("libfranka: UDP receive: Timeout")


def nonsense(world: World) -> None:
    world.nan = True


def moved(world: World) -> None:
    world.sdk.robot._q[2] += 0.004


def heavier(world: World) -> None:
    world.sdk.feels = alive(lambda q: np.array([0.0, 9.0, 0.0, -6.0, 0.0, 1.0, 0.0]))


def lost_cycles(world: World) -> None:
    world.sdk.lost_cycles = tuple(range(world.at + 1, world.at + 40, 2))


def release(world: World) -> None:
    world.box = lambda count: line_for(count, False)


def silent_pedal(world: World) -> None:
    world.box = lambda count: b""


def garbled(world: World) -> None:
    world.box = lambda count: line_for(count, True)[:-3] + b"ZZ\n"


def restarted_box(world: World) -> None:
    first = world.lines
    world.box = lambda count: line_for(count - first, True)


def stop_wanted(world: World) -> None:
    world.arm.stop()


def hanging(world: World) -> None:
    world.words = False


def killed(world: World) -> None:
    world.words = False
    if world.pipe[1] >= 0:
        os.close(world.pipe[1])


def slept(world: World) -> None:
    world.asleep_s += 3600.0


IN_MOTION: dict[str, Callable[[World], None]] = {
    "arm: reflex": reflex,
    "arm: stop button": user_stop,
    "arm: network": network,
    "arm: nonsense": nonsense,
    "arm: lost cycles": lost_cycles,
    "pedal: released": release,
    "pedal: silent": silent_pedal,
    "pedal: garbled": garbled,
    "pedal: restarted": restarted_box,
    "process: stop()": stop_wanted,
    "process: hangs": hanging,
    "process: killed": killed,
    "clock: suspended": slept,
}
BEFORE: dict[str, Callable[[World], None]] = {
    "arm: reflex": reflex,
    "arm: stop button": user_stop,
    "arm: guided": guiding,
    "arm: network": network,
    "arm: moved": moved,
    "arm: heavier": heavier,
    "pedal: released": release,
    "pedal: silent": silent_pedal,
    "process: stop()": stop_wanted,
    "clock: suspended": slept,
}
TYPED = {
    "terminal: ends": "",
    "terminal: stopped": "q\n",
    "terminal: escape": "\x1b\n",
    "terminal: wrong": "yes\n\nq\n",
}
HANDS = {"hand: tool lost": (0.0, False), "hand: tool slipped": (0.008, True)}
DISKS = ("disk: full before", "disk: full after")
SILENT = {"pedal: silent", "pedal: garbled", "process: hangs", "clock: suspended"}
BY_THE_ARM = {"arm: reflex", "arm: stop button", "arm: network"}


@dataclass
class Outcome:
    """What one fault did."""

    kind: str
    effective: bool
    wrong: list[str]
    stop_s: float = 0.0


@dataclass
class Lab:
    """A real lab's arm over a stand-in SDK, with its operator, pedal and hand."""

    kind: str
    model: str
    world: World
    folder: Path

    def __post_init__(self) -> None:
        world, model = self.world, self.model
        self.sdk: Any = FakeSdk(k=model == "panda", when=world.cycle, q_rad=HOME.tolist())
        made = self.sdk.Robot

        def robot(host: str, realtime: str) -> Any:
            self.sdk.robot = made(host, realtime)
            return _Nan(self.sdk.robot, world) if self.kind == "arm: nonsense" else self.sdk.robot

        def start() -> SimulatedPlayer:
            playing = SimulatedPlayer(
                Connection(model, self.sdk, DRIVES[model], SETTINGS, realtime=True, clock=self.sdk.clock)
            )
            playing.world = world
            return playing

        self.sdk.Robot = robot  # type: ignore[method-assign]
        self.bare = FrankaArm(cell(model, LOADED), SETTINGS, start, pedal=cast(Pedal, world))
        world.sdk, world.arm = self.sdk, self.bare
        self.known = KnownArm(self.folder / "known")
        self.consent = Consent(
            Screen(console=Console(file=io.StringIO(), markup=False)),
            model,
            operator="Kim",
            pedal=True,
            known=self.known,
            waivers=(waiver("stop_button"), waiver("slow_start")),
        )
        self.hand = FakeHand(0.012, holds=True).__enter__()
        watch = ToolWatch(self.hand, "tool", "touch-off")
        watch.require()

        def wait(_: float) -> None:
            world.pass_ms(20)

        pedal = cast(Pedal, world)
        self.arm = ConfirmedArm(self.bare, self.consent, pedal, before=watch.require, now_s=world.now_s, pause=wait)

    def move(self, path: JointPath) -> BaseException | None:
        """Execute `path` with the fault; what it raised."""
        world, kind, written = self.world, self.kind, durable.replace_file
        stdin, sys.stdin = sys.stdin, io.StringIO(TYPED.get(kind, f"{self.model}\n"))
        world.box = lambda count: line_for(count, count > 5)  # a press that is seen from its beginning
        world.pass_ms(200)
        world.box = lambda count: line_for(count, True)
        try:
            with self.arm:
                if kind in HANDS:
                    self.hand.width_m, self.hand.holds = HANDS[kind]
                if kind in DISKS:
                    durable.replace_file = _full(1 if kind == DISKS[0] else 2, written)
                if world.at < 0:
                    world.fire()
                    world.pass_ms(100)
                self.arm.execute(path)
        except (HardwareError, CliError, KeyboardInterrupt) as found:
            return found
        finally:
            durable.replace_file = written
            sys.stdin = stdin
        return None

    def commanded(self) -> Array:
        """(M, 7) all that the arm was commanded."""
        return np.array([what[0] for name, what in self.sdk.calls if name == "command"])


def one_motion(kind: str, at: int, model: str, rng: np.random.Generator, folder: Path) -> Outcome:
    """`at` in ms; where it is below 1, the fault comes before the motion."""
    lab = Lab(kind, model, World((IN_MOTION if at > 0 else BEFORE).get(kind, lambda _: None), at), folder)
    samples = int(rng.integers(700, 1400))
    travel = rng.uniform(-0.25, 0.25, 7) * np.array([1.0, 0.6, 1.0, 0.6, 1.0, 0.8, 1.0])
    path = JointPath(np.arange(samples) / 1e3, HOME + shares(samples) * travel)
    error = lab.move(path)
    q = lab.commanded()
    begun = len(q) > 1
    if not begun:
        return Outcome(kind, error is not None, [] if error else ["nothing moved and nothing was said"])
    notes = ["moved without consent"] if lab.consent.given is None else []
    changed = np.flatnonzero(np.abs(np.diff(q, axis=0)).max(axis=1) > 0.0)
    stop_s = max(int(changed[-1]) + 1 - at, 0) / 1e3 if len(changed) and error is not None else 0.0
    allowed_s = STOP_S + (SILENCE_S + 0.02 if kind in SILENT or kind.startswith("pedal") else 0.01)
    if kind not in BY_THE_ARM and stop_s > allowed_s:
        notes.append(f"at rest after {stop_s:.3f} s")
    if kind != "arm: lost cycles":
        notes += filter(None, [wrong(q, HOME, model, SCENE, rests=kind not in BY_THE_ARM)])
    elif "joint_motion_generator" in str(error):
        notes.append(f"the arm refused a command: {error}")
    if error is not None and kind not in DISKS:
        notes += [] if lab.known.unended() else ["an unfinished motion was forgotten"]
        notes += latched(lab, path) if isinstance(error, ArmFault) else []
    return Outcome(kind, error is not None, notes, stop_s)


def latched(lab: Lab, path: JointPath) -> list[str]:
    """After its cause is gone, a stopped arm moves only after a recovery."""
    lab.sdk.fails.clear()
    lab.sdk.modes.be("Idle")
    lab.world.nan, lab.world.words = False, True
    lab.world.box = lambda count: line_for(count, count % 50 > 2)
    lab.world.pass_ms(1500)
    before = len(lab.commanded())
    try:
        with lab.bare:
            lab.bare.execute(path)
    except HardwareError:
        return [] if len(lab.commanded()) == before else ["moved without a recovery"]
    return ["moved without a recovery"]


class _Nan:
    """A robot whose measured joints become nonsense."""

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


SESSION_ERRORS: dict[str, Callable[[], BaseException]] = {
    "session: reflex": lambda: ArmFault("joint_reflex"),
    "session: pedal": lambda: StoppedByPedal("the enabling pedal was released"),
    "session: camera": lambda: CameraError("no frame within 1 s"),
    "session: Ctrl-C": KeyboardInterrupt,
}
HOOKS = ("place", "snapshot", "execute", "stop_recording")


def one_session(kind: str, rng: np.random.Generator, home: Path) -> Outcome:
    """Two trials; the fault comes at the n-th call of one of the lab's hooks, then the same command goes on."""
    hook, at, calls = str(rng.choice(HOOKS)), int(rng.integers(1, 7)), 0

    def fail(trial: int, attempt: int) -> None:
        nonlocal calls
        calls += 1
        if calls != at:
            return
        if kind == "session: killed":
            os.kill(os.getpid(), signal.SIGKILL)
        raise SESSION_ERRORS[kind]()

    child = os.fork() if kind == "session: killed" else -1
    stopped = False
    if child <= 0:
        try:
            run(home, ToyLab(7, {hook: fail}))
        except (HardwareError, CliError, KeyboardInterrupt):
            stopped = True
        if child == 0:
            os._exit(0)
    if child > 0:
        stopped = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    before = completed(home)
    notes: list[str] = []
    if stopped:
        try:
            run(home, ToyLab(7))
        except (HardwareError, CliError) as error:
            notes.append(f"the same command did not go on: {error}")
    after = completed(home)
    notes += [f"{name} changed or is gone" for name, content in before.items() if after.get(name) != content]
    trials = sorted({Path(name).parent.name.split("-attempt")[0] for name in after})
    folders = {Path(name).parent.name for name in after}
    if trials != ["trial-001", "trial-002"] or len(folders) != 2:
        notes.append(f"trials are {sorted(folders)}")
    return Outcome(kind, stopped, notes)


FRAMES = 30
LATENCY_S = DELAY_S - 0.5 * 8330e-6
SKIPS_S = (-3600.0, -120.0, -5.0, -0.3, -0.05, 0.05, 0.3, 5.0, 120.0, 1.7e9)
CAMERAS = (
    "camera: unplugged",
    "camera: silent",
    "camera: no colour",
    "camera: lost frames",
    "camera: late",
    "camera: clock skips",
    "camera: unstamped",
)


def one_camera(kind: str, rng: np.random.Generator) -> Outcome:
    """A recording of `FRAMES` images, each with its number as its depth; the fault comes at one of them."""
    fake, at, count = FakeK4a("A1"), int(rng.integers(1, FRAMES)), int(rng.integers(1, 15))
    boot_s, skip_s = fake_k4a.BOOT_S, float(rng.choice(SKIPS_S))
    try:
        with running(fake, latency_s=LATENCY_S) as camera:
            camera.start_recording()
            start_s = fake.clock.now_s() + 0.01
            for i in range(FRAMES):
                during = at <= i < at + count
                if kind in CAMERAS[:2] and i == at:
                    for _ in range(1 if kind == CAMERAS[0] else 4):
                        fake.fail("unplugged" if kind == CAMERAS[0] else "timeout")
                    break
                if kind == "camera: clock skips" and i == at:
                    fake_k4a.BOOT_S = boot_s - skip_s
                if kind == "camera: lost frames" and during:
                    fake.clock.advance_to(start_s + i * PERIOD_S + DELAY_S)
                    continue
                fake.show(
                    Shown(
                        start_s + i * PERIOD_S,
                        late_s=0.2 if kind == "camera: late" and during else 0.0,
                        depth_mm=500 + i,
                        has_colour=not (
                            kind == "camera: no colour" and during and (i - at) % 4
                        ),  # four in a row: it is gone
                        stamped=not (kind == "camera: unstamped" and during),
                    )
                )
            try:
                film = _shown_meanwhile(fake, camera.stop_recording, kind in CAMERAS[:2])
            except HardwareError:
                return Outcome(kind, True, [])
    finally:
        fake_k4a.BOOT_S = boot_s
    if film is None:
        return Outcome(kind, True, ["the recording never ended"])
    numbers = [int(frame.depth_mm[0, 0]) - 500 for frame in film]
    off_s = [abs(frame.t_s - start_s - i * PERIOD_S) for i, frame in zip(numbers, film, strict=True)]
    notes = [f"a frame {max(off_s):.3f} s off (skip {skip_s:g} s, image {at})"] if max(off_s) > 0.02 else []
    whole = {i for i in numbers if i < FRAMES}
    if len(whole) < 0.7 * FRAMES:  # the driver counts those after them too
        notes.append(f"{FRAMES - len(whole)} of {FRAMES} images are missing and nothing is said")
    return Outcome(kind, len(whole) < FRAMES or max(off_s) > 1e-4, notes)


def _shown_meanwhile(fake: FakeK4a, ask: Callable[[], Any], is_gone: bool) -> Any:
    """What the camera answers while it shows more images; None: nothing after 90 of them."""
    fake.clock.asked.clear()
    with ThreadPoolExecutor(1) as pool:
        answer: Future[Any] = pool.submit(ask)
        fake.clock.asked.wait()
        for i in range(90):
            if is_gone or answer.done():
                return answer.result()
            fake.show(Shown(fake.clock.now_s() + 0.003, depth_mm=500 + FRAMES + i))
            wait([answer], 0.1)  # a busy computer
        fake.end()
        return None


def run(home: Path, lab: ToyLab) -> None:
    """One iteration of one particle, as `run-iteration --yes`."""
    settings = toy_session.resolved(home, particles=1)
    request = session_running.SessionRequest(None, frozenset({"task"}), 1, yes=True)
    session_running.run_session(
        settings, request, toy_rig.opener(lab), lambda store: store.folder, toy_session.silent()
    )


def completed(home: Path) -> dict[str, bytes]:
    """Every file of every completed trial."""
    root = home / "data" / "sessions"
    records = root.glob("*/iteration-01/*/trial.json")
    return {str(p.relative_to(root)): p.read_bytes() for record in records for p in sorted(record.parent.iterdir())}


CAMPAIGNS = ("cameras", "sessions", "motions")
MOTIONS = [
    *((kind, 1) for kind in IN_MOTION),
    *((kind, -1) for kind in BEFORE),
    *((kind, 0) for kind in BEFORE if kind != "arm: heavier"),
    *((kind, -1) for kind in (*TYPED, *HANDS, *DISKS)),
]
SESSIONS = (*SESSION_ERRORS, "session: killed")


def one(campaign: str, number: int, seed: int) -> dict[str, Any]:
    """What the fault of that number did: the kinds of a campaign in turn, each with a seed of its own."""
    rng = np.random.default_rng([seed, CAMPAIGNS.index(campaign), number])
    with tempfile.TemporaryDirectory() as folder:
        if campaign == "cameras":
            return asdict(one_camera(CAMERAS[number % len(CAMERAS)], rng))
        if campaign == "sessions":
            return asdict(one_session(SESSIONS[number % len(SESSIONS)], rng, Path(folder)))
        kind, when = MOTIONS[number % len(MOTIONS)]
        at = int(rng.integers(1, 650)) if when > 0 else when
        return asdict(one_motion(kind, at, ("panda", "fr3")[int(rng.integers(2))], rng, Path(folder)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=500, help="effective faults of motions")
    parser.add_argument("--cameras", type=int, default=60, help="effective faults of recordings")
    parser.add_argument("--sessions", type=int, default=60, help="effective faults of sessions")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    kept, found = Kept(asked.out), list[Outcome]()
    for campaign in CAMPAIGNS:
        effective = number = 0
        while effective < getattr(asked, campaign):
            found.append(Outcome(**kept.row(campaign, number, partial(one, campaign, number, asked.seed))))
            effective, number = effective + found[-1].effective, number + 1
            if len(found) % 50 == 0:
                tell(found)
    tell(found)
    for kind in dict.fromkeys(outcome.kind for outcome in found):
        mine = [outcome for outcome in found if outcome.kind == kind]
        slowest = max(outcome.stop_s for outcome in mine)
        rest = f", at rest within {slowest:.3f} s" if slowest else ""
        sys.stdout.write(f"{kind}: {sum(o.effective for o in mine)} of {len(mine)} effective{rest}\n")
    broken = [f"{one.kind}: {note}" for one in found for note in one.wrong]
    sys.stdout.write("".join(f"WRONG {text}\n" for text in broken))
    return 1 if broken else 0


def tell(found: list[Outcome]) -> None:
    effective, broken = sum(one.effective for one in found), sum(bool(one.wrong) for one in found)
    sys.stdout.write(f"{len(found)} faults, {effective} effective, {broken} broke a promise\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
