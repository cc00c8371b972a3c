"""Writes a rollout as one self-contained HTML page."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from adaptsim_cli.outputs.trials import Rollout
from adaptsim_cli.report import figures
from adaptsim_cli.report.page import both, fill, picture
from adaptsim_cli.storage import durable
from sim.tasks import TASKS, get_task
from sim.types import Dimension

MOMENTS = ("start", "contact", "middle", "lift", "end", "rest")


def write(record: Rollout, folder: Path, out: Path | None = None) -> Path:
    """Write the page (default: `report.html` in the rollout's folder) and return its path. Raises SessionError."""
    path = (out if out is not None else folder / "report.html").absolute()
    durable.make_folder(path.parent)
    durable.replace_file(path, render(record, folder).encode())
    return path


def render(record: Rollout, folder: Path) -> str:
    """The page as HTML."""
    task = get_task(record.task) if record.task in TASKS else None
    known: dict[str, Dimension] = {}
    if task is not None:
        known = {d.name: d for space in (task.parameters, task.context, task.action) for d in space.dimensions}
    track = record.track.track()
    curves = dict(zip(task.observation.curves, task.observation.columns, strict=False)) if task is not None else {}
    drawn = [
        (label, both(partial(figures.one_curve, track.t_s, track.state[:, column], label)))
        for label, column in curves.items()
    ] or [("On the table", both(lambda width: figures.one_path(track.state, record.goal_m, width)))]
    points = {"Context": record.context, "Action": record.action, "Parameters of its policy": record.params}
    return fill(
        "rollout.html.j2",
        record=record,
        name=folder.name,
        title=(task.title[:1].upper() + task.title[1:]) if task is not None else record.task,
        figures=drawn,
        strip=[(m, picture(folder / f"moment-{m}.jpg")) for m in MOMENTS if (folder / f"moment-{m}.jpg").is_file()],
        quantities=[
            (title, [(known.get(name, Dimension(name, "", 0.0, 1.0)), value) for name, value in point.items()])
            for title, point in points.items()
            if point
        ],
    )
