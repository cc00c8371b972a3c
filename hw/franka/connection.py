"""A connected arm: the maker's `pylibfranka` drives the FR3 and the FR3 v2, `panda_py` (libfranka 0.9.2) the Panda.

The SDKs differ only in how they drive a motion (`DRIVES`).

An arm accepts settings only in its mode Idle, not after a reflex or while the stop button is pressed. So connecting
sets nothing: in any mode the arm can be read, explained and recovered. The settings are sent before every motion.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from hw.errors import DeviceUnavailable
from hw.franka import realtime as real_time
from hw.franka import reflexes
from hw.franka.driver import (
    FAULT,
    LOST,
    UNAVAILABLE,
    UNMOVED,
    Failure,
    Reading,
    SdkState,
    Step,
    error_names,
    failure,
    mode_name,
)
from hw.franka.explanations import AT_REST, CONNECTING, MOVING, STARTING, Phase
from hw.franka.identity import ArmReport
from hw.franka.playback import Rhythm
from hw.franka.readback import hand_mismatch, load_mismatch
from hw.franka.settings import FrankaSettings, Payload
from hw.franka.starting import START_S, Rehearsal
from hw.franka.states import States
from hw.franka.versions import PACKAGES
from hw.joint_limits import LIMITS
from hw.mass import Mass

NO_FILTER_HZ = 1000.0
"""libfranka's `kMaxCutoffFrequency`: the path is played as it was checked.

libfranka's rate limiter is off for the same reason. It would turn a jump of the commands into a chase at full speed
(`limitRate` in its rate_limiting.cpp). Without it, the arm refuses the jump."""

Drive = Callable[[Any, Any, Step], None]
"""(SDK module, its Robot, step): call `step` every millisecond until it marks its joints as the last.

A Failure of `step` ends the motion: nothing more is commanded, and the arm's controller brakes."""


def drive_fr3(sdk: Any, robot: Any, step: Step) -> None:
    """Read a state, write its joints, a thousand times a second."""
    control = robot.start_joint_position_control(sdk.ControllerMode.JointImpedance)
    finished = False
    while not finished:
        state, since = control.readOnce()
        try:
            q_rad, finished = step(state, since.to_sec())
        except Failure:
            robot.stop()  # libfranka does so itself where it calls back; here `control` lives as long as the error
            raise
        command = sdk.JointPositions(q_rad)
        command.motion_finished = finished
        control.writeOnce(command)


def drive_panda(sdk: Any, robot: Any, step: Step) -> None:
    """The SDK calls back a thousand times a second."""

    def cycle(state: SdkState, since: Any) -> Any:
        q_rad, finished = step(state, since.to_sec())
        command = sdk.JointPositions(q_rad)
        command.motion_finished = finished
        return command

    robot.control_joint_position(
        cycle, controller_mode=sdk.ControllerMode.kJointImpedance, limit_rate=False, cutoff_frequency=NO_FILTER_HZ
    )


DRIVES: dict[str, Drive] = {"fr3": drive_fr3, "fr3v2": drive_fr3, "panda": drive_panda}


RECOVERY_READINGS = 1000
"""How many states (one per millisecond) an arm may need until it reports that it has recovered."""

IDLE_READINGS = 500
"""The same after a motion or a recovery, until it reports Idle."""

TAKEN_READINGS = 200
"""The same, until an arm reports the load that it was sent."""

_PASSING = ("Move", "AutomaticErrorRecovery")
"""Modes that end by themselves."""


