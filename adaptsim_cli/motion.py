"""One motion chosen by hand: planned, checked, and explained. `preview` shows it, `rollout` executes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from adaptsim_cli import values
from adaptsim_cli.errors import UsageError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from hw.limits import LimitReport
    from hw.types import Array, JointPath
    from sim.preview import Preview
    from sim.tasks.task import Task

PATHS = ("approach", "task", "way back")


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """The three paths of a trial with what they use of every limit."""

    task: Task
    arm: str
    context: Array  # (c,)
    action: Array  # (a,)
    paths: tuple[JointPath, JointPath, JointPath]
    reports: tuple[LimitReport, LimitReport, LimitReport]

    def page(self) -> Preview:
        """The motion in a browser."""
        from sim.preview import Preview

        return Preview(self.task, self.context, self.paths)

    def as_json(self) -> dict[str, Any]:
        return {
            "task": self.task.name,
            "arm": self.arm,
            "context": dict(zip(self.task.context.names, self.context.tolist(), strict=True)),
            "action": dict(zip(self.task.action.names, self.action.tolist(), strict=True)),
            "duration_s": [path.duration_s for path in self.paths],
            "limits": [
                {"path": name, **{key: getattr(check, key) for key in _COLUMNS}}
                for name, report in zip(PATHS, self.reports, strict=True)
                for check in report.checks
            ],
        }

    def table(self) -> RenderableType:
        """Every limit of the task's path, then the tightest of the two others."""
        from rich.console import Group
        from rich.text import Text

        from adaptsim_cli import views

        approach, task, back = self.reports
        head = Text.assemble((f"{self.arm}: ", "bold"), f"{self.paths[1].duration_s:.2f} s of motion")
        body = [
            (c.quantity, c.where, f"{c.t_s:.2f}", f"{c.value:.4g}", f"{c.limit:.4g} {c.unit}", f"{100 * c.ratio:.0f} %")
            for c in sorted(task.checks, key=lambda check: -check.ratio)
        ]
        rows = views.rows(("limit", "where", "at s", "value", "allowed", "used"), body, right=(2, 3, 5))
        others = [
            Text(f"{name}, {path.duration_s:.1f} s: at most {100 * report.worst.ratio:.0f} %, {report.worst}")
            for name, path, report in ((PATHS[0], self.paths[0], approach), (PATHS[2], self.paths[2], back))
        ]
        return Group(
            head,
            Text(f"context {views.values(self.task.context, self.context)}"),
            Text(f"action {views.values(self.task.action, self.action)}"),
            Text(""),
            rows,
            Text(""),
            *others,
        )


_COLUMNS = ("quantity", "where", "t_s", "value", "limit", "unit", "ratio")


def planned(task_name: str, arm: str, context: Sequence[str], action: Sequence[str]) -> PlannedMotion:
    """The motion for values typed as name=value; what is not given is the middle of its range.

    Raises UsageError for values or a task that cannot be planned, NotExecutable or MotionRefused (also where no
    stop along the path keeps the limits) where the arm cannot do it.
    """
    import numpy as np

    from hw.limits import LIMITS, require
    from sim.panda.planning import home, trial_paths
    from sim.panda.tool import held
    from sim.tasks import get_task

    task = get_task(task_name)
    if task.plan is None:
        raise UsageError(f"the task {task.name} has no motion for a robot arm; it runs in simulation only")
    if arm not in LIMITS:
        raise UsageError(f"--arm {arm}: it is one of {', '.join(LIMITS)}")
    where = values.point(task.context, context, task.reference_context, "--context")
    middle = task.action.denormalise(np.full(len(task.action), 0.5))
    how = values.point(task.action, action, middle, "--action")
    tool = held(task.X_FT, task.keep_clear)
    paths = trial_paths(task.plan(where, how), task.X_FT, arm, home(task.X_FT, arm, tool), tool=tool)
    approach, motion, back = (require(path, arm, None, (), tool) for path in paths)
    return PlannedMotion(task, arm, where, how, paths, (approach, motion, back))
