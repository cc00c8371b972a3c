"""Joins the real parts of a touch-off."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from adaptsim_cli.config import Config, Places
from adaptsim_cli.touch_off.parts import Grasp, Plan, TouchRig
from adaptsim_cli.wiring_calibration import calibration_key, current_calibration
from hw.collision import KeepOut, Tool, camera_box
from hw.errors import DeviceUnavailable
from hw.ports import GuardedArm, Hand
from hw.types import Array, JointPath
from sim.tasks.task import Task


@contextmanager
def open_touch_rig(config: Config, places: Places, grasp: Grasp) -> Iterator[TouchRig]:
    """Arm and hand, connected. Raises SimError, DeviceUnavailable, SessionError."""
    if config.hw != "fake":
        raise DeviceUnavailable(
            f"hw = {config.hw}: the driver of this arm does not report external torques yet, so it cannot stop at a "
            "touch, and nothing has moved. Use --hw fake for the simulated lab"
        )
    from sim.lab import READY_RAD, SimulatedLab
    from sim.lab.touch import TouchLab
    from sim.tasks import get_task
    from sim.world import load_world

    task = get_task(config.task)
    world = load_world(config.world, task)
    known = current_calibration(config, places)
    zeros_rad = np.zeros(7) if known is None else known.offsets_rad()
    X_BC = SimulatedLab(task, world, config.seed).nominal_calibration().X_BC if known is None else np.array(known.X_AC)
    keep_out = (camera_box(X_BC),)
    with TouchLab(task, world, config.seed, home_q_rad=READY_RAD - zeros_rad, keep_out=keep_out) as lab:
        yield touch_rig(
            name="fake",
            title=f"simulated lab, world {world.name}",
            key=calibration_key(config),
            arm=lab.arm,
            hand=lab.hand,
            task=task,
            grasp=grasp,
            zeros_rad=zeros_rad,
            keep_out=keep_out,
            tool_there=lab.offer_tool,
        )


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
) -> TouchRig:
    """Any arm that feels, any hand, with the plan for the task's tool. Raises UnknownName, NotExecutable."""
    from sim.panda.detours import free_path
    from sim.panda.feelers import empty_hand, feeling, touchable
    from sim.panda.planning import home
    from sim.panda.tool import held
    from sim.panda.touch_plan import table_probes, tool_probes
    from sim.panda.touching import Bench

    touched, model = touchable(task), arm.model

    def way(q_from: Array, q_to: Array, tool: Tool) -> JointPath:
        return free_path(q_from, q_to, model, tool, keep_out)

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
        plan=Plan(table_probes(touched.centre_m), tool_probes(touched.feelers, touched.centre_m)),
        zeros_rad=zeros_rad,
        home_rad=home(task.X_FT, model, held(task.X_FT, task.keep_clear)),
        way=way,
        tool_there=tool_there,
    )
