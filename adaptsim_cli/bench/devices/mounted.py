"""A task on one arm: tool, workcell, posture between trials, and paths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptsim_cli.bench.rig_file.description import Model, RigDescription, TablePart, ToolPart, as_shipped
from hw.collision import HAND_MASS, KeepOut, Table, Tool
from hw.mass import Mass
from hw.types import Array, frozen_array
from hw.workcell import Workcell, arm_model
from sim.errors import NotExecutable
from sim.panda.tool import ToolCorrection

if TYPE_CHECKING:
    from adaptsim_cli.bench.rig import Paths, Planner
    from sim.tasks.hardware import Hardware
    from sim.tasks.task import Task
    from sim.types import ToolMotion


KEPT = 16
"""The number of plans that a planner caches. A trial needs its newest plan again."""


@dataclass(frozen=True, eq=False)
class MountedTask:
    """Joints and paths here are reported ones, without the joint zeros."""

    task: Task
    hardware: Hardware  # of the task, with X_FT of the tool as mounted
    cell: Workcell
    home_rad: Array  # (7,) between trials
    correction: ToolCorrection
    """The result of a touch-off. Tasks and cameras work in the table's frame W, the arm moves in its base frame B."""
    area: TablePart  # the work area of the tool

    def paths(self, motion: ToolMotion) -> Paths:
        """Approach, motion, way back. Raises NotExecutable, also if the tool leaves the work area."""
        from sim.panda.planning import trial_paths

        p_m = motion.X_BT[:, :2, 3]
        if not self.area.covers(p_m):
            (x0, y0), (x1, y1) = p_m.min(axis=0), p_m.max(axis=0)
            raise NotExecutable(
                f"the tool would work over x {x0:.3f} to {x1:.3f} m, y {y0:+.3f} to {y1:+.3f} m, which is outside the "
                f"work area, x {self.area.x_m}, y {self.area.y_m}: choose another place, or widen [table] of the rig "
                "file"
            )
        in_base, hardware = self.correction.in_base(motion), self.hardware
        return trial_paths(in_base, hardware.X_FT, self.cell, self.home_rad, carries=hardware.carries)

    def planner(self) -> Planner:
        """The planner of a session.

        It caches the newest plans and which of their paths passed the check, because a policy, its prediction and the
        trial need the same motion. The arm checks a path again before it moves.
        """
        from adaptsim_cli.bench.devices.pacing import at_speed
        from adaptsim_cli.bench.rig import Planner
        from hw.kinematics import forward

        planned: dict[tuple[object, ...], Paths] = {}
        check = lru_cache(maxsize=3 * KEPT)(self.cell.require)

        def paths(motion: ToolMotion) -> Paths:
            key = motion.t_s.tobytes(), motion.X_BT.tobytes(), _window(motion)
            if key not in planned:
                if len(planned) == KEPT:
                    del planned[next(iter(planned))]
                planned[key] = self.paths(motion)
            return planned[key]

        X_WB, arm = self.correction.X_WB, self.cell.arm
        return Planner(
            paths,
            check,
            lambda q_rad: np.asarray(X_WB @ forward(arm.true_rad(q_rad))),
            lambda path, pace: at_speed(path, pace, self.cell),
        )


def mounted_task_of(
    task: Task,
    rig: RigDescription,
    zeros_rad: Array,
    keep_out: tuple[KeepOut, ...] = (),
    correction: ToolCorrection | None = None,
) -> MountedTask:
    """The task on the arm of `rig` with the joint zeros (7,). `keep_out` adds boxes to those of the rig.

    `correction` is the result of a touch-off; None: table and tool of the rig file. Raises NoHardware, and
    NotExecutable if the arm cannot hold the tool.
    """
    from sim.panda.planning import home
    from sim.panda.tool import tool_of

    shipped, part = task.require_hardware(), rig.tool(task.name)
    placement = correction or written(rig, task.name)
    X_FT = frozen_array(placement.X_FT(part.designed(shipped.X_FT)), (4, 4), "X_FT")
    hardware = replace(shipped, X_FT=X_FT)
    cell = workcell(rig, zeros_rad, weighed(tool_of(hardware), part), keep_out, placement.table)
    home_rad = home(X_FT, cell, hardware.home_pitch_rad)
    return MountedTask(replace(task, hardware=hardware), hardware, cell, home_rad, placement, rig.table)


def mounted_as_shipped(task: Task, model: Model) -> MountedTask:
    """The task on the arm `model` before any calibration, touch-off or rig file. Raises as `mounted_task_of`."""
    return mounted_task_of(task, as_shipped(model), np.zeros(7))


def workcell(
    rig: RigDescription, zeros_rad: ArrayLike, tool: Tool, keep_out: tuple[KeepOut, ...], table: Table | None = None
) -> Workcell:
    """The workcell of the arm of `rig`. `keep_out` adds boxes; `table` None: that of the rig file."""
    arm = arm_model(rig.arm.model, zeros_rad)
    boxes = (*keep_out, *rig.boxes())
    return Workcell(arm, tool, table or rig.table.plane(), boxes, rig.arm.stops_at_N, rig.arm.stops_at_Nm)


def weighed(tool: Tool, part: ToolPart) -> Tool:
    """`tool` with the mass of the rig file's payload, if the file states one."""
    if part.payload is None:
        return tool
    held = part.held()
    return replace(tool, mass=HAND_MASS + Mass(held.mass_kg, held.com_F_m, held.inertia_F_kg_m2))


def written(rig: RigDescription, task: str) -> ToolCorrection:
    """The table and the tool's pose for a task, as the rig file states them."""
    part = rig.tool(task)
    return ToolCorrection(rig.table.plane(), part.height_m, part.forward_m, part.pitch_rad, part.roll_rad)


def _window(motion: ToolMotion) -> tuple[float, ...]:
    window = motion.contact
    return () if window is None else (window.start_s, window.end_s, window.depth_m, window.force_N)