class Connection:
    """One connected arm, over an SDK's module. Every method raises `Failure`. Its constructor sets nothing."""

    def __init__(
        self,
        model: str,
        sdk: Any,
        drive: Drive,
        settings: FrankaSettings,
        *,
        realtime: bool,
        unwatched_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        take_priority: Callable[[], None] = lambda: None,
    ) -> None:
        """`realtime`: libfranka also demands a real-time kernel. `take_priority` gives this thread its priority back
        each time after libfranka may have raised it. Raises Failure.
        """
        self._model, self._sdk, self._drive, self._host = model, sdk, drive, settings.host
        self._settings, self._payload = settings, settings.payload
        self.notes: tuple[str, ...] = ()  # what the computer denies this process (`hw.franka.realtime.settle`)
        self.alone: object = None  # what keeps other programs away, as long as this lives
        # The errors of both SDKs. Of these, only pylibfranka's version mismatch is not a RuntimeError.
        self._errors: tuple[type[Exception], ...] = (RuntimeError, getattr(sdk, "FrankaException", RuntimeError))
        config = sdk.RealtimeConfig.kEnforce if realtime else sdk.RealtimeConfig.kIgnore
        try:
            self._robot = sdk.Robot(settings.host, config)
        except self._errors as error:
            raise self._failure(error, CONNECTING) from error
        self._take_priority = take_priority
        self._lower_priority(UNAVAILABLE)
        unwatched_s = settings.starting.unwatched_s if unwatched_s is None else unwatched_s
        self._clock, self._states = clock, States(self._robot, clock, unwatched_s)

    def reading(self) -> Reading:
        """The arm's present report."""
        try:
            return self._read(self._states.present())
        except self._errors as error:
            raise self._failure(error) from error

    def watch(self) -> bool:
        """Read the next state, so that `interruption` knows of it; False if the arm does not answer."""
        try:
            self._states.next()
        except self._errors:
            return False
        return True

    def interruption(self, checked_s: float, state: SdkState | None = None) -> str:
        """Why a motion that was checked at this time of the arm's clock may not begin; "" if it may.

        `state` is that of its first cycle.
        """
        if state is not None:
            self._states.note(state)
        return self._states.since(checked_s)

    def listen(self, states: int) -> Rhythm:
        """Read this number of states as they come."""
        robot, clock = self._robot, self._clock
        try:
            first_s = last_s = self._states.present().time.to_sec()
            before_s, gap_s = clock(), 0.0
            for _ in range(states - 1):
                last_s = self._states.next().time.to_sec()
                now_s = clock()
                gap_s, before_s = max(gap_s, now_s - before_s), now_s
            version = int(robot.server_version()) if hasattr(robot, "server_version") else None
        except self._errors as error:
            raise self._failure(error) from error
        missed = max(round(1e3 * (last_s - first_s)) - (states - 1), 0)
        return Rhythm(states, missed, gap_s, version, real_time.priority())

    def report(self) -> ArmReport:
        """The arm's description of itself, as far as its SDK passes it on. Nothing moves, and no setting changes."""
        robot, alone = self._robot, [*PACKAGES.values()].count(PACKAGES[self._model]) == 1
        urdf = ""
        unreadable: tuple[type[Exception], ...] = (*self._errors, ValueError)
        try:
            if hasattr(robot, "get_robot_model"):
                urdf = str(robot.get_robot_model())
            if alone or not hasattr(robot, "load_model"):
                return ArmReport(urdf=urdf)  # a Panda would send a library of its own, to be run here
            state = self._states.present()
            matrix = np.array(robot.load_model().mass(state), dtype=np.float64).reshape(7, 7)
            inertia = np.array(state.I_total, dtype=np.float64).reshape(3, 3)
            load = Mass(float(state.m_total), np.array(state.F_x_Ctotal), (inertia + inertia.T) / 2.0)
        except unreadable as error:
            if (outcome := self._failure(error)).kind == LOST:
                raise outcome from error
            return ArmReport(urdf=urdf)  # an arm that does not say what it is may still be read and recovered
        return ArmReport(np.array(state.q), matrix, load, urdf)

    def prepare(self, checked_s: float) -> None:
        """Give the arm its settings, before every motion, and check that it accepted them; nothing has moved.

        `checked_s`: when the motion was checked (arm's clock). Raises `Failure` if the arm's mode is not Idle, or was
        not Idle since then, and if its load or hand is not the expected one.
        """
        self._require_idle(checked_s)
        try:
            self._configure()
            self._require_taken()
        except self._errors as error:
            outcome = self._failure(error)
            raise outcome if outcome.kind == LOST else Failure(UNMOVED, f"{outcome.text}; nothing has moved") from error
        self._require_idle(checked_s)

    def rehearse(self, starts: int, readings: int) -> Rehearsal:
        """Do everything that comes before a motion, `starts` times, then take `readings` states at rest. Nothing moves.

        Raises `Failure`, also if the arm's mode is not Idle.
        """
        pauses_s, took_s = [], []
        for _ in range(starts):
            checked_s, began_s = self.reading().at_s, self._clock()
            self._states.longest_s = 0.0
            self.prepare(checked_s)
            pauses_s.append(self._states.longest_s)
            took_s.append(self._clock() - began_s)
        try:
            held_rad = np.array([self._states.next().q_d for _ in range(readings)])
        except self._errors as error:
            raise self._failure(error) from error
        window = max(round(1e3 * START_S), 1)
        wander_rad = max(float(np.ptp(held_rad[i : i + window], axis=0).max()) for i in range(0, readings, window))
        return Rehearsal(starts, max(pauses_s), max(took_s), 1e-3 * readings, wander_rad)

    def drive(self, step: Step) -> None:
        """Call `step` every millisecond until it says that its joints are the last. If it raises a Failure, the motion
        ends.
        """
        phase: Phase = STARTING

        def cycle(state: SdkState, since_s: float) -> tuple[list[float], bool]:
            nonlocal phase
            if phase is STARTING:
                phase = MOVING
                self._lower_priority(FAULT)
            return step(state, since_s)

        try:
            self._drive(self._sdk, self._robot, cycle)
        except self._errors as error:
            raise self._stopped(error, phase) from error

    def recover(self) -> None:
        """Clear reflexes. Never moves."""
        try:
            if self._mode(self._states.present()) != "Reflex":
                return
            self._robot.automatic_error_recovery()
            self._states.present()
            for _ in range(RECOVERY_READINGS):
                if self._mode(self._states.next()) not in ("Reflex", "AutomaticErrorRecovery"):
                    return
        except self._errors as error:
            raise self._failure(error) from error

    def carry(self, payload: Payload) -> None:
        """Set the load of the hand from now on. An arm that is not Idle receives it before its next motion. Never
        moves.
        """
        self._payload = payload
        if self._settled().mode != "Idle":  # it is sent with the settings of the next motion
            return
        try:
            _load(self._robot, payload)
            self._require_taken()
        except self._errors as error:
            raise self._failure(error) from error

    def _lower_priority(self, kind: str) -> None:
        """Called after libfranka has taken the highest priority. Raises Failure of this kind."""
        try:
            self._take_priority()
        except DeviceUnavailable as error:
            raise Failure(kind, str(error)) from error

    def _configure(self) -> None:
        """Set collision thresholds, joint impedance and payload; all other settings stay as in Desk.

        After each command, the states that came meanwhile are read, so that each answer counts as a separate pause.
        """
        robot, collision = self._robot, self._settings.collision
        robot.set_collision_behavior(
            collision.torque_contact_Nm.tolist(),
            collision.torque_collision_Nm.tolist(),
            collision.force_contact_N.tolist(),
            collision.force_collision_N.tolist(),
        )
        self._states.next()
        robot.set_joint_impedance(self._settings.joint_impedance_Nm_rad.tolist())
        self._states.next()
        _load(robot, self._payload)

    def _require_idle(self, checked_s: float) -> None:
        reading = self._settled()
        why = None
        if reading.mode != "Idle":
            why = reading.unwilling or reflexes.of_mode(reading.mode, busy=True)
        if why := why or self.interruption(checked_s):
            raise Failure(UNMOVED, f"{why}; nothing has moved")

    def _require_taken(self) -> None:
        """Wait until the arm reports the load that it was sent. Raises Failure, also for another hand."""
        wrong = load_mismatch(state := self._states.present(), self._payload)
        for _ in range(TAKEN_READINGS):
            if not wrong:
                break
            wrong = load_mismatch(state := self._states.next(), self._payload)
        if wrong := wrong or hand_mismatch(state, self._settings.end_effector):
            raise Failure(UNMOVED, f"{wrong}; nothing has moved")

    def _read(self, state: SdkState) -> Reading:
        """Raises Failure for a state that is not finite, or of joints that no arm can have."""
        mode = self._mode(state)
        reasons = error_names(state.current_errors)
        if not reasons and mode == "Reflex":
            reasons = error_names(state.last_motion_errors)
        more = tuple(state.tau_ext_hat_filtered), state.time.to_sec(), hand_mismatch(state, self._settings.end_effector)
        try:
            reading = Reading(tuple(state.q), tuple(state.q_d), tuple(state.dq), mode, reasons, *more)
            LIMITS[self._model].require_plausible(reading.q_rad)
        except ValueError as error:
            raise Failure(LOST, f"{self._model} at {self._host} reports nonsense ({error}): restart the arm") from error
        return reading

    @staticmethod
    def _mode(state: SdkState) -> str:
        return mode_name(state.robot_mode)

    def _settled(self) -> Reading:
        """The first state in a mode that lasts."""
        reading = self.reading()
        for _ in range(IDLE_READINGS):
            if reading.mode not in _PASSING:
                break
            reading = self.reading()
        return reading

    def _stopped(self, error: Exception, phase: Phase) -> Failure:
        outcome = self._failure(error, phase)
        if outcome.kind == LOST:
            return outcome
        try:
            reasons = self._read(self._states.present()).reasons
        except self._errors:  # it no longer answers: use its last state
            return outcome
        return self._failure(error, phase, reasons)

    def _failure(self, error: Exception, phase: Phase = AT_REST, reasons: tuple[str, ...] = ()) -> Failure:
        return failure(error, self._model, self._host, reasons, phase)


def _load(robot: Any, payload: Payload) -> None:
    robot.set_load(payload.mass_kg, payload.com_F_m.tolist(), payload.inertia_F_kg_m2.ravel(order="F").tolist())
