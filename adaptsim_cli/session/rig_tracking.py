"""Tracking on a rig: the request to the tracker, and the outcome as the arm is home again."""

from __future__ import annotations

from collections.abc import Callable

from adaptsim_cli.bench.rig import Detection, Tracker, TrackRequest
from adaptsim_cli.session import recording
from adaptsim_cli.session.topics import joints_at
from hw.types import Array
from perception.types import ObjectTrack


def track_request(
    stored: recording.Recording, detection: Detection, X_BT_at: Callable[[float], Array], duration_s: float
) -> TrackRequest:
    """The inputs of tracking a recording; the tool moved along `X_BT_at` for `duration_s`."""
    return TrackRequest(
        frames=stored.frames,
        model=stored.model,
        X_BC=stored.X_BC,
        detection=detection,
        X_BT_at=X_BT_at,
        q_at=joints_at(stored.execution),
        t_start_s=stored.execution.t_start_s,
        duration_s=duration_s,
    )


def shown_at_home(
    tracker: Tracker, stored: recording.Recording, detection: Detection, track: ObjectTrack
) -> ObjectTrack | None:
    """The track with the outcome that the picture with the arm at home shows, for an end that was hidden."""
    if stored.after is None:
        return None
    return tracker.lies_at_home(track, detection, stored.before, stored.after, stored.model, stored.X_BC)


def come_home(tracker: Tracker, stored: recording.Recording, detection: Detection, track: ObjectTrack) -> ObjectTrack:
    """The track, with the outcome as the arm is home again, if there is a picture of that."""
    if stored.after is None:
        return track
    return tracker.at_home(track, detection, stored.before, stored.after, stored.model, stored.X_BC)
