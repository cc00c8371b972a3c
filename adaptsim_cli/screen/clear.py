"""The one question before an arm moves: whether the work area is clear, with the arm's next motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hw.types import Array, JointPath

_EVERY = 20  # samples of a path between two poses for a speed


def clear_to_move(real: bool, what: str, duration_s: float | None = None, speed_m_s: float | None = None) -> str:
    """A question that Enter answers with a start. `what` continues after "then": "goes home", "scoops and goes back".

    Asked before the first motion of a command, and again whenever somebody may have reached in. `speed_m_s` is the
    tool's top speed. Unknown values are left out.
    """
    who = "THE REAL ROBOT" if real else "The simulated robot"
    parts = [f"{duration_s:.0f} s in all" if duration_s is not None and duration_s >= 1.0 else ""]
    parts.append(f"the tool at up to {speed_m_s:.2f} m/s" if speed_m_s is not None else "")
    told = ", ".join(part for part in parts if part)
    return f"Is the work area clear, nobody within reach? {who} then {what}" + (f": {told}" if told else "")


def top_speed_m_s(paths: Sequence[JointPath], pose: Callable[[Array], Array]) -> float:
    """Largest speed of the origin of `pose` (joints (7,) -> (4, 4)) along the paths."""
    return max(_speed_m_s(path, pose) for path in paths)


def _speed_m_s(path: JointPath, pose: Callable[[Array], Array]) -> float:
    kept = np.unique(np.append(np.arange(0, len(path.t_s), _EVERY), len(path.t_s) - 1))
    p_m = np.array([pose(q)[:3, 3] for q in path.q_rad[kept]])
    return float((np.linalg.norm(np.diff(p_m, axis=0), axis=1) / np.diff(path.t_s[kept])).max())
