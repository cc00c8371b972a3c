"""From devices and a task's tool to the bench of a touch-off: any arm that feels, any hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adaptsim_cli.touch_off.parts import Grasp, Plan, TouchRig
from hw.collision import LEVEL, KeepOut, Table, Tool
from hw.ports import GuardedArm, Hand
from hw.types import Array, JointPath
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
    zeros_rad: Array,
    keep_out: tuple[KeepOut, ...],
    tool_there: Callable[[bool], None],
    table: Table = LEVEL,
    confirm: Callable[[], None] = lambda: None,
) -> TouchRig:
    """Any arm that feels, any hand, with the plan for the task's tool. Raises UnknownName, NotExecutable."""
    from sim.panda.detours import free_path
    from sim.panda.feelers import empty_hand, feeling
    from sim.panda.planning import home
    from sim.panda.tool import held
    from sim.panda.touching import Bench

    model = arm.model

    def way(q_from: Array, q_to: Array, tool: Tool) -> JointPath:
        return free_path(q_from, q_to, model, tool, keep_out, table)

    return TouchRig(
        name=name,
        title=title,
        key=key,
        tool_name=f"tool of {task.name}",
        arm=arm,
        hand=hand,
        grasp=grasp,
        empty=Bench(model, np.eye(4), empty_hand(), keep_out),
        loaded=Bench(model, task.X_FT, feeling(task, task.X_FT), keep_out),
        plan=plan_of(task),
        zeros_rad=zeros_rad,
        home_rad=home(task.X_FT, model, held(task.X_FT, task.keep_clear), task.home_pitch_rad),
        way=way,
        tool_there=tool_there,
        table=table,
        confirm=confirm,
    )


def plan_of(task: Task) -> Plan:
    """What is touched for the task's tool. Raises UnknownName."""
    from sim.panda.feelers import touchable
    from sim.panda.touch_plan import table_probes, tool_probes

    touched = touchable(task)
    return Plan(table_probes(touched.centre_m), tool_probes(touched.feelers, touched.centre_m))
