"""The person beside a real rig: questions and actions around the trials of `session.rig_target`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from typing import Any, Protocol, runtime_checkable

import numpy as np

from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.mounted import MountedTask
from adaptsim_cli.bench.devices.pacing import at_speed
from adaptsim_cli.bench.devices.recovery import offer_recovery
from adaptsim_cli.bench.facts import RigFacts, WaiverRecord
from adaptsim_cli.bench.rig_file.devices import DeviceKind
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, enter, stop
from adaptsim_cli.screen.views import Readiness, clear_to_move
from hw.errors import BalanceError, DeviceUnavailable, HandError
from hw.grasping import SLIPPED_M
from hw.ports import Balance, Camera, Hand
from hw.types import Array, Placing

_WAY_OUT = "The command ends; everything completed is stored, and the same command goes on from here."

AT_HOME_RAD = 0.005
"""Half of the distance from the arm at which `hw.limits` allows a path to begin."""


class Person:
    """`hw.ports.ObjectPlacer`: a person, who places the object before answering the question about it."""

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """See `hw.ports.ObjectPlacer`."""
        Placing(xy_m, trial, attempt)


class Scales:
    """The mass of the object, weighed once per command and stored with every trial."""

    def __init__(self, balance: Balance, screen: Screen) -> None:
        self._balance, self._screen = balance, screen
        self._asked = False
        self.facts = RigFacts()

    def weigh(self, what: str) -> None:
        """Ask for the object on the balance. Raises StoppedByOperator, DeviceUnavailable."""
        while not self._asked:
            weigh = enter("to weigh it", "Reads the balance; the mass is stored with every trial of this command.")
            skip = Key("n", "to skip", "Stores the trials without a mass.")
            answer = self._screen.choose(f"Put the {what} on the balance.", weigh, skip, stop(_WAY_OUT))
            if answer == "q":
                raise StoppedByOperator("stopped by the operator; everything completed is stored")
            if answer == "n":
                self._asked = True
            elif answer == "":
                self._read()

    def _read(self) -> None:
        try:
            mass_kg = self._balance.mass_kg()
        except BalanceError as error:
            self._screen.note(f"  {error}")
            return
        if mass_kg <= 0.0:
            self._screen.note(f"  {1000.0 * mass_kg:.1f} g: nothing is on the balance; put the object there")
            return
        self._screen.show(f"  {1000.0 * mass_kg:.1f} g")
        self.facts = RigFacts(object_mass_kg=mass_kg, weighed=datetime.now(UTC).isoformat(timespec="seconds"))
        self._asked = True


@dataclass(frozen=True, eq=False)
class Instruments:
    """The instruments of the rig, connected: their values are stored with each trial."""

    kinds: Mapping[str, DeviceKind[Any, Any]]
    drivers: Mapping[str, Any]  # by the same names
    screen: Screen

    def values(self) -> dict[str, float]:
        """`instrument.quantity` -> value. An instrument that does not answer is noted and left out."""
        values = dict[str, float]()
        for name, kind in self.kinds.items():
            assert kind.measure is not None  # else it is not an instrument
            try:
                measured = kind.measure(self.drivers[name])
            except DeviceUnavailable as error:
                self.screen.note(f"  {name}: no value is stored with this trial: {error}")
            else:
                values |= {f"{name}.{quantity}": float(value) for quantity, value in measured.items()}
        return values


@runtime_checkable
class _Telling(Protocol):
    """A camera that reports its settings and the quality of its last recording."""

    def facts(self) -> dict[str, Any]: ...


@dataclass(frozen=True, eq=False)
class PersonBeside:
    """`session.rig.Attendant`: a person at a terminal."""

    arm: ConfirmedArm
    camera: Camera
    mounted_task: MountedTask
    screen: Screen
    scales: Scales | None
    watch: ToolWatch | None  # None: no hand holds the tool
    instruments: Instruments | None = None

    def recover(self) -> None:
        """See `Attendant`."""
        offer_recovery(self.arm, self.screen)

    def prepare(self, what: str) -> None:
        """See `Attendant`."""
        self.arm.confirm()
        self._home()
        if self.scales is not None:
            self.scales.weigh(what)

    def facts(self) -> RigFacts:
        """See `Attendant`."""
        camera_facts = self.camera.facts() if isinstance(self.camera, _Telling) else None
        return (self.scales.facts if self.scales else RigFacts()).model_copy(
            update={
                "camera": camera_facts,
                "instruments": {} if self.instruments is None else self.instruments.values(),
                "pedal": self.arm.pedal,
                "operator": self.arm.consent.operator,
                "consent": self.arm.consent.given_at,
                "stop_button": ""
                if self.arm.consent.known_arm is None
                else self.arm.consent.known_arm.read().stop_button,
                "waivers": tuple(
                    WaiverRecord(**asdict(one), until=one.until.isoformat()) for one in self.arm.consent.waivers
                ),
                "pace": self.arm.consent.pace,
                "tool": "waived" if self.watch is None else "held",
                "tool_width_m": None if self.watch is None else self.watch.width_m,
            }
        )

    def _home(self) -> None:
        """Move slowly from the arm's present posture, around all obstacles, to the start posture of trials."""
        from sim.panda.moves import free_path

        lab, q_rad = self.mounted_task, self.arm.state().q_rad
        if np.abs(q_rad - lab.home_rad).max() <= AT_HOME_RAD:
            return
        path = free_path(q_rad, lab.home_rad, lab.cell)
        lab.cell.require(path)
        path = at_speed(path, self.arm.consent.pace, lab.cell)
        question = clear_to_move(True, "goes home", path.duration_s) + "."
        self.arm.release.one(question, path.digest, "The arm goes home, slowly. Release the pedal to brake.")
        self.arm.execute(path)


@dataclass
class ToolWatch:
    """Watches the tool in the hand: the width between the fingers at the first check counts as the tool's. Nothing
    moves.
    """

    hand: Hand
    tool: str  # its name
    remedy: str  # the command for grasping it again
    width_m: float | None = field(default=None, init=False)  # at the first check

    def check(self) -> Readiness:
        """A line of the checklist before a session; names a hand that does not answer."""
        try:
            self.require()
        except (HandError, DeviceUnavailable) as error:
            return Readiness("tool", False, str(error))
        assert self.width_m is not None
        return Readiness("tool", True, f"held, the fingers are {1e3 * self.width_m:.1f} mm apart")

    def require(self) -> None:
        """Raises HandError if the tool is lost or has slipped, DeviceUnavailable if the hand does not answer."""
        now = self.hand.state()
        stands = f"the fingers are {1e3 * now.width_m:.1f} mm apart"
        if not now.holds:
            raise HandError(
                f"the hand does not hold the {self.tool} ({stands}). Find the tool and clear it away, then have the "
                f"hand grasp it again: {self.remedy}"
            )
        if self.width_m is None:
            self.width_m = now.width_m
        if abs(now.width_m - self.width_m) > SLIPPED_M:
            raise HandError(
                f"the {self.tool} has slipped: {stands}, {1e3 * self.width_m:.1f} mm at first (at most "
                f"{1e3 * SLIPPED_M:g} mm may change). Its pose is no longer known; have the hand grasp it again: "
                f"{self.remedy}"
            )
