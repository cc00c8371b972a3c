"""From the frames of a trial to the track of the piece."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.arm_mask import ToolMask
from perception.errors import TrackingFailed
from perception.geometry import Area, Array32, on_plane, transform, view_of
from perception.piece.detection import HEIGHT_M, PieceDetection, brightness, darkness, depth_window, matte, table_offset
from perception.piece.follow import TrackingSetup, follow
from perception.piece.locate import PieceFix
from perception.piece.proxy import Proxy
from perception.piece.registration import tool_shift, turn_camera
from perception.sightings import require_end, require_seen, seen_leaving
from perception.types import (
    ABOVE_FACE_M,
    BEHIND_M,
    BLADE_LENGTH_M,
    BLADE_WIDTH_M,
    SETTLE_S,
    ObjectTrack,
    Outcome,
    in_frames,
    is_on_blade,
)

_LAST_S = 0.20  # the final place is the median over this much time
_UNSURE_M = 0.004
_MOVING_M_S = 0.03
_SEEN = 0.15


def last_frames(t_s: Array, duration_s: float) -> NDArray[np.bool_]:
    """(N,) the frames that decide about the outcome."""
    return np.asarray(t_s >= max(t_s[-1] - _LAST_S, min(duration_s, t_s[-1])))


def outcome_of(
    t_s: Array, state_m: Array, confidence: Array, X_BT: Array, duration_s: float, proxy: Proxy
) -> tuple[Outcome, Array, tuple[str, ...]]:
    """Outcome, final place in the tool frame (3,) and flags, from centres (N, 3) and tool poses (N, 4, 4).

    `t_s` (N,) are times since the start of a motion of `duration_s`.

    On the blade: more than 1 mm above its face and inside its outline, or held by the neck behind it. Lost: below the
    table top. Else on the table. A piece near a boundary, or still moving, is flagged. The piece has to be seen in some
    of the last frames.
    """
    last = last_frames(t_s, duration_s)
    in_tool = np.array([transform(inverse(X), p) for X, p in zip(X_BT[last], state_m[last], strict=True)])
    visible = confidence[last] >= _SEEN
    end = np.median(in_tool[visible] if visible.any() else in_tool, axis=0)
    centre = np.median(state_m[last], axis=0)
    if centre[2] < -max(proxy.half_m):
        return Outcome.LOST, end, ("below the table top at the end",)
    inside_m = float(min(end[0] + BLADE_LENGTH_M + BEHIND_M, -end[0], BLADE_WIDTH_M / 2 - abs(end[1])))
    above_m = float(end[2] - ABOVE_FACE_M)
    on_blade = is_on_blade(end) and above_m <= 2 * max(proxy.half_m) + 0.02
    flags = list(_doubts(inside_m, above_m, centre[2] - min(proxy.half_m), on_blade))
    if last.sum() >= 3:
        span_s = float(t_s[last][-1] - t_s[last][0])
        speed_m_s = float(np.linalg.norm(in_tool[-1] - in_tool[0])) / max(span_s, 1e-3)
        if speed_m_s > _MOVING_M_S:
            flags.append(f"still moving against the tool at the end, at {1e3 * speed_m_s:.0f} mm/s")
    return Outcome.ON_BLADE if on_blade else Outcome.ON_TABLE, end, tuple(flags)


def _doubts(inside_m: float, above_m: float, lift_m: float, on_blade: bool) -> tuple[str, ...]:
    flags = []
    if abs(inside_m) < _UNSURE_M and above_m > -_UNSURE_M:
        flags.append(f"outcome uncertain: {1e3 * abs(inside_m):.0f} mm from the rim of the blade")
    elif abs(above_m) < _UNSURE_M / 2 and inside_m > 0:
        flags.append(f"outcome uncertain: centre {1e3 * above_m:+.0f} mm from the height that counts as on the blade")
    if not on_blade and lift_m > 0.012:
        flags.append(f"outcome uncertain: off the blade, but {1e3 * lift_m:.0f} mm above the table")
    return tuple(flags)


_BACK_M, _FORTH_M, _SIDE_M = 0.25, 0.50, 0.30  # search area around the piece's first place: as far as it may roll
_LEAST, _MOST = 0.25, 3.0  # of its earlier area in pixels
_NEW = 0.5
_RIM_PX = 5


def lies_at(before: Frame, after: Frame, model: CameraModel, X_BC: Array, detection: PieceDetection) -> Array | None:
    """(2,) place on the table, in m, of a new spot with the piece's colour and size; None: no such spot.

    `before` and `after` show the table with the arm at home, `X_BC` (4, 4) is the colour camera in the base frame.
    """
    x, y = detection.xy_m
    area: Area = (x - _BACK_M, x + _FORTH_M, y - _SIDE_M, y + _SIDE_M)
    view = view_of(model.colour, X_BC, area, HEIGHT_M)
    was, now = (likeness(frame.colour[view.rows, view.columns], detection) for frame in (before, after))
    corner = np.array([view.columns.start, view.rows.start])
    place = np.rint(detection.contour_px - corner).astype(np.int32)
    cv2.fillPoly(was, [place], 0.0)  # the piece left its first place, so a spot there now has come back
    cv2.polylines(was, [place], isClosed=True, color=0.0, thickness=_RIM_PX)
    count, _, stats, centroids = cv2.connectedComponentsWithStats((now - was > _NEW).astype(np.uint8), connectivity=8)
    if count < 2:
        return None
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    size = stats[largest, cv2.CC_STAT_AREA] / cv2.contourArea(detection.contour_px.astype(np.float32))
    if not _LEAST <= size <= _MOST:
        return None
    u, v = np.rint(centroids[largest]).astype(int)
    ray = np.array([[*(view.xy[v, u].astype(np.float64) / view.focal_px), 1.0]])
    return np.asarray(on_plane(ray, view.X_BV, detection.centre_m[2])[0])


def likeness(rgb: NDArray[np.uint8], detection: PieceDetection) -> Array32:
    """(h, w) how much each pixel looks like the piece on the table, 0 to 1."""
    if detection.is_dark:
        return darkness(rgb, float(np.median(brightness(rgb))))
    return matte(rgb, detection.piece_chroma, (detection.table_chroma,))


BEFORE_S = 0.05
"""Frames from this long before the motion (s) are used, until the trial is over."""
HIDDEN_AT_THE_END = "the piece was hidden at the end of the motion; with the arm at home it lies on the table"
LOST_ON_THE_WAY = "the piece was on the tool after the motion and lies on the table now: lost on the way home"
_REACH_M = (0.20, 0.50, 0.20)  # backwards, forwards and sideways from the piece's first place
_HIGHEST_M = 0.14
_HIDDEN = 0.25  # a lower visibility is flagged
_FREE = 0.8  # of the frames that show this much of the piece ...
_POOR_FIT = 0.72  # ... the median fit must be better than this (docs/results/tracking.md)
_STILL_M = 0.003  # from its first pose: only a resting tool shows the camera's error
_FAR_OFF_M = 0.003  # a calibration right to 1 mm and 0.1 degrees shows up to 2.5 mm
_MOVED_M = 0.006


def track_piece(
    frames: Sequence[Frame],
    model: CameraModel,
    X_BC: Array,
    detection: PieceDetection,
    tool_mesh: tuple[Array, NDArray[np.integer]],
    X_BT_at: Callable[[float], Array],
    t_start_s: float,
    duration_s: float,
) -> ObjectTrack:
    """The piece's centre through the trial, and how it ended.

    `frames` in order of time; `X_BC` (4, 4) is the colour camera in the base frame; `detection` is from before the
    trial; `tool_mesh` is (vertices (V, 3) in T, triangles (F, 3)); `X_BT_at(t_s)` is the tool's measured pose (4, 4) on
    the clock of the frames; the motion starts at `t_start_s` on that clock and lasts `duration_s`. Frames in which the
    piece cannot be located are bridged, with confidence 0. A piece is lost if it was seen leaving. Raises
    TrackingFailed if no frame falls into the trial, the film ends before the motion, or the piece is in none of the
    frames; OutcomeUnseen if it is in too few of all frames, or of the last ones.
    """
    chosen = [f for f in frames if -BEFORE_S <= f.t_s - t_start_s <= duration_s + SETTLE_S]
    if not chosen:
        raise TrackingFailed(
            f"none of the {len(frames)} frames falls into the trial ({t_start_s:.3f} s, {duration_s:.2f} s long); "
            f"check that camera and arm share one clock"
        )
    poses = [np.asarray(X_BT_at(f.t_s), dtype=np.float64) for f in chosen]
    rig, camera_flags = _prepare(chosen, poses, model, X_BC, detection, ToolMask(*tool_mesh))
    places = follow(rig, chosen, poses)
    if detection.is_dark:  # by depth too, which a noisy camera may not allow: the better seen counts
        places = max(places, follow(replace(rig, by_depth=True), chosen, poses), key=_seen_in_all)
    located = [(f.t_s - t_start_s, place) for f, place in zip(chosen, places, strict=True) if place is not None]
    if not located:
        raise TrackingFailed(
            f"the piece that lay at ({detection.xy_m[0]:.3f}, {detection.xy_m[1]:.3f}) m is in none of "
            f"{len(chosen)} frames; find it again before the trial"
        )
    t_s = np.array([f.t_s - t_start_s for f in chosen])
    centres_m = np.array([place.centre_m for _, place in located])
    at_s = np.array([t for t, _ in located])
    state = np.stack([np.interp(t_s, at_s, column) for column in centres_m.T], axis=1)
    confidence = np.array([0.0 if place is None else place.confidence for place in places])
    outcome, end_in_tool_m, doubts = outcome_of(t_s, state, confidence, np.stack(poses), duration_s, detection.proxy)
    flags = (*camera_flags, *_flags(t_s, places, state, rig.detection), *doubts)
    track, visible = ObjectTrack(t_s, state, outcome, end_in_tool_m, confidence, flags), confidence >= _SEEN
    if seen_leaving(t_s, state[:, :2], visible, reach_of(detection)):
        return replace(track, outcome=Outcome.LOST, flags=(*flags, "it left the camera's view"))
    require_end(t_s, duration_s)
    require_seen("piece", track, visible, last_frames(t_s, duration_s))
    return track


def reach_of(detection: PieceDetection) -> Area:
    """The part of the table on which the piece is followed."""
    x, y = detection.xy_m
    back, forth, side = _REACH_M
    return x - back, x + forth, y - side, y + side


def _seen_in_all(places: Sequence[PieceFix | None]) -> float:
    return sum(place.confidence for place in places if place is not None)


def at_home(
    track: ObjectTrack, detection: PieceDetection, before: Frame, after: Frame, model: CameraModel, X_BC: Array
) -> ObjectTrack:
    """`track`, but a piece that lies on the table once the arm is home again was lost on the way.

    `before` and `after` show the table with the arm at home, `X_BC` (4, 4) is the colour camera in the base frame.
    """
    if track.outcome is not Outcome.ON_BLADE or lies_at(before, after, model, X_BC, detection) is None:
        return track
    return replace(track, outcome=Outcome.ON_TABLE, flags=(*track.flags, LOST_ON_THE_WAY))


def lies_at_home(
    track: ObjectTrack, detection: PieceDetection, before: Frame, after: Frame, model: CameraModel, X_BC: Array
) -> ObjectTrack | None:
    """`track` with the outcome on_table, if the piece lies on the table with the arm at home; else None.

    For a track whose end no frame shows: a blade that is too high passes over a flat piece and hides it. `before`,
    `after` and `X_BC` are those of `at_home`.
    """
    if lies_at(before, after, model, X_BC, detection) is None:
        return None
    return replace(track, outcome=Outcome.ON_TABLE, flags=(*track.flags, HIDDEN_AT_THE_END))


def _prepare(
    frames: Sequence[Frame],
    poses: Sequence[Array],
    model: CameraModel,
    X_BC: Array,
    detection: PieceDetection,
    tool: ToolMask,
) -> tuple[TrackingSetup, tuple[str, ...]]:
    """Views, sensor correction, and the camera turned so that the tool appears where the arm reports it."""
    area = reach_of(detection)
    view = view_of(model.colour, X_BC, area, _HIGHEST_M)
    resting = [i for i, X in enumerate(poses) if np.linalg.norm(X[:3, 3] - poses[0][:3, 3]) < _STILL_M][:5]
    hidden = detection.centre_m, 1.6 * float(np.linalg.norm(detection.proxy.half_m))
    shift_px = tool_shift([frames[i] for i in resting], [poses[i] for i in resting], view, tool, hidden)
    flags: tuple[str, ...] = ()
    if shift_px is None:
        flags = ("camera pose not checked: the resting tool is not seen well enough",)
    else:
        spot = np.append(view.image_point(detection.centre_m[None])[0] / view.focal_px, 1.0)
        X_BC = turn_camera(X_BC, shift_px, view.focal_px)
        view = view_of(model.colour, X_BC, area, _HIGHEST_M)
        place_m = on_plane(spot[None], view.X_BV, detection.centre_m[2])[0, :2]
        off_m = float(np.linalg.norm(place_m - detection.xy_m))
        detection = replace(detection, xy_m=place_m)
        if off_m > _FAR_OFF_M:
            flags = (
                f"camera and arm disagree by {1e3 * off_m:.0f} mm about the tool: the camera has moved, or the grasp "
                "is another. adaptsim calibrate check and adaptsim touch-off tell which. Places are relative to the "
                "tool in the picture",
            )
    depth_view = view_of(model.depth, X_BC @ model.X_CD, area, _HIGHEST_M)
    around = depth_window(model, X_BC, detection.centre_m)
    clear = ~np.isfinite(tool.depth(poses[0], around, around.directions))
    depth_m = frames[0].depth_mm[around.rows, around.columns].reshape(-1) / 1000.0
    offset_m = table_offset(depth_m, around, detection.centre_m, clear)
    return TrackingSetup(view, depth_view, offset_m, tool, detection, _HIGHEST_M), flags


def _flags(t_s: Array, places: Sequence[PieceFix | None], state: Array, detection: PieceDetection) -> tuple[str, ...]:
    hidden = np.array([place is not None and place.visible < _HIDDEN for place in places])
    absent = np.array([place is None for place in places])
    flags = [*in_frames(f"less than {_HIDDEN:.0%} of the piece visible", hidden, t_s)]
    flags += in_frames("piece not located", absent, t_s)
    fits = [place.fit for place in places if place is not None and place.visible >= _FREE]
    if fits and np.median(fits) < _POOR_FIT:
        flags.append(
            f"the piece looks different from when it was found (agreement {np.median(fits):.2f}, at least "
            f"{_POOR_FIT:g} is usual): motion blur, a shining spot, or another exposure; its place may be off by more "
            "than 5 mm"
        )
    moved_m = float(np.linalg.norm(state[0, :2] - detection.xy_m))
    if moved_m > _MOVED_M:
        flags.append(f"moved by {1e3 * moved_m:.0f} mm between detection and start")
    return tuple(flags)
