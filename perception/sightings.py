"""Whether an object was seen often enough and long enough for an outcome, and whether it was seen leaving."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from perception.errors import TrackingFailed
from perception.geometry import Area
from perception.types import ObjectTrack

BEFORE_SHARE, END_SHARE = 1 / 3, 0.5
"""Shares of the frames, of the whole trial and of its end, in which the object has to be seen for an outcome."""
_AWAY_S = 0.10  # an object that leaves the searched area within this time after its last sighting has left
_LATELY_S = 0.20  # its speed is that of its sightings of this time
_LEAVES_M_S = 0.05  # an object that is slower did not leave by itself

Mask = NDArray[np.bool_]


class OutcomeUnseen(TrackingFailed):
    """Too few frames show the object, before the end of the trial or at it, for an outcome."""

    def __init__(self, message: str, track: ObjectTrack, followed: bool) -> None:
        super().__init__(message)
        self.track = track
        """The known places of the object. The outcome of this track means nothing."""
        self.followed = followed
        """Whether enough frames of the whole trial show it, and only its end is unseen."""


def require_seen(what: str, track: ObjectTrack, visible: Mask, at_end: Mask) -> None:
    """Raises OutcomeUnseen, with `track`, if too few frames show the object.

    `visible` (N,) are the frames that show it, `at_end` (N,) those that decide about the outcome.
    """
    counts = ((visible, BEFORE_SHARE, "the trial's"), (visible[at_end], END_SHARE, "its last"))
    few = [
        f"{mask.sum()} of {whose} {len(mask)} frames, and an outcome needs {share:.0%}"
        for mask, share, whose in counts
        if mask.sum() < share * len(mask) or not mask.any()
    ]
    if few:
        raise OutcomeUnseen(
            f"the {what} is seen in {'; in '.join(few)}: how the trial ended is not known. A {what} that stands out "
            "from table and tool, more light, or a camera that sees past the tool makes it visible",
            track,
            followed=bool(visible.mean() >= BEFORE_SHARE),
        )


def require_end(t_s: Array, duration_s: float) -> None:
    """Raises TrackingFailed if the last of the frames' times `t_s` (N,) is before the motion's end at `duration_s`."""
    if t_s[-1] < duration_s:
        raise TrackingFailed(
            f"the film ends at {t_s[-1]:.2f} s, and the motion at {duration_s:.2f} s: how the trial ended is not "
            "known. Check the camera's cable and its USB controller, then repeat the trial"
        )


def seen_leaving(t_s: Array, xy_m: Array, visible: Mask, area: Area) -> bool:
    """Whether the object, last seen at a place of `xy_m` (N, 2) at a time of `t_s` (N,), was then on its way out of
    `area`. It is not enough that the object is no longer seen.
    """
    if not visible.any() or visible[: np.flatnonzero(visible)[-1] + 1].mean() < END_SHARE:
        return False
    times_s, places_m = t_s[visible], xy_m[visible]
    lately = times_s >= times_s[-1] - _LATELY_S
    if lately.sum() < 3:
        return False
    velocity_m_s = np.polyfit(times_s[lately], places_m[lately], 1)[0]
    if float(np.linalg.norm(velocity_m_s)) < _LEAVES_M_S:
        return False
    x, y = places_m[-1] + _AWAY_S * velocity_m_s
    return not (area[0] <= x <= area[1] and area[2] <= y <= area[3])
