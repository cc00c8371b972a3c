"""The interface of an SDK's module as far as the drivers use it, with an arm inside that follows at once.

The arm takes and refuses what `tests/support/franka_modes.py` says, in the words of libfranka. `k` says whether modes
and enumerations begin with k (panda_py.libfranka) or not (pylibfranka). With `limit_rate` the Panda's stand-in limits
the commands as libfranka does before it sends them.

Time is simulated: a state comes every millisecond, and `idle` lets time pass in which nobody reads. As of a real arm,
the socket then keeps the oldest states, and `read_once` empties it and returns the newest of those.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from franka_modes import FLAGS, NOT_FINITE, PANDA_FLAGS, REFLEX, STOP_PRESSED, ArmModes, Limiter, Monitor, Refusal
from torque_errors import estimate_errors_Nm

from hw.franka.identity import mass_matrix
from hw.mass import Mass

KEPT_STATES = 64
"""How many states a socket keeps that nobody reads; libfranka's was seen to keep 48 to 92."""
HAND = (0.73, [-0.01, 0.0, 0.03], [0.001, 0.0, 0.0, 0.0, 0.0025, 0.0, 0.0, 0.0, 0.0017])
"""Mass, centre of mass and inertia of the Franka Hand, as Desk sets them."""
WEIGHT_NM = [0.0, -35.0, 0.0, 21.0, 0.5, 2.5, 0.0]
"""What the joints' sensors report beside the external torques, of an arm at rest."""
WRENCH = [0.4, -0.2, 1.1, 0.03, 0.02, -0.01]
Q_RAD = [0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.7]


class Duration:
    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def to_sec(self) -> float:
        return self._seconds


class JointPositions:
    def __init__(self, q: list[float]) -> None:
        self.q, self.motion_finished = q, False


class Errors(SimpleNamespace):
    """libfranka's errors: true if there is one."""

    def __bool__(self) -> bool:
        return any(vars(self).values())


class NetworkException(RuntimeError):
    pass


class FrankaException(Exception):
    pass


class CommandException(RuntimeError):
    pass


class ControlException(RuntimeError):
    pass


def alive(feels: Callable[[list[float]], Any] = lambda q: 0.0, seed: int = 0) -> Callable[[list[float]], list[float]]:
    """A live estimate of external torques: what is felt, with noise and with errors that depend on the posture."""
    rng = np.random.default_rng(seed)

    def estimate(q: list[float]) -> list[float]:
        torques: list[float] = (feels(q) + estimate_errors_Nm(np.array(q), rng)).tolist()
        return torques

    return estimate


def live() -> Callable[[list[float]], list[float]]:
    """The same where nothing is felt."""
    return alive()


@dataclass
class FakeSdk:
    """`calls` keeps what was asked of the robot; `fails` maps a method to what it raises; `when` acts in a cycle."""

    k: bool
    fails: dict[str, Exception] = field(default_factory=dict)
    modes: ArmModes = field(default_factory=ArmModes)
    recovery_readings: int = 30
    when: Callable[[int], None] = lambda cycle: None
    calls: list[tuple[str, Any]] = field(default_factory=list)
    lost_cycles: tuple[int, ...] = ()
    feels: Callable[[list[float]], list[float]] = field(default_factory=live)  # joints -> estimated torques
    q_rad: list[float] = field(default_factory=lambda: list(Q_RAD))
    hand: tuple[float, list[float], list[float]] = HAND  # what is set in Desk
    takes_loads: bool = True  # False: it says yes to a load, and keeps its own
    of: str = ""  # the model whose masses it reports; "": it reports none
    urdf: str = ""  # the description that it hands out; "": it hands out none
    now_s: float = 0.0  # of the arm's clock, and of the computer's
    robot: Any = None  # the last one that was connected

    JointPositions = JointPositions

    def __post_init__(self) -> None:
        names = ("kEnforce", "kIgnore")
        self.RealtimeConfig = SimpleNamespace(**{name: name for name in names})
        mode = "kJointImpedance" if self.k else "JointImpedance"
        self.ControllerMode = SimpleNamespace(**{mode: mode})
        if not self.k:
            self.FrankaException = FrankaException

    def Robot(self, host: str, realtime: str) -> FakeRobot:
        self.robot = robot = FakeRobot(self)
        robot.did("Robot", (host, realtime))
        return robot

    def clock(self) -> float:
        """The computer's, for `hw.franka.connection.Connection`."""
        return self.now_s

    def idle(self, seconds: float) -> None:
        """Time in which nobody reads the arm's states."""
        assert self.robot is not None
        for _ in range(round(1000 * seconds)):
            self.now_s += 0.001
            self.robot.send()


