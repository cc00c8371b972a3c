"""The hand under faults: the program's keeper, pedal and consent in simulated time; the fingers move at 30 mm/s."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from cells import READY, cell
from fault_lab import TYPED, Outcome
from fault_world import Fault, World, hanging, killed, release, silent_pedal, slept
from players import InstantArm
from rich.console import Console

from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.devices.released import ReleasedHand
from adaptsim_cli.errors import CliError
from adaptsim_cli.screen.console import Screen
from hw.child import Call, Child, ChildGone
from hw.errors import ArmFault, FingersMoved, HardwareError
from hw.franka.hand_keeper import Keeper
from hw.franka.hand_process import HandProcess
from hw.franka.hand_stop import Widths
from hw.ports import Pedal
from hw.serial.pedal_protocol import line_for
from hw.types import HandState, JointPath
from hw.watchdog import SILENCE_S, Watchdog

FINGERS_M_S = 0.03
STILL_S = 0.09
"""From a fault to fingers that stand still: what the documents promise (80 ms), and what the pedal's line may take."""
COASTED_M = 0.0035
"""A hand that moved farther after its stop was not stopped by it: 0.1 s at its speed, and a reading."""
WATCHED_S = 0.4
"""The longest time until a hand that goes on is told again."""
STILL = JointPath(np.arange(5) / 1000, np.tile(READY, (5, 1)))


@dataclass
class Fingers:
    """`hw.child.Child`: the worker that moves the fingers, which an SDK blocks until they stand."""

    world: World
    width_m: float = 0.08
    wanted_m: float = 0.08
    stopped: bool = False
    gone: bool = False  # the process has ended
    deaf: bool = False  # the SDK refuses the stop
    stuck: bool = False  # the worker does not end with the stop
    ignores: bool = False  # the hand accepts the stop, and its fingers go on
    moved_at_ms: int = 0
    cycles: int = 0
    stops: int = 0
    asked_m: float = 0.0  # the width at the first stop
    widths: list[tuple[float, float]] = field(default_factory=list)  # since they were last read

    def send(self, call: Call) -> None:
        self.wanted_m = float(call.arguments[0]) if call.arguments else self.width_m
        self.cycles = 0

    def answers(self, within_s: float) -> bool:
        for _ in range(max(round(1e3 * within_s), 1)):
            moving = self.step()
            if self.gone:
                raise ChildGone("killed by signal 9")
            if not moving and (not self.stuck or not self.stopped):
                return True
        return False

    def step(self) -> bool:
        """A millisecond; whether the fingers moved in it."""
        self.cycles += 1
        self.world.cycle(self.cycles)
        moving = not self.stopped and not self.gone and abs(self.wanted_m - self.width_m) > 1e-9
        if moving:
            step_m = np.clip(self.wanted_m - self.width_m, -1e-3 * FINGERS_M_S, 1e-3 * FINGERS_M_S)
            self.width_m, self.moved_at_ms = self.width_m + float(step_m), self.world.t_ms
        self.widths.append((self.world.now_s(), self.width_m))
        return moving

    def read(self, for_s: float) -> Widths:
        """`hw.franka.hand_stop.Reader`."""
        for _ in range(round(1e3 * for_s)):
            self.step()
        rows, self.widths = self.widths, []
        return rows

    def receive(self) -> HandState:
        return HandState(self.width_m, holds=False, homed=True)

    def kill(self) -> None:
        self.stopped = not self.ignores

    def stop(self) -> None:
        if self.deaf:
            raise RuntimeError("libfranka gripper: command failed!")
        self.stops += 1
        self.asked_m = self.width_m if self.stops == 1 else self.asked_m
        self.stopped = not self.ignores


@dataclass
class KeeperChild:
    """`hw.child.Child`: the keeper's process, in the program's own."""

    keeper: Keeper
    call: Call = field(default_factory=lambda: Call("state"))

    def send(self, call: Call) -> None:
        self.call = call

    def answers(self, within_s: float) -> bool:
        self.answer = self.keeper.ask(self.call)
        return True

    def receive(self) -> Any:
        return self.answer

    def send_word(self, word: bytes) -> None: ...

    def close(self) -> None: ...


@contextmanager
def connected(world: World, fingers: Fingers) -> Iterator[HandProcess]:
    """The program's hand, connected to the fingers in simulated time."""
    hand = HandProcess("fr3", "hand.test", pedal=cast(Pedal, world))
    ends = os.pipe()
    world.pipe, world.word = ends, hand._word
    listener = Watchdog(ends[0], SILENCE_S, world.now_s)
    keeper = Keeper("hand.test", listener, cast(Child, fingers), fingers.stop, lambda: fingers, world.now_s)
    hand._child = cast(Child, KeeperChild(keeper))
    try:
        yield hand
    finally:
        for end in ends:
            with suppress(OSError):
                os.close(end)


