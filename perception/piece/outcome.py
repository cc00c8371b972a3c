"""The outcome of a trial with a tool, from the object's final place relative to the blade."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.poses import inverse
from hw.types import Array
from perception.blade import ABOVE_FACE_M, BEHIND_M, BLADE_LENGTH_M, BLADE_WIDTH_M, is_on_blade
from perception.geometry import transform
from perception.piece.proxy import Proxy
from perception.types import Outcome

_LAST_S = 0.20  # the final place is the median over this much time
_UNSURE_M = 0.004
_MOVING_M_S = 0.03
_SEEN = 0.15


@dataclass(frozen=True, eq=False)
class TrialEnd:
    """The end of a trial."""

    outcome: Outcome
    end_in_tool_m: Array  # (3,)
    flags: tuple[str, ...]


def judge(t_s: Array, state_m: Array, confidence: Array, X_BT: Array, duration_s: float, proxy: Proxy) -> TrialEnd:
    """Outcome from centres (N, 3) and tool poses (N, 4, 4) at `t_s` (N,) since the start of a motion.

    On the blade: more than 1 mm above its face and inside its outline, or held by the neck behind it. Lost: not seen in
    the last frames, or below the table top. Else on the table. A piece near a boundary, or still moving, is flagged.
    """
    last = t_s >= max(t_s[-1] - _LAST_S, min(duration_s, t_s[-1]))
    in_tool = np.array([transform(inverse(X), p) for X, p in zip(X_BT[last], state_m[last], strict=True)])
    seen = confidence[last] >= _SEEN
    end = np.median(in_tool[seen] if seen.any() else in_tool, axis=0)
    centre = np.median(state_m[last], axis=0)
    if not seen.any() or centre[2] < -max(proxy.half_m):
        return TrialEnd(Outcome.LOST, end, ("out of sight at the end",))
    inside_m = float(min(end[0] + BLADE_LENGTH_M + BEHIND_M, -end[0], BLADE_WIDTH_M / 2 - abs(end[1])))
    above_m = float(end[2] - ABOVE_FACE_M)
    on_blade = is_on_blade(end) and above_m <= 2 * max(proxy.half_m) + 0.02
    flags = list(_doubts(inside_m, above_m, centre[2] - min(proxy.half_m), on_blade))
    if last.sum() >= 3:
        span_s = float(t_s[last][-1] - t_s[last][0])
        speed_m_s = float(np.linalg.norm(in_tool[-1] - in_tool[0])) / max(span_s, 1e-3)
        if speed_m_s > _MOVING_M_S:
            flags.append(f"still moving against the tool at the end, at {1e3 * speed_m_s:.0f} mm/s")
    return TrialEnd(Outcome.ON_BLADE if on_blade else Outcome.ON_TABLE, end, tuple(flags))


def _doubts(inside_m: float, above_m: float, lift_m: float, on_blade: bool) -> tuple[str, ...]:
    flags = []
    if abs(inside_m) < _UNSURE_M and above_m > -_UNSURE_M:
        flags.append(f"outcome uncertain: {1e3 * abs(inside_m):.0f} mm from the rim of the blade")
    elif abs(above_m) < _UNSURE_M / 2 and inside_m > 0:
        flags.append(f"outcome uncertain: centre {1e3 * above_m:+.0f} mm from the height that counts as on the blade")
    if not on_blade and lift_m > 0.012:
        flags.append(f"outcome uncertain: off the blade, but {1e3 * lift_m:.0f} mm above the table")
    return tuple(flags)
