"""A real lab's arm in simulated time, and everything that may go wrong with it: the stage of `benchmarks/faults.py`.

Consent, pedal protocol, checks, player and the pipe between them are the program's own; only the SDK is a stand-in
(`living_sdk`). A fault is a function of the `World`; several may come in one motion, each at its own millisecond.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from players import InProcess
from sdk_fake import NetworkException

from hw.franka import player
from hw.franka.playback import PlayOutcome
from hw.serial.pedal_protocol import PedalState, line_for
from hw.watchdog import SILENCE_S, Watchdog

WORD_EVERY, LINE_EVERY = 5, 20
Fault = Callable[["World"], None]


@dataclass
class World:
    """Simulated milliseconds, the pedal's box, the program's words, and faults at some of them."""

    faults: tuple[tuple[int, Fault], ...] = ()
    """(ms into the motion, fault); negative: before it is checked; 0: between the check and the motion."""
    t_ms: int = 0
    asleep_s: float = 0.0
    box: Callable[[int], bytes] = lambda count: line_for(count, True)
    words: bool = True  # the program lives and speaks
    pedal: PedalState = field(default_factory=PedalState)
    lines: int = 0
    fired: list[int] = field(default_factory=list)  # how many commands the arm had got at each fault
    commands: int = 0
    now_at: int = 0  # ms of the running motion
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

    def fire(self, due: Callable[[int], bool]) -> None:
        """Every fault that is due and has not come yet."""
        for at, fault in self.faults[len(self.fired) :]:
            if not due(at):
                return
            self.fired.append(self.commands)
            fault(self)

    def cycle(self, cycle: int) -> None:
        """A millisecond of a motion."""
        self.pass_ms()
        self.commands, self.now_at = self.commands + 1, cycle
        self.fire(lambda at: 0 < at <= cycle)
        if self.words and self.pipe[1] >= 0 and cycle % WORD_EVERY == 0:
            os.write(self.pipe[1], self.word())


class SimulatedPlayer(InProcess):
    """The player's own loop and listener over a pipe, in simulated time."""

    world: World

    def play(self, motion: Any, word: Callable[[], bytes]) -> PlayOutcome:
        world, ends = self.world, os.pipe()
        world.pipe, world.word = ends, word
        world.fire(lambda at: at <= 0)
        try:
            return player.play(self.driver, motion, Watchdog(ends[0], SILENCE_S, world.now_s), 1e9)
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
    world.sdk.feels = lambda q: [0.0, 9.0, 0.0, -6.0, 0.0, 1.0, 0.0]


def dead_estimate(world: World) -> None:
    world.sdk.stuck_Nm = (0.0,) * 7


def frozen_estimate(world: World) -> None:
    world.sdk.stuck_Nm = (0.4, -1.1, 0.3, 0.8, -0.1, 0.2, 0.05)


def lost_cycles(world: World) -> None:
    world.sdk.lost_cycles = tuple(range(world.now_at + 1, world.now_at + 40, 2))


def gap(world: World) -> None:
    world.sdk.gaps = {world.now_at + 1: 21 + 37 * (world.t_ms % 23)}


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


IN_MOTION: dict[str, Fault] = {
    "arm: reflex": reflex,
    "arm: stop button": user_stop,
    "arm: network": network,
    "arm: nonsense": nonsense,
    "arm: lost cycles": lost_cycles,
    "arm: gap": gap,
    "pedal: released": release,
    "pedal: silent": silent_pedal,
    "pedal: garbled": garbled,
    "pedal: restarted": restarted_box,
    "process: stop()": stop_wanted,
    "process: hangs": hanging,
    "process: killed": killed,
    "clock: suspended": slept,
}
BEFORE: dict[str, Fault] = {
    "arm: reflex": reflex,
    "arm: stop button": user_stop,
    "arm: guided": guiding,
    "arm: network": network,
    "arm: moved": moved,
    "arm: heavier": heavier,
    "arm: dead torque estimate": dead_estimate,
    "arm: frozen torque estimate": frozen_estimate,
    "pedal: released": release,
    "pedal: silent": silent_pedal,
    "process: stop()": stop_wanted,
    "clock: suspended": slept,
}
ESTIMATES = {"arm: dead torque estimate", "arm: frozen torque estimate"}
SILENT = {"pedal: silent", "pedal: garbled", "process: hangs", "clock: suspended"}
BY_THE_ARM = {"arm: reflex", "arm: stop button", "arm: network"}
LOSING = {"arm: lost cycles", "arm: gap"}
"""After these the commands are no longer a millisecond apart."""