def ended(world: World) -> None:
    world.sdk.gone = True  # the fingers go on until somebody stops them


def refusing(world: World) -> None:
    world.sdk.deaf = True
    release(world)


def sticking(world: World) -> None:
    world.sdk.stuck = True
    release(world)


def ignoring(world: World) -> None:
    world.sdk.ignores = True
    release(world)


IGNORED = "fingers: stop ignored"
HAND_FAULTS: dict[str, Fault] = {
    "fingers: pedal released": release,
    "fingers: pedal silent": silent_pedal,
    "fingers: program hangs": hanging,
    "fingers: program killed": killed,
    "fingers: computer suspended": slept,
    "fingers: worker ends": ended,
    "fingers: stop refused": refusing,
    "fingers: worker hangs": sticking,
    IGNORED: ignoring,
    "fingers: pedal up before": release,
    "fingers: no consent": lambda world: None,
}


def one_hand(kind: str, rng: np.random.Generator) -> Outcome:
    """A motion of the fingers over their whole travel, with one fault in it or before it."""
    before = kind in ("fingers: pedal up before", "fingers: no consent")
    at = -1 if before else int(rng.integers(1, 2400))
    world = World(((at, HAND_FAULTS[kind]),))
    fingers = Fingers(world)
    world.sdk = fingers
    consent = Consent(Screen(console=Console(file=io.StringIO(), markup=False)), "fr3", operator="Kim", pedal=True)
    pedal = cast(Pedal, world)
    arm: Any = InstantArm(READY, cell("fr3"))

    def wait(_: float) -> None:
        world.pass_ms(20)

    confirmed = ConfirmedArm(arm, consent, pedal, now_s=world.now_s, pause=wait)
    world.box = lambda count: line_for(count, count > 5)
    world.pass_ms(200)
    world.box = lambda count: line_for(count, True)
    typed = str(rng.choice(list(TYPED.values()))) if kind == "fingers: no consent" else "fr3\ny\n"
    stdin, sys.stdin = sys.stdin, io.StringIO(typed)
    notes: list[str] = []
    try:
        with confirmed, connected(world, fingers) as bare:
            hand = ReleasedHand(bare, confirmed.release, confirmed.await_pedal, confirmed.hand_moving)
            world.fire(lambda due: due < 0)
            world.pass_ms(100 * before)
            start_ms = world.t_ms
            wanted_m = 0.002 if rng.random() < 0.5 else 0.01
            error = raised(lambda: hand.move(wanted_m))
            if before and fingers.width_m < 0.08:
                notes.append("the fingers moved")
            fault_ms = start_ms + at if at > 0 else start_ms
            still_s = max(fingers.moved_at_ms - fault_ms, 0) / 1e3 if error is not None else 0.0
            if kind == IGNORED:
                notes += misjudged(fingers, error, wanted_m, confirmed)
            elif still_s > STILL_S:
                notes.append(f"the fingers moved for {still_s:.3f} s after the fault")
            if error is not None and not before and not fingers.stopped and kind != IGNORED:
                notes.append("nobody stopped the fingers")
            if error is not None and not before and kind != "fingers: program killed":
                width_m = fingers.width_m
                fingers.stopped = fingers.gone = fingers.stuck = False
                world.words, world.box = True, lambda count: line_for(count, count % 50 > 2)
                world.pass_ms(1500)
                if raised(lambda: bare.move(0.05)) is None or fingers.width_m != width_m:
                    notes.append("a stopped hand moved without a new connection")
    finally:
        sys.stdin = stdin
    return Outcome(kind, error is not None, notes, still_s, "hand")


def misjudged(fingers: Fingers, error: BaseException | None, wanted_m: float, arm: ConfirmedArm) -> list[str]:
    """What is wrong with what was said and done of a hand that goes on after its stop."""
    if error is None or not fingers.stops:
        return []  # it had arrived before
    said, way_m = str(error), fingers.asked_m - fingers.width_m
    notes = ["a hand that went on is said to have stopped"] if "was stopped" in said and way_m > COASTED_M else []
    if isinstance(error, FingersMoved):
        notes += [] if f"then {1e3 * wanted_m:.1f} mm" in said else [f"the last width is not said: {said}"]
        arrived = way_m <= FINGERS_M_S * WATCHED_S  # within the first look, so nothing was left to stop
        notes += [] if fingers.stops > 1 or arrived else ["it was not stopped again"]
        notes += [] if arm.state().fault else ["the arm is not latched"]
        notes += [] if isinstance(raised(lambda: arm.execute(STILL)), ArmFault) else ["the arm moved after it"]
        arm.recover()
        notes += [] if arm.state().fault is None else ["the recovery did not end the latch"]
    return notes


def raised(act: Callable[[], object]) -> BaseException | None:
    try:
        act()
    except (HardwareError, CliError) as error:
        return error
    return None
