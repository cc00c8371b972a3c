"""A task on one arm: its tool as it hangs there, where it stands between trials, what it keeps out of, its paths."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.errors import UsageError
from hw.collision import KeepOut, Tool
from hw.types import Array, JointPath, frozen_array
from sim.errors import NotExecutable
from sim.panda.correction import ToolCorrection

if TYPE_CHECKING:
    from adaptsim_cli.rigs.description import RigDescription, TablePart
    from adaptsim_cli.session.parts import Paths, Planner
    from hw.limits import LimitReport
    from sim.tasks.task import Task
    from sim.types import ToolMotion


@dataclass(frozen=True, eq=False)
class MountedTask:
    """Joints in here are the true ones; `planner` speaks of those that the arm reports."""

    task: Task  # its X_FT is the tool as it really hangs
    model: str
    tool: Tool
    home_rad: Array  # (7,) between trials
    keep_out: tuple[KeepOut, ...] = ()
    correction: ToolCorrection = field(default_factory=ToolCorrection)
    """What a touch-off found. Tasks plan and cameras see over the table (frame W), the arm moves in its base B."""
    area: TablePart | None = None  # what the tool may work over; None: wherever the arm reaches
    collision_N: float | None = None  # the force along any axis at which this arm stops by itself
    _planned: dict[bytes, Paths] = field(default_factory=dict)

    def paths(self, motion: ToolMotion) -> Paths:
        """Approach, motion, way back. Raises NotExecutable, also where the tool leaves the work area."""
        key = motion.X_BT.tobytes()
        if key not in self._planned:  # asked for by the policy, by its prediction, and by the trial itself
            self._planned[key] = self._plan(motion)
        return self._planned[key]

    def _plan(self, motion: ToolMotion) -> Paths:
        from sim.panda.planning import trial_paths

        p_m = motion.X_BT[:, :2, 3]
        if self.area is not None and not self.area.covers(p_m):
            (x0, y0), (x1, y1) = p_m.min(axis=0), p_m.max(axis=0)
            raise NotExecutable(
                f"the tool would work over x {x0:.3f} to {x1:.3f} m, y {y0:+.3f} to {y1:+.3f} m, which leaves the work "
                f"area, x {self.area.x_m}, y {self.area.y_m}: choose another place, or widen [table] of the rig file"
            )
        return trial_paths(
            self.correction.in_base(motion),
            self.task.X_FT,
            self.model,
            self.home_rad,
            keep_out=self.keep_out,
            tool=self.tool,
            table=self.correction.table,
            carries=self.task.carries,
        )

    def check(self, path: JointPath) -> LimitReport:
        """Everything that the arm refuses, with what is used of each limit. Raises MotionRefused."""
        from hw.limits import require

        return require(path, self.model, None, self.keep_out, self.tool, self.correction.table, self.collision_N)

    @staticmethod
    def reported(path: JointPath, zeros_rad: Array) -> JointPath:
        """A path of true joints as the arm reports and takes it."""
        return replace(path, q_rad=path.q_rad - zeros_rad)

    def planner(self, zeros_rad: Array) -> Planner:
        """`zeros_rad` (7,): true joints are those reported plus these, as calibration found."""
        from adaptsim_cli.session.parts import Planner
        from hw.kinematics import forward

        def paths(motion: ToolMotion) -> Paths:
            there, through, back = (self.reported(path, zeros_rad) for path in self.paths(motion))
            return there, through, back

        def check(path: JointPath, arm: str) -> None:
            self.check(path)

        X_WB = self.correction.X_WB
        return Planner(paths, check, lambda q_rad: np.asarray(X_WB @ forward(q_rad + zeros_rad)))


def mounted(
    task: Task,
    model: str,
    rig: RigDescription | None = None,
    keep_out: tuple[KeepOut, ...] = (),
    correction: ToolCorrection | None = None,
) -> MountedTask:
    """`rig` describes the lab; None: everything as it ships. `keep_out` comes on top of its boxes.

    `correction` is what a touch-off found; None: what the rig file says of table and tool. Raises UsageError for a task
    without a motion, NotExecutable where the arm cannot hold the tool.
    """
    from sim.panda.planning import home
    from sim.panda.tool import held

    if task.plan is None:
        raise UsageError(f"the task {task.name} has no motion for a robot arm; it runs in simulation only")
    found = correction or (ToolCorrection() if rig is None else written(rig, task.name))
    designed = task.X_FT if rig is None else rig.tool(task.name).designed(task.X_FT)
    there = replace(task, X_FT=frozen_array(found.X_FT(designed), (4, 4), "X_FT"))
    tool = held(there.X_FT, there.keep_clear)
    home_rad = home(there.X_FT, model, tool, there.home_pitch_rad)
    if rig is None:
        return MountedTask(there, model, tool, home_rad, keep_out, found)
    boxes, force_N = (*keep_out, *rig.boxes()), rig.arm.settings().collision.contact_force_limit_N
    return MountedTask(there, model, tool, home_rad, boxes, found, rig.table, force_N)


def written(rig: RigDescription, task: str) -> ToolCorrection:
    """What the rig file says of the table, and of how the tool of a task hangs."""
    part = rig.tool(task)
    return ToolCorrection(rig.table.plane(), part.height_m, part.forward_m, part.pitch_rad, part.roll_rad)
