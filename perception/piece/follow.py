"""Follows the piece from frame to frame, behind and on a tool with a known pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from hw.poses import inverse, translation
from hw.types import Array, Frame
from perception.arm_mask import ToolMask
from perception.geometry import Array32, ImageRegion, on_plane, transform
from perception.piece.detection import (
    PieceDetection,
    brightness,
    chromaticity,
    darkness,
    matte,
    table_depth,
    without_halo,
)
from perception.piece.locate import Evidence, PieceFix, appraise, locate
from perception.piece.proxy import Proxy, coverage

_MOST_OF_IT = 0.5
_LEAST, _MOST = 0.4, 2.0  # of the area that the piece covers there
_READINGS = 8  # of depth, at least, for a place above the table
_CANDIDATES = 3


def places(
    view: ImageRegion, depth_view: ImageRegion, frame: Frame, proxy: Proxy, chroma: tuple[Array, ...]
) -> Iterator[Array]:
    """Places (3,) in m, in the base frame, of spots with the piece's colour and size, the largest spot first.

    `chroma` are the chromaticities (2,) of the piece and of everything around it. The height comes from the depth
    camera; without enough readings the piece lies on the table.
    """
    share = matte(frame.colour[view.rows, view.columns], chroma[0], chroma[1:])
    count, labels, stats, centroids = cv2.connectedComponentsWithStats((share > _MOST_OF_IT).astype(np.uint8))
    points_m = _readings(depth_view, frame)
    labelled = view.sample(labels.astype(np.float32), points_m)
    by_area = sorted(range(1, count), key=lambda i: -stats[i, cv2.CC_STAT_AREA])
    for i in by_area[:_CANDIDATES]:
        u, v = np.rint(centroids[i]).astype(int)
        ray = np.array([*(view.xy[v, u].astype(np.float64) / view.focal_px), 1.0])
        centre_m = _on_ray(ray, view, points_m[labelled == i], proxy)
        _, cover, _ = coverage(proxy.outline(translation(centre_m), view), view.xy.reshape(-1, 2))
        if _LEAST * cover.sum() <= share[labels == i].sum() <= _MOST * cover.sum():
            yield centre_m


def _readings(depth_view: ImageRegion, frame: Frame) -> Array:
    """(n, 3) m, all readings of depth in the base frame."""
    depth_m = frame.depth_mm[depth_view.rows, depth_view.columns].reshape(-1) / 1000.0
    read = depth_m > 0
    return transform(depth_view.X_BV, depth_view.directions[read] * depth_m[read, None])


def _on_ray(ray: Array, view: ImageRegion, front_m: Array, proxy: Proxy) -> Array:
    """(3,) the centre on a ray of the camera, half a piece behind its readings (n, 3)."""
    lowest_m = float(min(proxy.half_m))
    height_m = lowest_m if len(front_m) < _READINGS else max(lowest_m, float(np.median(front_m[:, 2])) - lowest_m / 2)
    return np.array([*on_plane(ray[None], view.X_BV, height_m)[0], height_m])


_SEARCH_M = 0.014
_PRIOR_STD_M = 0.010
_GOOD_FIT, _LOST_FIT = 0.55, 0.35
_BARELY_VISIBLE, _CLEARLY_VISIBLE = 0.25, 0.6
_ON_PIECE = 0.7  # a depth reading belongs to the piece if it covers at least this share of the pixel
_SAME_COLOUR = 0.02
_RIM = np.ones((5, 5), np.uint8)  # the tool's edge may lie this near to its predicted place, in px


@dataclass(frozen=True, eq=False)
class TrackingSetup:
    """Everything that is constant during a trial."""

    view: ImageRegion  # part of the colour image that the piece may reach
    depth_view: ImageRegion
    depth_offset_m: float  # measured minus true depth on the table
    tool: ToolMask
    detection: PieceDetection
    highest_m: float  # the piece does not get higher
    by_depth: bool = False  # before the tool, which may be as dark as the piece, depth tells the piece

    @property
    def proxy(self) -> Proxy:
        """Shape and size of the piece that is followed."""
        return self.detection.proxy


@dataclass(frozen=True, eq=False)
class _Known:
    """A frame in which the piece was located."""

    t_s: float
    X_BT: Array
    centre_m: Array


def follow(rig: TrackingSetup, frames: Sequence[Frame], poses: Sequence[Array]) -> list[PieceFix | None]:
    """One place per frame, given the tool's poses (4, 4); None if the piece cannot be located."""
    places: list[PieceFix | None] = []
    history: tuple[_Known, ...] = (_Known(frames[0].t_s - 1 / 30, poses[0], rig.detection.centre_m),)
    others: tuple[Array, ...] = (rig.detection.table_chroma,)
    tool_chroma: Array | None = None
    for frame, X_BT in zip(frames, poses, strict=True):
        if tool_chroma is None:
            tool_chroma = _tool_chroma(rig, frame, X_BT, history[-1].centre_m)
            if tool_chroma is not None and np.linalg.norm(tool_chroma - rig.detection.piece_chroma) > _SAME_COLOUR:
                others = (*others, tool_chroma)
        place = _step(rig, frame, X_BT, history, others)
        places.append(place)
        if place is not None:
            history = (history[-1], _Known(frame.t_s, X_BT, place.centre_m))
    return places


