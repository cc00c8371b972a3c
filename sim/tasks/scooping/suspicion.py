"""The fault at which the first scoops of a session hint: an edge that passes too high over the table."""

from __future__ import annotations

from collections.abc import Sequence

from perception.types import ObjectTrack, Outcome
from sim.types import Suspicion

FIRST = 4
"""Number of scoops that must have failed alike. By chance alone a fair policy does that once in many sessions."""
PUSHED_M = 0.05
"""A piece that the blade pushed ahead, instead of going under it, lies at least this much farther."""


def edge_too_high(tracks: Sequence[ObjectTrack]) -> Suspicion | None:
    """The suspicion, if no piece was ever scooped and the first ones were all pushed along the table; else None."""
    if len(tracks) < FIRST or any(track.outcome is Outcome.ON_BLADE for track in tracks):
        return None
    if not all(_pushed(track) for track in tracks[:FIRST]):
        return None
    return Suspicion(
        question="Is the edge too high?",
        why=f"The first {FIRST} scoops failed alike: the blade pushed the piece ahead and never went under it. An edge "
        "2 mm too high does that to every piece, whatever the parameters.",
        look="Guide the tool to the place where a scoop starts, and pull a strip of paper under the edge: it must be "
        "held fast. If it slides through, touch off again",
    )


def _pushed(track: ObjectTrack) -> bool:
    ahead_m = float(track.state[-1, 0] - track.state[0, 0])
    return track.outcome is Outcome.ON_TABLE and ahead_m >= PUSHED_M
