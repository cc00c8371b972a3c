"""One motion chosen by hand: planned, checked, and explained. `preview` shows it, `rollout` executes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast, get_args

from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import quantities, views

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptsim_cli.bench.devices.mounted import MountedTask
    from adaptsim_cli.config import Config, Resolved
    from hw.limits import LimitReport, Worst
    from hw.types import Array, JointPath
    from sim.lab.preview import PathPreview
    from sim.tasks.task import Task

PATHS = ("approach", "task", "way back")


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """The three paths of a trial, and how close they come to every limit."""

    mounted_task: MountedTask
    context: Array  # (c,)
    action: Array  # (a,)
    paths: tuple[JointPath, JointPath, JointPath]
    reports: tuple[LimitReport, LimitReport, LimitReport]

    @property
    def task(self) -> Task:
        """The task with the tool as mounted."""
        return self.mounted_task.task

    def page(self) -> PathPreview:
        """The motion in a browser."""
        from sim.lab.preview import PathPreview

        page, area, cell = (
            PathPreview(self.task, self.context, self.paths),
            self.mounted_task.area,
            self.mounted_task.cell,
        )
        page.surround(cell.table, area.x_m, area.y_m, cell.keep_out)
        return page

    def html(self) -> str:
        """The motion as one page without a server, with its limits."""
        from adaptsim_cli.screen.html import fill

        arm = self.mounted_task.cell.arm.name
        words = {
            "title": f"{self.task.name} on {arm}: {self.paths[1].duration_s:.2f} s of motion",
            "context": f"Context: {views.values(self.task.context, self.context)}",
            "action": f"Action: {views.values(self.task.action, self.action)}",
            "others": "; ".join(self._others()),
        }
        panel = fill("bench/preview.html.j2", checks=self._by_ratio(), **words)
        return self.page().html(words["title"], panel)

    def _by_ratio(self) -> list[Worst]:
        """The limits of the task's path, the tightest first."""
        return sorted(self.reports[1].checks, key=lambda check: -check.ratio)

    def _others(self) -> tuple[str, str]:
        """The tightest limit of the approach, and that of the way back."""
        first, _, last = (
            f"{name}, {path.duration_s:.1f} s: at most {100 * report.worst.ratio:.0f} %, {report.worst}"
            for name, path, report in zip(PATHS, self.paths, self.reports, strict=True)
        )
        return first, last

    def next_step(self, config: Config) -> tuple[str, str]:
        """The command that makes this motion, and its effect."""
        where = "" if config.is_simulated else f" --hw {config.hw}"
        named = dict(zip(self.task.action.names, self.action.tolist(), strict=True))
        action = views.typed("--action", named)
        return f"adaptsim rollout --task {self.task.name}{where} {action}", "makes it once, and adapts nothing"

    def as_json(self) -> dict[str, Any]:
        """The object that `preview --json` prints."""
        return {
            "task": self.task.name,
            "arm": self.mounted_task.cell.arm.name,
            "units": {d.name: d.unit for space in (self.task.context, self.task.action) for d in space.dimensions},
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
        """Every limit of the task's path, then the tightest limit of the two other paths."""
        from rich.console import Group
        from rich.text import Text

        from adaptsim_cli.screen import views

        head = Text.assemble(
            (f"{self.mounted_task.cell.arm.name}: ", "bold"), f"{self.paths[1].duration_s:.2f} s of motion"
        )
        body = [
            (c.quantity, c.where, f"{c.t_s:.2f}", f"{c.value:.4g}", f"{c.limit:.4g} {c.unit}", f"{100 * c.ratio:.0f} %")
            for c in self._by_ratio()
        ]
        rows = views.rows(("limit", "where", "at s", "value", "allowed", "used"), body, right=(2, 3, 5))
        return Group(
            head,
            Text(f"context {views.values(self.task.context, self.context)}"),
            Text(f"action {views.values(self.task.action, self.action)}"),
            Text(""),
            rows,
            Text(""),
            *map(Text, self._others()),
        )


_COLUMNS = ("quantity", "where", "t_s", "value", "limit", "unit", "ratio")


def mounted_for(resolved: Resolved, arm: str | None) -> MountedTask:
    """The task on the named `arm` with default settings; else in the lab of the rig file, if the settings name a real
    arm or practise a setup; else on a Panda.

    Raises UsageError, NoHardware, NotExecutable, SessionError for an unreadable calibration, PreflightFailed for a
    stale touch-off.
    """
    import numpy as np

    from adaptsim_cli.bench.calibration_in_use import current_calibration
    from adaptsim_cli.bench.devices.mounted import mounted_as_shipped, mounted_task_of
    from adaptsim_cli.bench.rig_file.description import Model
    from adaptsim_cli.bench.rig_file.reading import practised, rig_of, tasks_with_tools
    from adaptsim_cli.bench.touch_off_in_use import correction_by, touch_off_of
    from hw.collision import camera_box
    from sim.tasks import get_task

    config = resolved.config
    task, models = get_task(config.task), get_args(Model)
    if arm is not None or (config.is_simulated and not practised(config)):
        if arm not in (None, *models):
            raise UsageError(f"--arm {arm}: choose one of {', '.join(models)}")
        return mounted_as_shipped(task, cast(Model, arm or "panda"))
    calibration = current_calibration(config, resolved.places)
    boxes = () if calibration is None else (camera_box(calibration.hand_eye().X_BC),)
    zeros_rad = np.zeros(7) if calibration is None else calibration.offsets_rad()
    rig = rig_of(config, tasks_with_tools())
    touched = touch_off_of(config, resolved.places, task, zeros_rad)
    correction = None if touched is None else correction_by(touched, rig, task)
    return mounted_task_of(task, rig, zeros_rad, boxes, correction)


def planned(mounted_task: MountedTask, context: Sequence[str], action: Sequence[str]) -> PlannedMotion:
    """The motion for values typed as name=value; missing ones are in the middle of their range.

    Raises UsageError for wrong values, NotExecutable or MotionRefused (also if no stop along the path keeps the limits)
    if the arm cannot do it.
    """

    task = mounted_task.task
    where = quantities.point(task.context, context, task.reference_context, "--context")
    middle = task.action.middle
    how = quantities.point(task.action, action, middle, "--action")
    paths = mounted_task.paths(mounted_task.hardware.plan(where, how))
    approach, motion, back = (mounted_task.cell.require(path) for path in paths)
    return PlannedMotion(mounted_task, where, how, paths, (approach, motion, back))
