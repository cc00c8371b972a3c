"""Tracks the films and compares every outcome with the truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.devices.trackers import tracker_of
from adaptsim_cli.session import recording
from adaptsim_cli.session.rig_tracking import come_home, shown_at_home, track_request
from adaptsim_cli.session.topics import joints_at
from hw.types import Array
from perception.errors import PerceptionError
from perception.piece.tracking import reach_of
from perception.sightings import OutcomeUnseen
from perception.types import Outcome
from sensing.filming import TRUTH
from sim.tasks.task import Task

DOUBTED = "outcome uncertain"


@dataclass(frozen=True)
class Judged:
    """One trial: its outcome by the camera against the truth."""

    name: str
    true: str
    tracked: str  # "": refused
    refused: str  # why; "": it counts
    flags: tuple[str, ...]
    end_mm: float  # between the object's tracked and true place at the end
    found_mm: float  # the same before the motion
    luminance: float

    @property
    def is_wrong(self) -> bool:
        """Whether it counts, with another outcome than the true one."""
        return not self.refused and self.tracked != self.true

    @property
    def is_doubted(self) -> bool:
        """Whether a flag says that the outcome is uncertain."""
        return any(DOUBTED in flag for flag in self.flags)


def judged(task: Task, folder: Path) -> Judged:
    """Find and track the object of a film, as a session does."""
    truth = json.loads((folder / TRUTH).read_text())
    film, mount = recording.read(folder / recording.FILE), mounted_as_shipped(task, "panda")
    hardware, planner, tracker = mount.task.require_hardware(), mount.planner(), tracker_of(mount.task)
    q_at = joints_at(film.execution)
    places_m = np.array(truth["xyz_m"])

    def X_BT_at(t_s: float) -> Array:
        return np.asarray(planner.flange(q_at(t_s)) @ hardware.X_FT)

    end_mm = found_mm = float("nan")
    tracked, refused, flags, true = "", "", tuple[str, ...](), truth["outcome"]
    try:
        detection = tracker.find(film.before, film.model, film.X_BC)
        found_mm = 1e3 * float(np.linalg.norm(detection.xy_m - places_m[0, :2]))
        if true == Outcome.ON_TABLE and _left(detection, places_m[-1, :2]):
            true = Outcome.LOST.value  # it rolled farther than it is followed; both earn nothing
        duration_s = float(hardware.plan(np.array(truth["context"]), np.array(truth["action"])).t_s[-1])
        try:
            track = come_home(
                tracker, film, detection, tracker.track(track_request(film, detection, X_BT_at, duration_s))
            )
        except OutcomeUnseen as unseen:
            at_home = shown_at_home(tracker, film, detection, unseen.track) if unseen.followed else None
            if at_home is None:
                raise
            track = at_home
        end_s = track.t_s[-1] + film.execution.t_start_s
        at_m = np.array([np.interp(end_s, truth["t_s"], column) for column in places_m.T])
        end_mm = 1e3 * float(np.linalg.norm(track.state[-1, :2] - at_m[:2]))
        tracked, flags = track.outcome.value, track.flags
    except PerceptionError as error:
        refused = str(error)
    return Judged(folder.name, true, tracked, refused, flags, end_mm, found_mm, truth["luminance"])


def _left(detection: Any, end_m: Array) -> bool:
    """Whether a piece ended outside of the part of the table on which it is followed."""
    x_low, x_high, y_low, y_high = reach_of(detection)
    return not (x_low <= end_m[0] <= x_high and y_low <= end_m[1] <= y_high)
