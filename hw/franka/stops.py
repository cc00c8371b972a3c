"""Time and distance of a stop, from the log of a braked motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.franka.playback import NONSENSE, STILL_RAD_S, Played
from hw.kinematics import forward
from hw.watchdog import IN_WORDS

WHY = {**IN_WORDS, NONSENSE: "the arm reported a number that is none"}


@dataclass(frozen=True)
class StopReport:
    """Times on the arm's clock and the measured travel of the flange, counted from the player's decision to stop."""

    why: str  # "pedal", "request", "silence", "orphaned" or "touch"
    at_s: float  # path time
    braking_after_s: float  # until the first slowed command
    still_after_s: float  # until every joint stays slower than `STILL_RAD_S`
    way_m: float  # travel of the flange until then
    braked_clock_s: float  # time.monotonic() of the first slowed command

    def __str__(self) -> str:
        return (
            f"{self.at_s:.3f} s into the path; braking began after {1e3 * self.braking_after_s:.0f} ms, the arm stood "
            f"still after {1e3 * self.still_after_s:.0f} ms and {1e3 * self.way_m:.1f} mm"
        )


def stop_report(played: Played) -> StopReport | None:
    """None if nothing was braked."""
    if not played.stop_wanted or played.braked_at < 0:
        return None
    first = played.wanted_at
    moving = np.flatnonzero(np.abs(played.dq_measured_rad_s[first:]).max(axis=1) >= STILL_RAD_S)
    still = min(first + (int(moving[-1]) + 1 if len(moving) else 0), len(played.t_s) - 1)
    flange_m = forward(played.q_measured_rad[first : still + 1])[:, :3, 3]
    return StopReport(
        played.stop_wanted,
        float(played.t_s[first]),
        float(played.t_s[played.braked_at] - played.t_s[first]),
        float(played.t_s[still] - played.t_s[first]),
        float(np.linalg.norm(np.diff(flange_m, axis=0), axis=1).sum()),
        float(played.clock_s[played.braked_at]),
    )
