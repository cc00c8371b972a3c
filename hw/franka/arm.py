"""A Franka arm behind `hw.ports.Arm`: it checks motions, sends them to the player, and interprets failures.

Times are `time.monotonic()`, which all processes of a computer share.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Self

import numpy as np

from hw.collision import Tool
from hw.errors import ArmFault, DeviceUnavailable, MotionRefused, StoppedByPedal
from hw.franka.driver import LOST, UNAVAILABLE, UNMOVED, Failure, Reading
from hw.franka.identity import TITLES, identify, narrowed, unsure
from hw.franka.motions import READINGS, WHY, StopReport, arm_stop, from_held, require_declared, stop_report
from hw.franka.playback import PlayableMotion, Timing, motion_of
from hw.franka.process import Player, PlayerProcess
from hw.franka.sense import ForceSense
from hw.franka.settings import FrankaSettings, Payload
from hw.ports import Pedal
from hw.types import ArmState, Execution, JointPath, frozen_array
from hw.watchdog import ALIVE, PEDAL, REQUESTED
from hw.workcell import Workcell, refuse_while_stopped

__all__ = ["FrankaArm", "Pedal", "Player", "franka", "open_franka"]

_THEN = "look at the arm and recover it, then redo the trial"
_LATCHED = "no motion begins before a recovery, to which the same command leads you"


class FrankaArm:
    """`hw.ports.Arm`. `open_franka` makes one.

    `last_execution` and `last_stop` describe the last motion, stopped or not.
    """

    def __init__(
        self,
        cell: Workcell,
        settings: FrankaSettings,
        start: Callable[[], Player],
        *,
        pedal: Pedal | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`now_s` is the clock of all times. Raises ValueError if `cell` and `settings` state different forces at which
        the arm stops by itself.
        """
        for by_cell, by_settings, unit in (
            ([cell.stops_at_N], [settings.collision.contact_force_limit_N], "N"),
            (cell.stops_at_Nm.tolist(), settings.collision.torque_collision_Nm.tolist(), "Nm"),
        ):
            if np.abs(np.subtract(by_cell, by_settings)).max() > 1e-9:
                raise ValueError(
                    f"by the workcell the {cell.arm.name} stops by itself at {_listed(by_cell)} {unit}, but by its "
                    f"settings at {_listed(by_settings)} {unit}: give both the same"
                )
        self._cell, self._model, self._start, self._pedal = cell, cell.arm.name, start, pedal
        self._now_s = now_s
        self._player: Player | None = None
        self._entered = False
        self._fault: str | None = None
        self._stops = self._answered = 0  # calls of `stop`, and those that a recovery has answered
        self._payload, self._weighed = settings.payload, False  # whether the arm was found to feel just that
        self._sense = ForceSense(self._model)
        self._identity_notes: tuple[str, ...] = ()
        self._carries = False  # the payload was set since the player got its settings
        self.last_execution: Execution | None = None
        self.last_stop: StopReport | None = None

    @property
    def model(self) -> str:
        """See `hw.ports.Arm`."""
        return self._model

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the operator, empty before entering.

        They say how the arm differs from the model of the rig file, and which real-time properties the computer denies
        the player's process.
        """
        return () if self._player is None else (*self._identity_notes, *self._player.notes)

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
            self._now_s(),
            frozen_array(reading.q_rad, (7,), "q_rad"),
            frozen_array(reading.dq_rad_s, (7,), "dq_rad_s"),
            self._stopped_by() or reading.unwilling,
            self._stopped_by() is None and reading.by_hand,
        )

    def execute(self, path: JointPath) -> Execution:
        """Play `path` and return at rest.

        Raises MotionRefused, ArmFault or StoppedByPedal; if it braked, the last two carry the path to standstill.
        """
        with _heard():
            self._play(self._admitted(path))
        assert self.last_execution is not None
        return self.last_execution

    def stop(self) -> None:
        """Ask the running motion to brake along its path; `execute` then raises ArmFault. From any thread.

        No motion begins until a `recover` that is called later.
        """
        self._stops += 1

    def carry(self, tool: Tool, payload: Payload) -> None:
        """Set the load on the flange from now on, for the checks and for the arm's own weight compensation.

        Nothing moves. Raises DeviceUnavailable, or ArmFault if the arm does not accept it.
        """
        with self._asking():
            self._connected().carry(payload)
        self._cell, self._payload = self._cell.holding(tool), payload
        self._carries, self._weighed = True, False

    def recover(self) -> None:
        """Clear a fault, with a new player if the old one is gone. Never resumes a motion.

        Raises ArmFault if a person must act first, DeviceUnavailable if the arm cannot be reached.
        """
        player, stops = self._connected(), self._stops
        with self._asking():
            reading = player.recover()
        self._answered = stops  # a stop that came meanwhile holds
        self._fault = reading.unwilling
        if self._fault is not None:
            raise ArmFault(f"{self._model} does not recover: {self._fault}")

    def _admitted(self, path: JointPath) -> PlayableMotion:
        """`path` in the player's form. Raises ArmFault and MotionRefused; nothing has moved."""
        reading = self._reading()
        self._fault = self._fault or reading.unwilling  # a stop button that is released now still needs a recovery
        refuse_while_stopped(self._stopped_by())
        check = self._cell.require
        check(path, frozen_array(reading.q_rad))
        self._feel(path)
        held_rad = frozen_array(reading.q_held_rad)
        motion = motion_of(from_held(path, held_rad, self._model, check), self._cell.motion)
        motion = replace(motion, checked_s=reading.at_s)
        if self._pedal is not None and not self._pedal.enabled():
            raise MotionRefused(
                f"{self._model}: {self._pedal.why_not()}; nothing has moved, hold the pedal and try again"
            )
        refuse_while_stopped(self._stopped_by())  # a stop may have come while the path was checked
        self.last_execution = self.last_stop = None
        return motion

    def _feel(self, path: JointPath) -> None:
        """Before the first motion with a payload, and before every motion that relies on contact.

        Raises MotionRefused if the arm feels another load, or if its sense of force is dead.
        """
        if self._weighed and path.contact is None:
            return
        if not self._weighed:
            with self._asking():
                self._connected().carry(self._payload)
        felt = [self._reading() for _ in range(2 * READINGS)][READINGS:]
        q_rad, external_Nm = self._cell.arm.true_rad(felt[-1].q_rad), [one.external_Nm for one in felt]
        self._sense.require_alive(q_rad, external_Nm)
        if not self._weighed:
            require_declared(self._model, q_rad, external_Nm, self._payload.com_F_m)
        if path.contact is not None:
            self._sense.require_change()
        self._weighed = True

    def _play(self, motion: PlayableMotion) -> None:
        """Raises ArmFault and StoppedByPedal."""
        assert self._player is not None
        try:
            outcome = self._player.play(motion, self._word)
        except Failure as failure:
            raise self._error(failure, moving=failure.kind != UNMOVED) from failure
        except BaseException:  # Ctrl-C: the player no longer hears from the program and brakes
            self._fault = "the program was interrupted during a motion"
            self._drop_player()
            raise
        played = outcome.played
        t_start_s = float(played.clock_s[0]) if len(played.t_s) else self._now_s()
        measured = {name: log for name, log in played.measured.items() if np.isfinite(log).all()}
        joints = played.q_commanded_rad, played.q_measured_rad
        execution = Execution(t_start_s, played.t_s, *joints, played.success_rate, measured)
        self.last_execution, self.last_stop = execution, stop_report(played)
        if outcome.failure is not None:
            self.last_stop = arm_stop(played, outcome.rest) or self.last_stop
            self._fault = outcome.failure.text  # also if the arm refused to begin: its stop button may be released now
            after_s = float(played.t_s[-1]) if len(played.t_s) else None
            raise self._error(outcome.failure, moving=after_s is not None, after_s=after_s, latched=True)
        if self.last_stop is not None:
            kind = StoppedByPedal if self.last_stop.why == "pedal" else ArmFault
            raise self._stopped(kind, WHY[self.last_stop.why], f" {self.last_stop}{self._pedal_now(kind)}")

    def _stopped(self, kind: type[ArmFault], why: str, how: str = "") -> ArmFault:
        """A fault that lasts until `recover`."""
        self._fault = why
        return kind(f"{self._model}: {why}{how}; {_THEN}")

    def _pedal_now(self, kind: type[ArmFault]) -> str:
        """The present state of a pedal that stopped the arm: released, silent, or unplugged; "" if it is held again."""
        if kind is not StoppedByPedal or self._pedal is None or self._pedal.enabled():
            return ""
        return f" ({self._pedal.why_not()})"

    def _stopped_by(self) -> str | None:
        """The reason why the arm may not move until `recover`, or None."""
        return self._fault or (WHY["request"] if self._stop_wanted else None)

    @property
    def _stop_wanted(self) -> bool:
        return self._stops > self._answered

    def _word(self) -> bytes:
        if self._stop_wanted:
            return REQUESTED
        return PEDAL if self._pedal is not None and not self._pedal.enabled() else ALIVE

    def _reading(self) -> Reading:
        with self._asking():
            return self._connected().reading()

    @contextmanager
    def _asking(self) -> Iterator[None]:
        """Around a call of the player at rest. Raises DeviceUnavailable and ArmFault."""
        try:
            yield
        except Failure as failure:
            raise self._error(failure) from failure

    def _connected(self) -> Player:
        """The player; a new one if the last has ended. Raises DeviceUnavailable."""
        if not self._entered:
            raise DeviceUnavailable(f"the {self._model} is not connected: use it inside a `with` block")
        if self._player is not None and not self._player.alive:
            self._fault = self._fault or "the process that plays motions has ended"
            self._drop_player()
        if self._player is None:
            try:
                self._player = self._start()
                self._recognise(self._player)
                if self._carries:
                    self._player.carry(self._payload)
            except Failure as failure:
                self._drop_player()
                raise DeviceUnavailable(failure.text) from failure
        return self._player

    def _recognise(self, player: Player) -> None:
        """Check that the arm is of the model that every check assumes. The narrower of its joint limits and ours count.

        Raises DeviceUnavailable for another model, and Failure.
        """
        report = player.report()
        identity = identify(self._model, report)
        if identity.model not in (None, self._model):
            self._drop_player()
            raise DeviceUnavailable(
                f"the rig file says {self._model}, and the connected arm is {TITLES[str(identity.model)]}: "
                f"{identity.why}. "
                f'Nothing has moved. Write model = "{identity.model}" under [arm] of the rig file, and say '
                f"--hw {identity.model}"
            )
        unsure_of = () if identity.model else (unsure(self._model, identity),)
        try:
            limits, differences = narrowed(self._cell.arm.limits, report.urdf)
        except ValueError as error:
            limits, differences = self._cell.arm.limits, (f"the arm's own description cannot be read: {error}",)
        self._cell = replace(self._cell, arm=replace(self._cell.arm, limits=limits))
        self._identity_notes = (*unsure_of, *differences)

    def _error(
        self, failure: Failure, *, moving: bool = False, after_s: float | None = None, latched: bool = False
    ) -> Exception:
        """The error to raise for a failure; during a motion it is a fault that lasts until `recover`."""
        if failure.kind in (LOST, UNAVAILABLE):
            self._drop_player()  # a broken connection stays broken: the next call makes a new one
        if failure.kind == UNMOVED:
            self._fault = failure.text
        if not moving:
            kind = DeviceUnavailable if failure.kind in (LOST, UNAVAILABLE) else ArmFault
            text = failure.text if failure.text.startswith(self._model) else f"{self._model}: {failure.text}"
            return kind(f"{text}; {_LATCHED}" if latched or failure.kind == UNMOVED else text)
        self._fault = failure.text
        when = "during the motion" if after_s is None else f"{after_s:.3f} s into the path"
        return ArmFault(f"{self._model} stopped {when}: {failure.text}; {_THEN}")

    def _drop_player(self) -> None:
        if self._player is not None:
            self._player.close()
            self._player = None


def _listed(values: list[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


@contextmanager
def _heard() -> Iterator[None]:
    """Python's garbage collection is off meanwhile. A full one takes 0.15 s in a session's process; during it the
    program would not read the pedal, and the player would get no word from the program.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def open_franka(cell: Workcell, settings: FrankaSettings, *, pedal: Pedal | None = None) -> FrankaArm:
    """The arm of `cell` at `settings.host`; entering it connects.

    With a pedal, a motion begins only while it is held, and releasing it stops the running motion.
    """
    return franka(cell, settings, Timing(), pedal=pedal)


def franka(cell: Workcell, settings: FrankaSettings, timing: Timing, *, pedal: Pedal | None = None) -> FrankaArm:
    """`open_franka` for tests and benchmarks over a simulator, which relax `timing`."""
    return FrankaArm(cell, settings, lambda: PlayerProcess(cell.arm.name, settings, timing), pedal=pedal)
