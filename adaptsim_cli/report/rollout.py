"""Writes a rollout as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.report import path_figures
from adaptsim_cli.report.page import both, fill, picture
from adaptsim_cli.storage import durable
from sim.tasks import TASKS, get_task
from sim.types import Dimension

MOMENTS = ("start", "contact", "middle", "lift", "end", "rest")


def write(record: Mapping[str, Any], folder: Path, out: Path | None = None) -> Path:
    """Write the page (default: `report.html` in the rollout's folder) and return its path. Raises SessionError."""
    path = (out if out is not None else folder / "report.html").absolute()
    durable.make_folder(path.parent)
    durable.replace_file(path, render(record, folder).encode())
    return path


def render(record: Mapping[str, Any], folder: Path) -> str:
    """The page as HTML."""
    task = get_task(record["task"]) if record["task"] in TASKS else None
    spaces = {"Context": "context", "Action": "action", "Parameters of its policy": "params"}
    known: dict[str, Dimension] = {}
    if task is not None:
        known = {d.name: d for space in (task.parameters, task.context, task.action) for d in space.dimensions}
    track = np.array(record["track"]["state"], dtype=np.float64)
    times = np.array(record["track"]["t_s"], dtype=np.float64)
    curves = dict(zip(task.observation.curves, task.observation.columns, strict=False)) if task is not None else {}
    figures = [
        (label, both(partial(path_figures.one_curve, times, track[:, column], label)))
        for label, column in curves.items()
    ] or [("On the table", both(lambda width: path_figures.one_path(track, record.get("goal_m"), width)))]
    return fill(
        "rollout.html.j2",
        record=record,
        name=folder.name,
        title=(task.title[:1].upper() + task.title[1:]) if task is not None else record["task"],
        figures=figures,
        strip=[(m, picture(folder / f"moment-{m}.jpg")) for m in MOMENTS if (folder / f"moment-{m}.jpg").is_file()],
        quantities=[
            (title, [(known.get(name, Dimension(name, "", 0.0, 1.0)), value) for name, value in record[key].items()])
            for title, key in spaces.items()
            if record.get(key)
        ],
    )
