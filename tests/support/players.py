"""Players without a process: one that drives no arm and counts, and one that plays the driver of an SDK's fake here."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from cells import READY, cell
from sdk_fake import FakeSdk

from hw.collision import BARE_HAND, Tool
from hw.contact import estimate_errors_Nm
from hw.franka import connection, player
from hw.franka.arm import FrankaArm
from hw.franka.driver import Reading
from hw.franka.identity import ArmReport
from hw.franka.playback import PlayableMotion, Played, PlayOutcome
from hw.franka.settings import FrankaSettings, Payload
from hw.ports import Pedal
from hw.types import Array, Guard
from hw.watchdog import WHY


@dataclass
class Sink:
    """A player that keeps what it is given and says that it was played."""

    q_rad: Array = field(default_factory=lambda: READY)
    held_off_rad: Array = field(default_factory=lambda: np.zeros(7))
    mode: str = "Idle"
    alive: bool = True
    notes: tuple[str, ...] = ()
    given: list[PlayableMotion] = field(default_factory=list)
    carried: list[Payload] = field(default_factory=list)
    collects_garbage: bool = False  # while it played
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def reading(self) -> Reading:
        estimate_Nm = tuple(estimate_errors_Nm(self.q_rad, self.rng).tolist())
        return Reading(
            tuple(self.q_rad), tuple(self.q_rad + self.held_off_rad), (0.0,) * 7, self.mode, external_Nm=estimate_Nm
        )

    def report(self) -> ArmReport:
        return ArmReport()

    def recover(self) -> Reading:
        return self.reading()

    def carry(self, payload: Payload) -> Reading:
        self.carried.append(payload)
        return self.reading()

    def play(self, motion: PlayableMotion, word: Callable[[], bytes], guard: Guard | None = None) -> PlayOutcome:
        self.given.append(motion)
        self.collects_garbage = gc.isenabled()
        q = motion.path.q_rad
        self.q_rad, self.held_off_rad = q[-1], np.zeros(7)
        return PlayOutcome(Played(motion.path.t_s, motion.path.t_s, q, q, np.zeros_like(q), 1.0, 1.0))

    def close(self) -> None:
        self.alive = False


@dataclass
class ReportedState:
    """What the arm reports; it follows a command at the next cycle."""

    q: list[float] = field(default_factory=READY.tolist)
    dq: list[float] = field(default_factory=lambda: [0.0] * 7)
    q_d: list[float] = field(default_factory=READY.tolist)
    tau_ext_hat_filtered: list[float] = field(default_factory=lambda: [0.0] * 7)
    control_command_success_rate: float = 1.0


@dataclass
class _Told:
    """What the program says, heard without a pipe."""

    word: Callable[[], bytes]

    def begin(self) -> None: ...

    def stop_reason(self) -> str:
        return WHY.get(self.word(), "")


@dataclass
class InProcess:
    """`hw.franka.process.Player` around a driver."""

    driver: connection.Connection
    alive: bool = True
    notes: tuple[str, ...] = ()

    def reading(self) -> Reading:
        return self.driver.reading()

    def report(self) -> ArmReport:
        return self.driver.report()

    def recover(self) -> Reading:
        self.driver.recover()
        return self.driver.reading()

    def carry(self, payload: Payload) -> Reading:
        self.driver.carry(payload)
        return self.driver.reading()

    def play(self, motion: PlayableMotion, word: Callable[[], bytes], guard: Guard | None = None) -> PlayOutcome:
        return player.play(self.driver, motion, _Told(word), guard, start_s=600.0)  # type: ignore[arg-type]

    def close(self) -> None:
        self.alive = False


SETTINGS = FrankaSettings("172.16.0.2")


def driver_of(sdk: FakeSdk, model: str = "panda", settings: FrankaSettings = SETTINGS) -> connection.Connection:
    return connection.Connection(model, sdk, connection.DRIVES[model], settings, realtime=True, clock=sdk.clock)


def arm_of(
    sdk: FakeSdk,
    model: str = "panda",
    settings: FrankaSettings = SETTINGS,
    *,
    tool: Tool = BARE_HAND,
    pedal: Pedal | None = None,
    player: type[InProcess] = InProcess,
) -> FrankaArm:
    """The arm of `cell(model, tool)` over an SDK's fake."""
    return FrankaArm(cell(model, tool), settings, lambda: player(driver_of(sdk, model, settings)), pedal=pedal)
