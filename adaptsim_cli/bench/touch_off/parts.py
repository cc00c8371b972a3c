"""The parts of a touch-off; `wiring` provides them, tests bring their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from adaptsim_cli.config import is_simulated
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen.release import Release
from hw.collision import Table
from hw.ports import Arm, GuardedArm, Hand
from hw.types import Array
from hw.workcell import ArmModel
from sim.panda.setting_down import SetDown
from sim.panda.tool import Held, touchable
from sim.panda.touching import HeldTool, Probe, table_probes, tool_probes


class TouchOffFailed(PreflightFailed):
    """The touches contradict each other, or there was none; the previous touch-off stays in use."""


@dataclass(frozen=True, eq=False)
class Plan:
    """The probes of a touch-off, in order."""

    table: tuple[Probe, ...]  # with the closed, empty fingers
    tool: tuple[Probe, ...]  # with the tool; the first one is touched again after the slip check


def plan_of(hardware: Held) -> Plan:
    """The probes for a task's tool. Raises UnknownName."""
    touched = touchable(hardware)
    return Plan(table_probes(touched.centre_m), tool_probes(touched.feelers, touched.centre_m))


class PersonAtTool(Protocol):
    """The simulated lab's stand-in for the person who sets the tool down."""

    def set_down(self, where: SetDown, number: int) -> None:
        """Guide the tool to the set-down of that number (from 0), and let go."""


@dataclass(frozen=True, eq=False)
class GuidedTouchRig:
    """The connected arm of one bench, the tool in its hand or screwed to its flange. Nothing moves by itself."""

    name: str  # "fake", "panda" or "fr3"
    title: str  # its name for an operator
    key: str  # the folder name of its touch-offs
    tool_name: str
    arm: Arm
    model: ArmModel  # with the joint zeros of the calibration
    designed: Array  # (4, 4) the tool in the flange, by its drawing
    table: Table  # as assumed until now
    set_downs: tuple[SetDown, ...]
    work_m: Array  # (2,) the middle of the work area
    pause: Callable[[float], None]  # seconds; the simulated lab does not wait
    person: PersonAtTool | None = None  # None: a person at the terminal


@dataclass(frozen=True)
class Grasp:
    """The grasp of the tool."""

    width_m: float  # between the fingers
    force_N: float = 40.0


@dataclass(frozen=True, eq=False)
class TouchRig:
    """The connected devices of one bench."""

    name: str  # "fake", "panda" or "fr3"
    title: str  # its name for an operator
    key: str  # the folder name of its touch-offs
    tool_name: str
    arm: GuardedArm
    hand: Hand
    grasp: Grasp
    empty: HeldTool  # empty hand, over the first assumed table
    loaded: HeldTool  # with the tool, as designed
    plan: Plan
    home_rad: Array  # (7,) posture for handing over the tool, and at the end
    tool_there: Callable[[bool], None]  # True: the tool is offered between the open fingers; False: taken away
    release: Release = field(default_factory=Release)  # the questions that let arm and hand move

    @property
    def is_real(self) -> bool:
        """Whether a real arm moves, which can hurt somebody."""
        return not is_simulated(self.name)
