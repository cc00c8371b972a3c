"""A Franka arm behind `hw.ports.Arm`: what is refused, what is asked of the player process, what a failure means.

Times are `time.monotonic()`, which all processes of a computer share.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol, Self

import numpy as np

from hw.collision import BARE_HAND, LEVEL, KeepOut, Table, Tool
from hw.errors import ArmFault, DeviceUnavailable, MotionRefused, StoppedByPedal
from hw.franka import reflexes
from hw.franka.driver import LOST, UNAVAILABLE, Failure, Reading
from hw.franka.messages import ALIVE, PEDAL, REQUESTED, Outcome, Timing
from hw.franka.playback import Motion, motion_of
from hw.franka.process import PlayerProcess
from hw.franka.settings import FrankaSettings
from hw.franka.stops import StopReport, stop_report
from hw.limits import START_TOLERANCE_RAD
from hw.refusal import refuse_unless_safe
from hw.types import ArmState, Array, Execution, JointPath, frozen_array

FADE_S = 0.5
SAME_RAD = 1e-6
"""States come in single precision: the held joints may differ by as much from what was commanded last."""

_WHY = {
    "pedal": "the enabling pedal was released",
    "request": "a stop was requested",
    "silence": "the program was silent for too long",
    "orphaned": "the program ended",
}
_THEN = "look at the arm and recover it, then redo the trial"


class Pedal(Protocol):
    """What is asked of an enabling pedal (`hw.serial.enable_pedal.EnablePedal`)."""

    def enabled(self) -> bool: ...
    def why_not(self) -> str: ...


class Player(Protocol):
    """What is asked of the process that plays motions (`hw.franka.process.PlayerProcess`). All raise Failure."""

    @property
    def alive(self) -> bool: ...
    def reading(self) -> Reading: ...
    def recover(self) -> Reading: ...
    def play(self, motion: Motion, word: Callable[[], bytes]) -> Outcome: ...
    def close(self) -> None: ...


class FrankaArm:
    """`hw.ports.Arm`. `open_franka` makes one.

    `last_execution` and `last_stop` tell of the last motion, stopped ones included.
    """

    def __init__(
        self,
        model: str,
        settings: FrankaSettings,
        start: Callable[[], Player],
        *,
        tool: Tool = BARE_HAND,
        keep_out: tuple[KeepOut, ...] = (),
        table: Table = LEVEL,
        pedal: Pedal | None = None,
    ) -> None:
        self._table = table
        self._model, self._settings, self._start = model, settings, start
        self._tool, self._keep_out, self._pedal = tool, keep_out, pedal
        self._player: Player | None = None
        self._entered = False
        self._fault: str | None = None
        self._stop = threading.Event()
        self.last_execution: Execution | None = None
        self.last_stop: StopReport | None = None

    @property
    def model(self) -> str:
        return self._model

    def __enter__(self) -> Self:
        """Start the player and connect. Raises DeviceUnavailable."""
        self._entered = True
        try:
            self._connected()
        except DeviceUnavailable:
            self._entered = False
            raise
        return self

    def __exit__(self, *exc: object) -> None:
        self._entered = False
        if self._player is not None:
            self._player.close()
            self._player = None

    def state(self) -> ArmState:
        """Measured joints; `fault` also says why the arm would not move (joints locked, stop button, reflex)."""
        reading = self._reading()
        return ArmState(
            time.monotonic(),
            frozen_array(reading.q_rad, (7,), "q_rad"),
            frozen_array(reading.dq_rad_s, (7,), "dq_rad_s"),
            self._fault or _unwilling(reading),
        )

    def execute(self, path: JointPath) -> Execution:
        """Play `path` and return at rest.

        Raises MotionRefused, ArmFault or StoppedByPedal; the two last with the way to standstill where it was braked.
        """
        reading = self._reading()
        refuse_unless_safe(
            path,
            self._model,
            frozen_array(reading.q_rad),
            fault=self._fault or _unwilling(reading),
            keep_out=self._keep_out,
            tool=self._tool,
            table=self._table,
            collision_N=self._settings.collision.contact_force_limit_N,
        )
        motion = motion_of(self._from_held(path, frozen_array(reading.q_held_rad)), self._model)
        if self._pedal is not None and not self._pedal.enabled():
            raise MotionRefused(
                f"{self._model}: {self._pedal.why_not()}; nothing has moved, hold the pedal and try again"
            )
        self._stop.clear()
        self.last_execution = self.last_stop = None
        return self._play(motion)

    def stop(self) -> None:
        """Ask the running motion to brake along its path; `execute` then raises ArmFault. From any thread."""
        self._stop.set()

    def recover(self) -> None:
        """Clear a fault, with a new player where the old one is gone. Never resumes a motion.

        Raises ArmFault if the arm needs a person first, DeviceUnavailable if it cannot be reached.
        """
        player = self._connected()
        try:
            reading = player.recover()
        except Failure as failure:
            raise self._error(failure) from failure
        unwilling = _unwilling(reading)
        if unwilling is not None:
            self._fault = unwilling
            raise ArmFault(f"{self._model} does not recover: {unwilling}")
        self._fault = None

    def _play(self, motion: Motion) -> Execution:
        assert self._player is not None
        try:
            outcome = self._player.play(motion, self._word)
        except Failure as failure:
            raise self._error(failure, moving=True) from failure
        except BaseException:  # Ctrl-C: the player hears no word any more and brakes
            self._fault = "the program was interrupted during a motion"
            self._drop_player()
            raise
        played = outcome.played
        t_start_s = float(played.clock_s[0]) if len(played.t_s) else time.monotonic()
        execution = Execution(t_start_s, played.t_s, played.q_commanded_rad, played.q_measured_rad, played.success_rate)
        self.last_execution, self.last_stop = execution, stop_report(played)
        if outcome.failure is not None:
            raise self._error(outcome.failure, moving=True, after_s=float(played.t_s[-1]) if len(played.t_s) else 0.0)
        if self.last_stop is not None:
            self._fault = _WHY[self.last_stop.why]
            kind = StoppedByPedal if self.last_stop.why == "pedal" else ArmFault
            raise kind(f"{self._model}: {self._fault} {self.last_stop}; {_THEN}")
        return execution

    def _word(self) -> bytes:
        if self._stop.is_set():
            return REQUESTED
        return PEDAL if self._pedal is not None and not self._pedal.enabled() else ALIVE

    def _from_held(self, path: JointPath, q_held_rad: Array) -> JointPath:
        """`path`, begun at the joints that the arm's controller holds: a jump would be an error to the arm.

        The difference is a bending of the arm under load; it fades over `FADE_S`, and what results is checked again.
        """
        off = q_held_rad - path.q_rad[0]
        if np.abs(off).max() <= SAME_RAD:
            return path
        if np.abs(off).max() > START_TOLERANCE_RAD:
            joint = int(np.abs(off).argmax())
            raise MotionRefused(
                f"{self._model}: distance from the arm of joint {joint + 1}, as its controller holds it, is "
                f"{abs(off[joint]):.4g} rad, limit {START_TOLERANCE_RAD:g} rad; nothing has moved, plan from there"
            )
        u = np.minimum(path.t_s / min(FADE_S, path.duration_s), 1.0)
        left = 1.0 - u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
        faded = JointPath(path.t_s, path.q_rad + left[:, None] * off, path.contact)
        refuse_unless_safe(
            faded, self._model, q_held_rad, fault=None, keep_out=self._keep_out, tool=self._tool, table=self._table
        )
        return faded

    def _reading(self) -> Reading:
        try:
            return self._connected().reading()
        except Failure as failure:
            raise self._error(failure) from failure

    def _connected(self) -> Player:
        """The player, a new one where the last has ended. Raises DeviceUnavailable."""
        if not self._entered:
            raise DeviceUnavailable(f"the {self._model} is not connected: enter it with `with` first")
        if self._player is not None and not self._player.alive:
            self._fault = self._fault or "the process that plays motions has ended"
            self._drop_player()
        if self._player is None:
            try:
                self._player = self._start()
            except Failure as failure:
                raise DeviceUnavailable(failure.text) from failure
        return self._player

    def _error(self, failure: Failure, *, moving: bool = False, after_s: float | None = None) -> Exception:
        """What to raise for a failure; one during a motion is a fault that lasts until `recover`."""
        if failure.kind in (LOST, UNAVAILABLE):
            self._drop_player()  # a connection that broke stays broken: the next call makes a new one
        if not moving:
            return (
                ArmFault(failure.text) if failure.kind not in (LOST, UNAVAILABLE) else DeviceUnavailable(failure.text)
            )
        self._fault = failure.text
        when = "during the motion" if after_s is None else f"{after_s:.3f} s into the path"
        return ArmFault(f"{self._model} stopped {when}: {failure.text}; {_THEN}")

    def _drop_player(self) -> None:
        if self._player is not None:
            self._player.close()
            self._player = None


def _unwilling(reading: Reading) -> str | None:
    """Why the arm would not move, or None."""
    words = reflexes.of_mode(reading.mode)
    return "; ".join(filter(None, (words, reflexes.in_words(reading.reasons)))) or None


def open_franka(
    model: str,
    settings: FrankaSettings,
    *,
    tool: Tool = BARE_HAND,
    keep_out: tuple[KeepOut, ...] = (),
    table: Table = LEVEL,
    pedal: Pedal | None = None,
) -> FrankaArm:
    """The arm of `model` ("panda" or "fr3") at `settings.host`; entering it connects.

    With a pedal no motion begins unless it is held, and letting go of it stops the one that runs.
    """
    return franka(model, settings, Timing(), tool=tool, keep_out=keep_out, table=table, pedal=pedal)


def franka(
    model: str,
    settings: FrankaSettings,
    timing: Timing,
    *,
    tool: Tool = BARE_HAND,
    keep_out: tuple[KeepOut, ...] = (),
    table: Table = LEVEL,
    pedal: Pedal | None = None,
) -> FrankaArm:
    """`open_franka` for tests and benchmarks over a simulator, which relax `timing`."""
    if model not in ("panda", "fr3"):
        raise ValueError(f"{model!r} is no Franka arm that can be driven: panda or fr3")
    return FrankaArm(
        model,
        settings,
        lambda: PlayerProcess(model, settings, timing),
        tool=tool,
        keep_out=keep_out,
        table=table,
        pedal=pedal,
    )
