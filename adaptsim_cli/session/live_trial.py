"""A running trial: placed and planned, moved, tracked. Its records (`records.py`) are stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from adaptsim_cli.session.records import Film, KeyMoment
from hw.errors import HardwareError
from hw.types import Array
from perception.errors import TrackingFailed
from perception.types import ObjectTrack
from sim.adaptation.sessions import Progress, silently
from sim.adaptation.stages import TrialKey


@dataclass(frozen=True, eq=False)
class MotionPreview:
    """One planned trial to look at, before anything moves."""

    picture: bytes  # JPEG: start area, goal, and the object found
    size_px: tuple[int, int]  # of the picture: width, height
    path_px: Array  # (M, 2) path of the tool in the picture, during its motion
    path_m: Array  # (M, 3) the same in the base frame
    t_s: Array  # (K,) from the start of the approach to the end of the way back
    arm_m: Array  # (K, J, 3) base, joints, flange and tool at these times, in the base frame
    motion_s: tuple[float, float]  # start and end of the tool's own motion
    spot_m: Array  # (2,) the object's measured place
    area_m: Array  # (4,) allowed area: low x, high x, low y, high y
    goal_m: Array | None  # (2,) where it should come to rest, for a task with such a goal


AT_ONCE = (
    "The motion starts at once. Ctrl-C stops it along its path; then this trial does not count. Did you see it "
    "fail? Type r and Enter while the arm goes back: the trial is rejected before it is tracked."
)


@dataclass(frozen=True, eq=False)
class PlacedTrial:
    """A trial whose object is in its place, as `Target.place` gives it."""

    drawn: Array  # (c,) the wanted context
    context: Array  # (c,) as measured, for the task policy
    key: TrialKey


@dataclass(frozen=True, eq=False)
class PlannedTrial(PlacedTrial):
    """A trial whose motion was planned and checked, as `Target.plan` gives it."""

    action: Array  # (a,)
    summary: str = ""  # the plan in one sentence
    announcement: str = ""  # what happens if the operator agrees, in one sentence
    then: str = AT_ONCE  # what the agreement leads to
    overlay: bytes | None = None  # JPEG of the detection; None without a camera
    overlay_file: Path | None = None  # `overlay`, as the operator may open it
    preview: MotionPreview | None = None  # None without a camera
    digest: str = ""  # of the first motion, as it is played: the operator's answer releases it and no other


class Motion(Protocol):
    """A motion that is over, with its recording. Only its target has the recording, and can track it."""

    @property
    def stopped(self) -> HardwareError | None:
        """The error that ended the motion early, or None. Its recording is kept for inspection and does not count."""

    def files(self) -> Mapping[str, bytes]:
        """The recorded files, name -> content; call it once, before `track`. Waits for frames still compressed."""

    def track(self, progress: Progress = silently) -> TrackedTrial:
        """Track the object in the recording. Uses no device. Raises ObjectNotFound, TrackingFailed."""


@dataclass(frozen=True, eq=False)
class TrackedTrial:
    """A motion with its track, and the pictures and files that support the track."""

    track: ObjectTrack
    track_px: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (N, 2) the object's centre in the picture
    moments: tuple[KeyMoment, ...] = ()
    film: Film | None = None
    files: Mapping[str, bytes] = field(default_factory=dict)  # name -> content
    control_success_rate: float = 1.0


class OutcomeUndecided(TrackingFailed):
    """The camera followed the object but did not see how the trial ended. A person may state it, or the trial is
    repeated.
    """

    def __init__(self, message: str, tracked: TrackedTrial) -> None:
        super().__init__(message)
        self.tracked = tracked
        """The tracked trial; its outcome means nothing."""