def _step(
    rig: TrackingSetup, frame: Frame, X_BT: Array, history: tuple[_Known, ...], others: tuple[Array, ...]
) -> PieceFix | None:
    guesses = _guesses(rig, frame.t_s, X_BT, history)
    middle = np.mean(guesses, axis=0)
    spread_m = max(float(np.linalg.norm(guess - middle)) for guess in guesses)
    reach_m = float(np.linalg.norm(rig.proxy.half_m)) + _SEARCH_M + spread_m
    evidence = _evidence(rig, frame, X_BT, middle, reach_m, others)
    place = None if evidence is None else _near(rig, evidence, X_BT, guesses)
    if place is not None and place.visible >= _BARELY_VISIBLE and place.fit >= _GOOD_FIT:
        return place
    return _anywhere(rig, frame, X_BT, others) or place


def _near(rig: TrackingSetup, evidence: Evidence, X_BT: Array, guesses: Sequence[Array]) -> PieceFix | None:
    """The best place near the guesses; None if the picture contradicts all of them."""
    tries = [appraise(evidence, rig.proxy, _rotation(X_BT, guess), guess) for guess in guesses]
    tries.sort(key=lambda place: -place.fit)
    place = _refine(evidence, rig, X_BT, tries[0].centre_m)
    if place.fit < _GOOD_FIT:
        others_too = [_refine(evidence, rig, X_BT, other.centre_m) for other in tries[1:]]
        place = max([place, *others_too], key=lambda p: p.fit)
    return place if place.fit >= _LOST_FIT or place.visible < _BARELY_VISIBLE else None


def _anywhere(rig: TrackingSetup, frame: Frame, X_BT: Array, others: tuple[Array, ...]) -> PieceFix | None:
    """A place that fits well, in the whole view."""
    chroma = (rig.detection.piece_chroma, *others)
    reach_m = float(np.linalg.norm(rig.proxy.half_m)) + _SEARCH_M
    for start_m in places(rig.view, rig.depth_view, frame, rig.proxy, chroma):
        evidence = _evidence(rig, frame, X_BT, start_m, reach_m, others)
        if evidence is not None:
            place = _refine(evidence, rig, X_BT, start_m)
            if place.fit >= _GOOD_FIT and place.visible >= _CLEARLY_VISIBLE:
                return place
    return None


def _refine(evidence: Evidence, rig: TrackingSetup, X_BT: Array, start_m: Array) -> PieceFix:
    return locate(evidence, rig.proxy, _rotation(X_BT, start_m), start_m, _PRIOR_STD_M)


def _guesses(rig: TrackingSetup, t_s: float, X_BT: Array, history: tuple[_Known, ...]) -> list[Array]:
    """Places near which to search: the piece stayed, moved with the tool, or moved on as before."""
    last = history[-1]
    guesses = [last.centre_m, transform(X_BT, transform(inverse(last.X_BT), last.centre_m))]
    if len(history) > 1:
        step_m = (last.centre_m - history[-2].centre_m) / (last.t_s - history[-2].t_s)
        guesses.append(last.centre_m + step_m * (t_s - last.t_s))
    lowest_m = 0.8 * min(rig.proxy.half_m)
    return [np.array([g[0], g[1], np.clip(g[2], lowest_m, rig.highest_m)]) for g in guesses]


