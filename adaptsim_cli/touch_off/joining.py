"""From devices and a task's tool to the bench of a touch-off: any arm that feels, any hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adaptsim_cli.touch_off.parts import Grasp, Plan, TouchRig
from hw.collision import Tool
from hw.ports import GuardedArm, Hand
from hw.workcell import Workcell
from sim.tasks.task import Task


def touch_rig(
    *,
    name: str,
    title: str,
    key: str,
    arm: GuardedArm,
    hand: Hand,
    task: Task,
    grasp: Grasp,
    cell: Workcell,
    loaded: Tool,
    tool_there: Callable[[bool], None],
    confirm: Callable[[], None] = lambda: None,
) -> TouchRig:
    """Any arm that feels, any hand, with the plan for the task's tool. Raises UnknownName, NotExecutable.

    `cell` is with the empty hand (`sim.panda.feelers.empty_hand`), `loaded` the hand with the tool, of which only the
    feelers may touch.
    """
    from sim.panda.planning import home
    from sim.panda.tool import tool_of
    from sim.panda.touching import Bench

    hardware = task.require_hardware()
    return TouchRig(
        name=name,
        title=title,
        key=key,
        tool_name=f"tool of {task.name}",
        arm=arm,
        hand=hand,
        grasp=grasp,
        empty=Bench(cell, np.eye(4)),
        loaded=Bench(cell.holding(loaded), hardware.X_FT),
        plan=plan_of(task),
        home_rad=home(hardware.X_FT, cell.holding(tool_of(hardware)), hardware.home_pitch_rad),
        tool_there=tool_there,
        confirm=confirm,
    )


def plan_of(task: Task) -> Plan:
    """What is touched for the task's tool. Raises UnknownName."""
    from sim.panda.feelers import touchable
    from sim.panda.touch_plan import table_probes, tool_probes

    touched = touchable(task.require_hardware())
    return Plan(table_probes(touched.centre_m), tool_probes(touched.feelers, touched.centre_m))
