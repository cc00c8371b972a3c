"""Players without a process: one that drives no arm and needs no time, and one that plays an SDK's fake."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import repeat
from typing import Any

import numpy as np
from cells import READY, cell
from clocks import FakeClock
from numpy.typing import ArrayLike
from sdk_fake import FakeSdk
from torque_errors import estimate_errors_Nm

from hw.collision import BARE_HAND, Tool
from hw.franka import connection, player
from hw.franka.arm import FrankaArm
from hw.franka.driver import FAULT, Failure, Reading
from hw.franka.identity import ArmReport
from hw.franka.playback import PlayableMotion, Played, PlayOutcome
from hw.franka.settings import FrankaSettings, Payload
from hw.ports import Pedal
from hw.types import Array, JointPath
from hw.watchdog import WHY
from hw.workcell import Workcell

SETTINGS = FrankaSettings("172.16.0.2")


@dataclass
class InstantPlayer:
    """A player that plays a path by being at its end, and keeps what it is given. Its clock moves on meanwhile.

    `faults` maps the number of a motion (from 1) to what stops it half way: an error of the arm, or an interruption.
    """

    q_rad: Array = field(default_factory=lambda: READY)
    held_off_rad: Array = field(default_factory=lambda: np.zeros(7))
    mode: str = "Idle"
    alive: bool = True
    notes: tuple[str, ...] = ()
    clock: FakeClock = field(default_factory=FakeClock)
    faults: Mapping[int, str | KeyboardInterrupt] = field(default_factory=dict)
    rates: Iterator[float] = field(default_factory=lambda: repeat(1.0))  # share of the commands in time, per motion
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

    def play(self, motion: PlayableMotion, word: Callable[[], bytes]) -> PlayOutcome:
        self.given.append(motion)
        self.collects_garbage = gc.isenabled()
        fault = self.faults.get(len(self.given))
        if isinstance(fault, KeyboardInterrupt):
            raise fault
        last = len(motion.path.t_s) if fault is None else len(motion.path.t_s) // 2
        t_s, q = motion.path.t_s[:last], motion.path.q_rad[:last]
        clock_s = self.clock.now_s() + t_s
        self.clock.sleep(float(t_s[-1]))
        self.q_rad, self.held_off_rad = q[-1], np.zeros(7)
        played = Played(t_s, clock_s, q, q, np.zeros_like(q), 1.0, next(self.rates))
        return PlayOutcome(played, None if fault is None else Failure(FAULT, fault))

    def close(self) -> None:
        self.alive = False


class InstantArm(FrankaArm):
    """The real arm's class over a player that needs no time; `cell` decides which motions it refuses."""

    def __init__(
        self,
        q_rad: ArrayLike,
        cell: Workcell,
        clock: FakeClock | None = None,
        *,
        settings: FrankaSettings | None = None,
        **player: Any,
    ) -> None:
        """It stands at `q_rad` (7,); `player` are further fields of `InstantPlayer`."""
        clock = FakeClock() if clock is None else clock
        self.player = InstantPlayer(np.asarray(q_rad, dtype=np.float64), clock=clock, **player)
        super().__init__(cell, settings or SETTINGS, self._begun, now_s=clock.now_s)

    def _begun(self) -> InstantPlayer:
        self.player.alive = True
        return self.player

    @property
    def executed(self) -> list[JointPath]:
        """The paths that were begun, oldest first."""
        return [motion.path for motion in self.player.given]

    @property
    def carried(self) -> list[Payload]:
        """All loads that were set, oldest first."""
        return self.player.carried


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

    def play(self, motion: PlayableMotion, word: Callable[[], bytes]) -> PlayOutcome:
        return player.play(self.driver, motion, _Told(word), start_s=600.0)  # type: ignore[arg-type]

    def close(self) -> None:
        self.alive = False


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
