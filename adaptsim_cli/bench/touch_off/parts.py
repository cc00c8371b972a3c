"""The parts of a touch-off; `bench.touch_off_in_use` provides them, tests bring their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen.release import Release
from hw.collision import Table
from hw.ports import Arm, Hand
from hw.types import Array
from hw.workcell import ArmModel
from sim.panda.setting_down import SetDown


class TouchOffFailed(PreflightFailed):
    """The places contradict each other, or the tool is not held; the earlier result stays in use."""


class PersonAtTool(Protocol):
    """The simulated lab's stand-in for the person who sets the tool down."""

    def offer_tool(self, present: bool) -> None:
        """Hold the tool between the open fingers (True), or take it away."""

    def set_down(self, where: SetDown, number: int) -> None:
        """Guide the tool to the set-down of that number (from 0), and let go."""


@dataclass(frozen=True)
class Grasp:
    """The grasp of the tool."""

    width_m: float  # between the fingers
    force_N: float = 40.0


@dataclass(frozen=True, eq=False)
class HoldingHand:
    """The connected hand that holds the tool."""

    hand: Hand
    grasp: Grasp
    release: Release = field(default_factory=Release)  # the questions that let it move


@dataclass(frozen=True, eq=False)
class GuidedTouchRig:
    """The connected arm of one bench, which a person guides; it never moves by itself. The hand closes on the tool."""

    name: str  # "fake", "panda", "fr3" or "fr3v2"
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
    holding: HoldingHand | None = None  # None: the tool is screwed to the flange
    person: PersonAtTool | None = None  # None: a person at the terminal
