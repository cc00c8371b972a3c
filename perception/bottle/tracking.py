"""From the frames of a push to the track of the bottle, until it rests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum

import numpy as np

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.arm_mask import ArmShape
from perception.bottle.detection import HEIGHT_M, BottleDetection
from perception.bottle.place import BottleFix, locate_body, patch
from perception.clutter import things
from perception.cylinder import Cylinder, distance_m, tilt_rad
from perception.errors import TrackingFailed
from perception.geometry import Area, transform
from perception.scan import Mask, Raw, Scan, scan_of
from perception.sightings import require_end, require_seen, seen_leaving
from perception.types import ObjectTrack, Outcome, in_frames

BEFORE_S = 0.05
"""Frames are used from this long before the motion (s) to the end of the recording, when the bottle rests."""
TIPPED_DEG = 30.0
_NOTICED_S = 0.010  # simulations check every 20 ms, so on average they notice a fall this much later
_SEEN = 0.35  # confidence from which a place counts
_WHOLE, _VISIBLE, _FIT = 0.98, 0.60, 0.70  # less is flagged
_STANDS_DEG = 4.0  # if a bottle at rest leans by more, its readings are wrong or it stands on something
_FALL_DEG_S = 1200.0  # a bottle of 10 cm hits the table at sqrt(3 g / h) = 990°/s, and falls more slowly before
_STEP = 3  # clutter is searched in every third row and column
_OWN_M = 0.020  # readings this near to the bottle belong to it, or to its mixed edges
_NEAR_M = 0.06
_STRANGE_SHARE = 0.5  # of an object's readings that have to lie off the bottle
_LAST_S = 0.20
_MOVING_M_S = 0.03  # at this speed a bottle on the slipperiest table slides 1 mm further
_MOVED_M = 0.006
_LOWEST_M = -0.05


def track_bottle(
    frames: Sequence[Frame],
    model: CameraModel,
    X_BC: Array,
    detection: BottleDetection,
    arm_at: Callable[[float], ArmShape],
    t_start_s: float,
    duration_s: float,
    area: Area,
) -> ObjectTrack:
    """The bottle's centre through the trial, and how it ended: upright, tipped by more than 30 degrees, or lost.

    `frames` in order of time; `X_BC` (4, 4) is the colour camera in the base frame; `detection` is from before the
    trial; `arm_at(t_s)` gives arm and tool from measured joints, on the clock of the frames; the motion starts at
    `t_start_s` on that clock and lasts `duration_s`; `area` is the searched part of the table. Frames in which the
    bottle cannot be located are bridged, with confidence 0. A fallen bottle counts as staying where it fell, because
    its rolling says nothing about the push, and simulations end there. Flags tell the operator about a bottle at the
    edge of the image, hidden or not at rest, and about a hand or another object in the picture. Raises TrackingFailed
    if no frame falls into the trial, the film ends before the motion, or the bottle is in none of the frames;
    OutcomeUnseen if it is in too few of them.
    """
    chosen = [f for f in frames if f.t_s >= t_start_s - BEFORE_S]
    if not any(f.t_s <= t_start_s + duration_s for f in chosen):
        raise TrackingFailed(
            f"none of the {len(frames)} frames falls into the trial ({t_start_s:.3f} s, {duration_s:.2f} s long); "
            f"check that camera and arm share one clock"
        )
    table = detection.table
    scan = scan_of(model, table.X_BV @ inverse(model.X_CD), area, HEIGHT_M, table.error)
    places, clutter = _follow(scan, chosen, detection, arm_at)
    t_s = np.array([f.t_s - t_start_s for f in chosen])
    sure = np.array([p.confidence >= _SEEN for p in places])
    if not sure.any():
        raise TrackingFailed(
            f"the bottle that stood at ({detection.xy_m[0]:.3f}, {detection.xy_m[1]:+.3f}) m is in none of "
            f"{len(chosen)} frames; find it again before the trial"
        )
    centres = np.array([p.centre_m for p in places])
    state = np.stack([np.interp(t_s, t_s[sure], column[sure]) for column in centres.T], axis=1)
    confidence = np.where(sure, [p.confidence for p in places], 0.0)
    tilt_deg = np.array([p.tilt_deg for p in places])
    X_BT = arm_at(chosen[-1].t_s).X_BT
    end = np.full(3, np.nan) if X_BT is None else transform(inverse(X_BT), state[-1])
    outcome = _outcome(t_s, state, sure, tilt_deg, area)
    if outcome is Outcome.TIPPED:
        fell, where_m = _fell(t_s, sure, tilt_deg, state)
        state[fell:] = where_m
    flags = (*_sight_flags(t_s, places, clutter, sure), *_end_flags(t_s, state, sure, tilt_deg, detection, outcome))
    track = ObjectTrack(t_s, state, outcome, end, confidence, flags)
    if outcome is not Outcome.LOST:  # a fallen bottle may roll out of sight: what counts is that it was seen to fall
        until = len(t_s) if outcome is Outcome.UPRIGHT else int(np.flatnonzero(sure)[-1]) + 1
        if outcome is Outcome.UPRIGHT:
            require_end(t_s, duration_s)
        require_seen("bottle", track, sure[:until], t_s[:until] >= t_s[until - 1] - _LAST_S)
    return track


class _Clutter(StrEnum):
    """Other objects in a frame."""

    NONE = "none"
    NEAR = "near the bottle"
    APART = "apart from it"


def _follow(
    scan: Scan, frames: Sequence[Frame], detection: BottleDetection, arm_at: Callable[[float], ArmShape]
) -> tuple[list[BottleFix], list[_Clutter]]:
    """The bottle in each frame (confidence 0: not located), and other objects there."""
    history = [(frames[0].t_s - 1 / 30, detection.X_BO)]
    places, clutter = [], []
    for frame in frames:
        arm, raw = arm_at(frame.t_s), scan.raw(frame)
        best = BottleFix(history[-1][1], 0.0, 0.0, 0.0, 0.0)
        for guess in _guesses(history, frame.t_s):
            surface = patch(scan, raw, guess[:3, 3], arm)
            fix = None if surface is None else locate_body(surface, detection.body, guess)
            if fix is not None:
                best = BottleFix.better([best, fix])
            if best.fit >= _FIT and best.confidence >= _SEEN:
                break
        if best.confidence >= _SEEN:
            history = [history[-1], (frame.t_s, best.X_BO)]
        places.append(best)
        clutter.append(_clutter(scan, raw, arm, history[-1][1], detection.body))
    return places, clutter


def _guesses(history: list[tuple[float, Array]], t_s: float) -> list[Array]:
    """Poses near which to search: the bottle moved on as before, or it stayed."""
    t_last_s, last = history[-1]
    if len(history) < 2:
        return [last]
    t_before_s, before = history[-2]
    onward = last.copy()
    onward[:3, 3] += (last[:3, 3] - before[:3, 3]) * min((t_s - t_last_s) / max(t_last_s - t_before_s, 1e-3), 3.0)
    return [onward, last]


def _clutter(scan: Scan, raw: Raw, arm: ArmShape, X_BO: Array, body: Cylinder) -> _Clutter:
    """The parts of a frame that are neither table, arm nor bottle."""
    state = _Clutter.NONE
    for thing in things(scan, raw, arm, _STEP):
        away = distance_m(thing.points_m, X_BO, body)
        strange = away > _OWN_M
        if strange.mean() > _STRANGE_SHARE:
            if away[strange].min() < _NEAR_M:
                return _Clutter.NEAR
            state = _Clutter.APART
    return state


def _outcome(t_s: Array, state: Array, sure: Mask, tilt_deg: Array, area: Area) -> Outcome:
    """The outcome of the track. A bottle is lost if it was seen leaving the table or the searched area."""
    last = t_s >= t_s[-1] - _LAST_S
    if np.median(tilt_deg[sure][-3:]) > TIPPED_DEG:
        return Outcome.TIPPED
    if np.median(state[last, 2]) < _LOWEST_M or seen_leaving(t_s, state[:, :2], sure, area):
        return Outcome.LOST
    return Outcome.UPRIGHT


def _fell(t_s: Array, sure: Mask, tilt_deg: Array, state: Array) -> tuple[int, Array]:
    """Index of the first frame from which on a fallen bottle leans too far, and the place (3,) at which a simulation
    would have noticed: between that frame and the one before, which may be 17 mm apart.
    """
    last, fell = _fall_frames(sure, tilt_deg)
    if last < 0:
        return fell, state[fell]
    passed_s = np.interp(TIPPED_DEG, tilt_deg[[last, fell]], t_s[[last, fell]])
    share = (passed_s + _NOTICED_S - t_s[last]) / (t_s[fell] - t_s[last])
    return fell, state[last] + min(share, 1.0) * (state[fell] - state[last])


def _fall_frames(sure: Mask, tilt_deg: Array) -> tuple[int, int]:
    """Indices of the last frame in which a fallen bottle stands (-1: in none), and of the next one that shows it."""
    stands = np.flatnonzero(sure & (tilt_deg <= TIPPED_DEG))
    last = int(stands[-1]) if len(stands) else -1
    return last, last + 1 + int(np.flatnonzero(sure[last + 1 :])[0])


def _fall_deg_s(t_s: Array, sure: Mask, tilt_deg: Array) -> float:
    """How fast a fallen bottle leans over between these two frames; 0 if it never stands."""
    last, fell = _fall_frames(sure, tilt_deg)
    return 0.0 if last < 0 else float((tilt_deg[fell] - tilt_deg[last]) / (t_s[fell] - t_s[last]))


def _sight_flags(t_s: Array, places: Sequence[BottleFix], clutter: Sequence[_Clutter], sure: Mask) -> tuple[str, ...]:
    inside = np.array([p.in_picture >= _WHOLE for p in places])
    visible = np.array([p.visible >= _VISIBLE for p in places])
    fits = np.array([p.fit >= _FIT for p in places])
    others = np.array(clutter)
    causes = (
        (~sure, "the bottle is not located"),
        (sure & ~inside, "the bottle is at the edge of the image"),
        (sure & inside & ~visible, "much of the bottle is hidden"),
        (sure & ~fits, "the tracked object does not have the bottle's shape"),
        (others == _Clutter.NEAR, "a hand or another object touches or comes near the bottle"),
        (others == _Clutter.APART, "a hand or another object is in the picture"),
    )
    return tuple(flag for which, what in causes for flag in in_frames(what, which, t_s))


def _end_flags(
    t_s: Array, state: Array, sure: Mask, tilt_deg: Array, detection: BottleDetection, outcome: Outcome
) -> tuple[str, ...]:
    flags = []
    moved_m = float(np.linalg.norm(state[0, :2] - detection.xy_m))
    if moved_m > _MOVED_M:
        flags.append(f"the bottle moved by {1e3 * moved_m:.0f} mm between detection and start")
    leant_deg = float(np.rad2deg(tilt_rad(detection.X_BO)))
    if leant_deg > _STANDS_DEG:
        flags.append(
            f"the bottle seems to lean by {leant_deg:.0f}° before the push: it stands on something, or something "
            "beside it reflects the camera's light"
        )
    if not sure[-1]:
        flags.append("the bottle is out of sight at the end")
    if len(t_s) >= 3:
        speed_m_s = float(np.linalg.norm(state[-1] - state[-3])) / max(float(t_s[-1] - t_s[-3]), 1e-3)
        if speed_m_s > _MOVING_M_S and outcome is not Outcome.TIPPED:  # a fallen bottle may roll
            flags.append(
                f"the bottle is still moving at the end ({1e3 * speed_m_s:.0f} mm/s): its resting place is unknown"
            )
    if outcome is Outcome.TIPPED and (fall_deg_s := _fall_deg_s(t_s, sure, tilt_deg)) > _FALL_DEG_S:
        flags.append(
            f"outcome uncertain: the bottle seems to fall at {fall_deg_s:.0f}°/s, and none falls faster than "
            f"{_FALL_DEG_S:.0f}°/s: the tracked object may be another one, or the camera was knocked"
        )
    end_deg = tilt_deg[sure][-1]
    if abs(end_deg - TIPPED_DEG) < 10:
        flags.append(f"outcome uncertain: the bottle leans by {end_deg:.0f}°, {TIPPED_DEG:.0f}° count as tipped")
    return tuple(flags)