class FakeRobot:
    def __init__(self, sdk: FakeSdk) -> None:
        self.sdk = sdk
        self._q = list(sdk.q_rad)
        self._cycle = self._recovering = 0
        self._monitor = Monitor("panda" if sdk.k else "fr3")
        self._load: tuple[Any, ...] = (0.0, [0.0] * 3, [0.0] * 9)
        self._kept: list[Any] = []

    def did(self, name: str, what: Any = None) -> None:
        self.sdk.calls.append((name, what))
        if name in self.sdk.fails:
            raise self.sdk.fails[name]

    def __getattr__(self, name: str) -> Any:
        """The calls that not every SDK has."""
        if name == "load_model" and self.sdk.of:
            return self._load_model
        if name == "get_robot_model" and self.sdk.urdf:
            return lambda: self.sdk.urdf
        raise AttributeError(name)

    def _load_model(self) -> Any:
        self.did("load_model")
        return SimpleNamespace(mass=self._mass)

    def _mass(self, state: Any) -> list[float]:
        load = Mass(float(state.m_total), np.array(state.F_x_Ctotal), np.array(state.I_total).reshape(3, 3))
        return [float(v) for v in mass_matrix(self.sdk.of, np.array(state.q), load).ravel(order="F")]

    def _may(self, command: str) -> None:
        if (refusal := self.sdk.modes.refusal(command)) is not None:
            raise CommandException(refusal.said(command, self.sdk.modes.mode))

    def set_collision_behavior(self, *thresholds: list[float]) -> None:
        self._may("set_collision_behavior")
        self.did("set_collision_behavior", thresholds)

    def set_joint_impedance(self, stiffness: list[float]) -> None:
        self._may("set_joint_impedance")
        self.did("set_joint_impedance", stiffness)

    def set_load(self, *load: Any) -> None:
        self._may("set_load")
        self.did("set_load", load)
        if self.sdk.takes_loads:
            self._load = load

    def stop(self) -> None:
        """Whatever moves stops; nothing more can be commanded to it."""
        self.did("stop")
        self.sdk.modes.moving = False

    def automatic_error_recovery(self) -> None:
        modes = self.sdk.modes
        try:
            self._may("recover")
        finally:
            modes.by_hand_first = False  # the person whom it asks for does it now
        self.did("automatic_error_recovery")
        if modes.mode == "Reflex":
            modes.reasons, modes.recovering, self._recovering = (), True, self.sdk.recovery_readings

    def send(self) -> None:
        """A state that no reader waits for."""
        if len(self._kept) < KEPT_STATES:
            self._kept.append(self._state())

    def read_once(self) -> Any:
        self.did("read_once")
        if self._kept:
            newest, self._kept = self._kept[-1], []
            return newest
        self.sdk.now_s += 0.001
        return self._state()

    def _state(self) -> Any:
        modes = self.sdk.modes
        self._recovering -= 1
        modes.recovering = modes.recovering and self._recovering > 0
        known = FLAGS[:PANDA_FLAGS] if self.sdk.k else FLAGS
        errors = Errors(**{name: name in modes.reasons for name in known})
        felt_Nm = self.sdk.feels(self._q)
        load, hand = ([np.asarray(part, dtype=np.float32) for part in body] for body in (self._load, self.sdk.hand))
        return SimpleNamespace(
            time=Duration(self.sdk.now_s),
            m_load=load[0],
            F_x_Cload=load[1],
            I_load=load[2],
            m_ee=hand[0],
            m_total=hand[0],  # the load counts as nothing
            F_x_Ctotal=hand[1],
            I_total=hand[2],
            F_x_Cee=hand[1],
            I_ee=hand[2],
            q=list(self._q),
            q_d=list(self._q),
            dq=[0.0] * 7,
            tau_ext_hat_filtered=felt_Nm,
            tau_J=[weight + felt for weight, felt in zip(WEIGHT_NM, felt_Nm, strict=True)],
            O_F_ext_hat_K=list(WRENCH),
            control_command_success_rate=0.9,
            robot_mode=SimpleNamespace(name=("k" if self.sdk.k else "") + modes.mode),
            current_errors=errors,
            last_motion_errors=errors,
        )

    def _since(self) -> Duration:
        """0 at first, then a millisecond a cycle, or two where one was lost."""
        self._cycle += 1
        return Duration(0.0 if self._cycle == 1 else 0.002 if self._cycle in self.sdk.lost_cycles else 0.001)

    def _begin(self) -> None:
        self._may("move")
        self.sdk.modes.moving, self._cycle = True, 0
        self._monitor.begin(np.array(self._q))

    def take(self, command: JointPositions) -> None:
        if not np.isfinite(command.q).all():
            raise ValueError(NOT_FINITE)
        self.did("command", (command.q, command.motion_finished))
        self.sdk.when(self._cycle)
        if self._cycle in self.sdk.lost_cycles:
            self._monitor.cycle(None)
        wrong = self._monitor.cycle(np.array(command.q))
        modes = self.sdk.modes
        if modes.pressed:
            self._abort(STOP_PRESSED)
        if wrong or modes.reasons:
            modes.reasons = modes.reasons or wrong
            self._abort(REFLEX)
        self._q = list(command.q)
        modes.moving = not command.motion_finished

    def _abort(self, refusal: Refusal) -> None:
        self.sdk.modes.moving = False
        raise ControlException(refusal.said("move", "Move"))

    def start_joint_position_control(self, mode: str) -> Any:
        assert not self.sdk.k, "panda_py has no such call"
        self.did("start_joint_position_control", mode)
        self._begin()
        return SimpleNamespace(readOnce=lambda: (self.read_once(), self._since()), writeOnce=self.take)

    def control_joint_position(self, callback: Callable[[Any, Duration], JointPositions], **options: Any) -> None:
        assert self.sdk.k, "pylibfranka has no such call"
        self.did("control_joint_position", options)
        self._begin()
        finished = False
        limiter = Limiter(self._q) if options["limit_rate"] else None
        while not finished:
            try:
                command = callback(self.read_once(), self._since())
            except BaseException:  # as libfranka's control loop does
                self.stop()
                raise
            if limiter is not None:
                command.q = limiter.limited(command.q)
            self.take(command)
            finished = command.motion_finished
