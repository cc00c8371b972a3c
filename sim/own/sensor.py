"""A sensor with a delay, a gain and a bias, which are ordinary parameters of a task."""

from __future__ import annotations

from typing import Any

import numpy as np

from hw.types import Array


def sensor(times: Any, states: Any, *, delay: float = 0.0, gain: Any = 1.0, bias: Any = 0.0) -> tuple[Array, Array]:
    """A sensor's report of a trajectory: `gain * state(t - delay) + bias` at the same times.

    `times` (N,) in s, `states` (N, k) or (N,); `gain` and `bias` are numbers, or one for each column. The state before
    the start is that of the start.
    """
    t_s, rows = np.asarray(times, dtype=np.float64), np.asarray(states, dtype=np.float64)
    columns = rows[:, None] if rows.ndim == 1 else rows
    late = np.stack([np.interp(t_s - delay, t_s, column) for column in columns.T], axis=-1)
    return t_s, np.asarray(gain) * late.reshape(rows.shape) + np.asarray(bias)
