"""Measures the time offset between camera and arm, from a short motion recorded by both.

The board's corners in each frame are compared with their predicted places from the joints. The time offset is fitted
together with a constant shift of the image, so that an error of the calibration is not taken for one of the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calib.bundle import Unknowns, motion, predict
from calib.projection import project
from calib.types import TIME_OFFSET, Check, Forward, Grade, Setup, Solution
from hw.types import Array
from perception.board.types import Corners

LIMIT_MS = 5.0
SEARCH_S = 0.25
MIN_FRAMES = 6
MIN_SPEED_PX_S = 40.0
"""Lowest speed (px/s): below it, noise of 0.2 px is as large as the limit itself."""


def time_offset(
    frames: Sequence[tuple[float, Corners]],
    arm_t_s: Array,
    q_rad: Array,
    solution: Solution,
    setup: Setup,
    forward: Forward,
) -> Check:
    """Camera stamps minus arm stamps of the same moment, in ms: subtract it from the camera's stamps.

    From frames (time stamp, corners) and the arm's log (M,), (M, n) of the same motion. Not measured if the motion is
    too short or too slow.
    """
    order = np.argsort([t for t, _ in frames], kind="stable")
    usable = [frames[i] for i in order if len(frames[i][1]) >= 6]
    if len(usable) < MIN_FRAMES:
        return Check.unmeasured(
            TIME_OFFSET, f"{len(usable)} frames of the motion show the board, but {MIN_FRAMES} are needed"
        )
    arm_t_s, q_rad = np.asarray(arm_t_s), np.asarray(q_rad)
    grid = np.broadcast_to(setup.board.p_MK_m, (len(usable), setup.board.corners, 3))

    def pixels(times_s: Array) -> Array:
        """(N, 2) predicted mean pixel of the corners of each frame, at `times_s` (N,)."""
        q = np.stack([np.interp(times_s, arm_t_s, column) for column in q_rad.T], axis=-1)
        moved = motion(setup.mounting, forward, q, None)
        offsets = solution.offsets_rad(q.shape[1])
        X_CM = predict(Unknowns(solution.X_AC[None], solution.X_HM, offsets), moved)
        uv = project(setup.colour, X_CM, grid)
        return np.stack([uv[i, corners.ids].mean(axis=0) for i, (_, corners) in enumerate(usable)])

    shifts = np.linspace(-SEARCH_S, SEARCH_S, 51)
    cost = [float(np.sum(_residual(usable, pixels, s)[0] ** 2)) for s in shifts]
    best = float(shifts[int(np.argmin(cost))])
    sigma = np.inf
    for _ in range(8):
        r, slope, speed = _residual(usable, pixels, best)
        if float(slope @ slope) < 1e-12 or speed < MIN_SPEED_PX_S:
            return Check.unmeasured(
                TIME_OFFSET, f"the board moved by {speed:.0f} px/s, but {MIN_SPEED_PX_S:.0f} are needed"
            )
        step = -float(slope @ r) / float(slope @ slope)
        best += float(np.clip(step, -0.02, 0.02))
        sigma = float(np.sqrt(r @ r / (len(r) - 3) / (slope @ slope)))
        if abs(step) < 1e-6:
            break
    value = 1e3 * best
    message = (
        f"the camera's time stamps are {value:+.1f} ms (± {1e3 * sigma:.1f}) later than the arm's, limit {LIMIT_MS:g} "
        "ms"
    )
    advice = f": at 0.6 m/s that is {abs(600e-3 * value):.0f} mm. A session subtracts it"
    good = abs(value) <= LIMIT_MS
    return Check.graded(TIME_OFFSET, message, (value, LIMIT_MS, "ms"), advice, good=good, worse=Grade.SUSPECT)


def _residual(
    frames: Sequence[tuple[float, Corners]], pixels: Callable[[Array], Array], offset_s: float
) -> tuple[Array, Array, float]:
    """Predicted minus seen, minus the mean (2 N,); its derivative; the median speed in px/s."""
    stamps = np.array([t for t, _ in frames]) - offset_s
    centres_px = np.stack([corners.px.mean(axis=0) for _, corners in frames])
    h = 2e-3
    late, early = pixels(stamps + h), pixels(stamps - h)
    velocity = (late - early) / (2 * h)
    off = pixels(stamps) - centres_px
    centred = off - off.mean(axis=0)
    slope = -(velocity - velocity.mean(axis=0))
    return centred.ravel(), slope.ravel(), float(np.percentile(np.linalg.norm(velocity, axis=1), 75))