def _rotation(X_BT: Array, centre_m: Array) -> Array:
    """The rotation of the piece: over the blade it lies along the blade, otherwise it stands on the table."""
    in_tool = transform(inverse(X_BT), centre_m)
    over_blade = in_tool[0] < 0 and 0 < in_tool[2] < 0.05 and abs(in_tool[1]) < 0.05
    return X_BT[:3, :3] if over_blade else np.eye(3)


def _evidence(
    rig: TrackingSetup, frame: Frame, X_BT: Array, centre_m: Array, reach_m: float, others: tuple[Array, ...]
) -> Evidence | None:
    view, depth_view = rig.view.window(centre_m, reach_m), rig.depth_view.window(centre_m, reach_m)
    if view is None or depth_view is None:
        return None
    rgb = frame.colour[view.rows, view.columns]
    tool_m = rig.tool.depth(X_BT, view, view.directions)
    on_tool = cv2.dilate(np.isfinite(tool_m).reshape(rgb.shape[:2]).astype(np.uint8), _RIM) > 0
    depth_m = frame.depth_mm[depth_view.rows, depth_view.columns].reshape(-1) / 1000.0
    read = depth_m > 0
    if rig.by_depth:
        share = darkness(rgb, _table_brightness(rig, frame))
        raised = _raised(rig, X_BT, depth_view, depth_m - rig.depth_offset_m)
        places_m = transform(view.X_BV, np.asarray(view.directions * np.float32(view.depth_of(centre_m)), np.float64))
        share = np.where(on_tool, depth_view.sample(raised, places_m).reshape(share.shape), share)
    else:
        share = without_halo(matte(rgb, rig.detection.piece_chroma, others), rgb, on_tool)
    depth_m, rays = depth_m[read] - rig.depth_offset_m, depth_view.directions[read]
    on_piece = view.sample(share, transform(depth_view.X_BV, rays * depth_m[:, None])) > _ON_PIECE
    return Evidence(view, share.reshape(-1), tool_m, depth_view, rays[on_piece], depth_m[on_piece])


_RISEN, _RISES = 0.25, 0.35
"""A reading in front of the tool begins to count as the piece from the first share of the piece's height, and counts
fully this much higher."""


def _table_brightness(rig: TrackingSetup, frame: Frame) -> float:
    """The median brightness around the piece, which is that of the table."""
    return float(np.median(brightness(frame.colour[rig.view.rows, rig.view.columns][::8, ::8])))


def _raised(rig: TrackingSetup, X_BT: Array, depth_view: ImageRegion, depth_m: Array) -> Array32:
    """(h, w) how far a reading of `depth_m` (n,) before table and tool stands up as high as the piece, 0 to 1."""
    shape = depth_view.xy.shape[:2]
    behind_m = np.minimum(table_depth(depth_view), rig.tool.depth(X_BT, depth_view, depth_view.directions))
    up_m = np.where(depth_m > 0, behind_m - depth_m, 0.0).astype(np.float32).reshape(shape)
    smooth = cv2.blur(cv2.medianBlur(up_m, 3), (3, 3)) / np.float32(2 * min(rig.proxy.half_m))
    return np.asarray(np.clip((smooth - _RISEN) / _RISES, 0, 1), dtype=np.float32)


def _tool_chroma(rig: TrackingSetup, frame: Frame, X_BT: Array, piece_m: Array) -> Array | None:
    """(2,) the tool's chromaticity where it must be visible, away from the piece; None if it is not in view."""
    reach_m = 0.06
    view = rig.view.window(X_BT[:3, 3] + 0.03 * (X_BT[:3, 2] - X_BT[:3, 0]), reach_m)
    if view is None:
        return None
    tool = np.isfinite(rig.tool.depth(X_BT, view, view.directions)).reshape(view.xy.shape[:2])
    away_m = (
        np.linalg.norm(view.xy - view.image_point(piece_m[None])[0], axis=-1) * view.depth_of(piece_m) / view.focal_px
    )
    clear = tool & (away_m > 1.5 * float(np.linalg.norm(rig.proxy.half_m)))
    if clear.sum() < 30:
        return None
    colour: Array = np.median(chromaticity(frame.colour[view.rows, view.columns][clear]), axis=0).astype(np.float64)
    return colour
