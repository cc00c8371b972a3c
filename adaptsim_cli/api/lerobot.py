"""A robot of LeRobot as your own robot: a function of yours turns an action into joint targets, and it plays them."""

from __future__ import annotations

import pkgutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Self

import numpy as np

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.outputs.exchange import Question
from hw.extras import missing
from hw.plugins import did_you_mean
from hw.types import Array
from sim.errors import ExtraMissing

RATE_HZ = 50.0
APPROACH_S = 3.0
"""Time in which the robot moves from its present joints to the first targets."""

JointTargets = Sequence[Mapping[str, float]]
"""A target for every joint every 20 ms, in the robot's own units, by the names of the robot's `action_features`."""


@dataclass(frozen=True, eq=False)
class PlayedMotion:
    """The motion that the robot made, for your report of the trial."""

    t_s: Array  # (N,) from the first target on, as measured
    joints: Mapping[str, Array]  # (N,) of each joint that the robot observes, just before each target


Motion = Callable[[Question], JointTargets]
Report = Callable[[Question, PlayedMotion], Mapping[str, Any]]
"""The arguments of `Session.tell` by name. Your camera or your ruler measures where the object came to rest."""


class LeRobotPlayer:
    """Plays the trials of a session: `with player: session.run(robot=player)`."""

    def __init__(
        self,
        robot: Any,
        motion: Motion,
        report: Report,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """`robot` is a `lerobot.robots.Robot`; it is connected inside `with`."""
        self._robot, self._motion, self._report = robot, motion, report
        self._clock, self._sleep = clock, sleep

    def __enter__(self) -> Self:
        self._robot.connect()
        return self

    def __exit__(self, *exc: object) -> None:
        self._robot.disconnect()

    def __call__(self, trial: Question) -> Mapping[str, Any]:
        """Approach the first targets, play all of them at 50 Hz, and return the report.

        Raises UsageError, before anything moves, for targets that this robot does not have.
        """
        targets = [dict(row) for row in self._motion(trial)]
        self._require(targets)
        self._play(self._approach(targets[0]))
        return self._report(trial, self._play(targets))

    def _approach(self, first: Mapping[str, float]) -> JointTargets:
        now = self._observed()
        steps = np.linspace(0.0, 1.0, round(APPROACH_S * RATE_HZ))
        return [
            {name: now.get(name, end) + s * (end - now.get(name, end)) for name, end in first.items()} for s in steps
        ]

    def _play(self, targets: JointTargets) -> PlayedMotion:
        begin_s, t_s, observed = self._clock(), list[float](), list[dict[str, float]]()
        for index, row in enumerate(targets):
            self._sleep(max(0.0, begin_s + index / RATE_HZ - self._clock()))
            t_s.append(self._clock() - begin_s)
            observed.append(self._observed())
            self._robot.send_action(dict(row))
        return PlayedMotion(np.array(t_s), {name: np.array([row[name] for row in observed]) for name in observed[0]})

    def _observed(self) -> dict[str, float]:
        return {name: float(value) for name, value in self._robot.get_observation().items() if np.ndim(value) == 0}

    def _require(self, targets: JointTargets) -> None:
        names = set(self._robot.action_features)
        if not targets:
            raise UsageError("your function gave no joint targets: it must return one row every 20 ms")
        for index, row in enumerate(targets):
            if set(row) != names:
                raise UsageError(
                    f"row {index} of the joint targets has {', '.join(map(str, row))}; "
                    f"this robot has {', '.join(sorted(names))}"
                )
            if not np.isfinite(list(row.values())).all():
                raise UsageError(f"row {index} of the joint targets has a value that is not a number: {row}")


def lerobot(kind: str, motion: Motion, report: Report, **settings: Any) -> LeRobotPlayer:
    """A robot of LeRobot by its type, e.g. "so101_follower", to play the trials of a session with `hw="own"`.

    `motion` turns a trial into joint targets, one row every 20 ms; `report` says how the trial ended. `settings` are
    those of the type, e.g. `port="/dev/ttyACM0", id="left"`; its `max_relative_target` limits each step of a joint.
    Raises UsageError for an unknown type or setting, ExtraMissing if the package lerobot is missing.
    """
    try:
        from lerobot import robots
    except ImportError as error:
        raise ExtraMissing(missing("a robot of LeRobot", "lerobot", "lerobot")) from error
    types = _registered(robots, kind)
    if kind not in types:
        raise UsageError(f'LeRobot has no robot "{kind}": it has {", ".join(sorted(types))}{did_you_mean(kind, types)}')
    try:
        config = types[kind](**settings)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the settings of {kind} are not right: {error}") from error
    return LeRobotPlayer(robots.make_robot_from_config(config), motion, report)


def _registered(robots: Any, kind: str) -> Mapping[str, Any]:
    """The configuration of each type; a package of LeRobot or of others registers its types when it is imported."""
    types: Mapping[str, Any] = robots.RobotConfig.get_known_choices()
    if kind not in types:
        from lerobot.utils.import_utils import register_third_party_plugins

        register_third_party_plugins()
        for package in pkgutil.iter_modules(robots.__path__, f"{robots.__name__}."):
            with suppress(ImportError):  # the packages of this robot are not installed
                import_module(package.name)
    return robots.RobotConfig.get_known_choices()  # type: ignore[no-any-return]
