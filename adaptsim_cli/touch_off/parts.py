"""What a touch-off asks of its parts; `wiring` fills these in, tests bring their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from adaptsim_cli.config import is_simulated
from hw.ports import GuardedArm, Hand
from hw.types import Array
from sim.panda.feelers import Touching, touchable
from sim.panda.touch_plan import table_probes, tool_probes
from sim.panda.touching import HeldTool, Probe


@dataclass(frozen=True, eq=False)
class Plan:
    """What is touched, in order."""

    table: tuple[Probe, ...]  # with the closed, empty fingers
    tool: tuple[Probe, ...]  # with the tool; the first one is touched again after the slip check


def plan_of(hardware: Touching) -> Plan:
    """What is touched for a task's tool. Raises UnknownName."""
    touched = touchable(hardware)
    return Plan(table_probes(touched.centre_m), tool_probes(touched.feelers, touched.centre_m))


@dataclass(frozen=True)
class Grasp:
    """How the tool is held."""

    width_m: float = 0.012  # of the handle
    force_N: float = 40.0


@dataclass(frozen=True, eq=False)
class TouchRig:
    """The connected devices of one bench."""

    name: str  # "fake", "panda" or "fr3"
    title: str  # what an operator calls it
    key: str  # the folder name of its touch-offs
    tool_name: str
    arm: GuardedArm
    hand: Hand
    grasp: Grasp
    empty: HeldTool  # with nothing in the hand, the table where it is taken to be at first
    loaded: HeldTool  # with the tool, as designed
    plan: Plan
    home_rad: Array  # (7,) where the tool is handed over and the arm returns to
    tool_there: Callable[[bool], None]  # the tool is held between the open fingers, or was taken away
    confirm: Callable[[], None] = lambda: None  # has a real arm's first motion confirmed. Raises StoppedByOperator

    @property
    def is_real(self) -> bool:
        """Whether its arm can hurt somebody."""
        return not is_simulated(self.name)
