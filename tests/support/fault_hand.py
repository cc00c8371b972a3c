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
from rich.console import Console

from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.devices.released import ReleasedHand
from adaptsim_cli.errors import CliError
from adaptsim_cli.screen.console import Screen
from hw.child import Call, Child, ChildGone
from hw.errors import HardwareError
from hw.fake import FakeArm, FakeClock
from hw.franka.hand_keeper import Keeper
from hw.franka.hand_process import HandProcess
from hw.ports import Pedal
from hw.serial.pedal_protocol import line_for
from hw.types import HandState
from hw.watchdog import SILENCE_S, Watchdog

FINGERS_M_S = 0.03
STILL_S = 0.09
"""From a fault to fingers that stand still: what the documents promise (80 ms), and what the pedal's line may take."""


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
    moved_at_ms: int = 0
    cycles: int = 0

    def send(self, call: Call) -> None:
        self.wanted_m = float(call.arguments[0]) if call.arguments else self.width_m
        self.cycles = 0

    def answers(self, within_s: float) -> bool:
        for _ in range(max(round(1e3 * within_s), 1)):
            self.cycles += 1
            self.world.cycle(self.cycles)
            if self.gone:
                raise ChildGone("killed by signal 9")
            moving = not self.stopped and abs(self.wanted_m - self.width_m) > 1e-9
            if moving:
                step_m = np.clip(self.wanted_m - self.width_m, -1e-3 * FINGERS_M_S, 1e-3 * FINGERS_M_S)
                self.width_m, self.moved_at_ms = self.width_m + float(step_m), self.world.t_ms
            elif not self.stuck or not self.stopped:
                return True
        return False

    def receive(self) -> HandState:
        return HandState(self.width_m, holds=False, homed=True)

    def kill(self) -> None:
        self.stopped = True

    def stop(self) -> None:
        if self.deaf:
            raise RuntimeError("libfranka gripper: command failed!")
        self.stopped = True


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

    def tell(self, word: bytes) -> None: ...

    def close(self) -> None: ...


@contextmanager
def connected(world: World, fingers: Fingers) -> Iterator[HandProcess]:
    """The program's hand, connected to the fingers in simulated time."""
    hand = HandProcess("fr3", "hand.test", pedal=cast(Pedal, world))
    ends = os.pipe()
    world.pipe, world.word = ends, hand._word
    listener = Watchdog(ends[0], SILENCE_S, world.now_s)
    keeper = Keeper("hand.test", listener, cast(Child, fingers), fingers.stop)
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


HAND_FAULTS: dict[str, Fault] = {
    "fingers: pedal released": release,
    "fingers: pedal silent": silent_pedal,
    "fingers: program hangs": hanging,
    "fingers: program killed": killed,
    "fingers: computer suspended": slept,
    "fingers: worker ends": ended,
    "fingers: stop refused": refusing,
    "fingers: worker hangs": sticking,
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
    arm: Any = FakeArm(READY, FakeClock(), cell("fr3"))

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
            hand = ReleasedHand(bare, confirmed.release, confirmed.await_pedal)
            world.fire(lambda due: due < 0)
            world.pass_ms(100 * before)
            start_ms = world.t_ms
            error = raised(lambda: hand.move(0.002 if rng.random() < 0.5 else 0.01))
            if before and fingers.width_m < 0.08:
                notes.append("the fingers moved")
            fault_ms = start_ms + at if at > 0 else start_ms
            still_s = max(fingers.moved_at_ms - fault_ms, 0) / 1e3 if error is not None else 0.0
            if still_s > STILL_S:
                notes.append(f"the fingers moved for {still_s:.3f} s after the fault")
            if error is not None and not before and not fingers.stopped:
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


def raised(act: Callable[[], None]) -> BaseException | None:
    try:
        act()
    except (HardwareError, CliError) as error:
        return error
    return None
