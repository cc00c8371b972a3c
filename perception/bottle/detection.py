"""Find the bottle before a trial: alone, upright, whole in the picture, and on its mark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.arm_mask import NO_ARM
from perception.bottle.place import ENOUGH_READ, BottleFix, locate_body, patch
from perception.clutter import Thing, things
from perception.cylinder import Cylinder, distance_m
from perception.errors import ObjectNotFound, TableNotFound
from perception.geometry import Area
from perception.scan import WHOLE, Raw, Scan, TableFit, refine, scan_of

HEIGHT_M = 0.22
_TABLE_OFF_M = 0.012  # the calibration counts as wrong from here
_BOTTLE_FIT = 0.85
_UPRIGHT_DEG, _LIES_DEG = 15.0, 75.0  # between these nothing is at rest
_OWN_M = 0.015  # a reading this near to the bottle's surface may belong to the bottle
_FREE_SHARE, _TOUCHED_SHARE = 0.92, 0.30  # of the readings: a bottle alone; a bottle with something touching it
_LYING_M, _LYING_SHARE = 0.005, 0.75  # stricter, since many low objects have about its size
_FREE_VISIBLE = 0.9
_TABLE_READING_M = 0.05  # readings this near to the table's height are of the table
_SCATTER_M, _MISSING = 0.006, 0.15
"""Readings of a table that scatter more, or are missing in a larger share of it, may hide a bottle."""


@dataclass(frozen=True, eq=False)
class BottleDetection:
    """A bottle standing on the table."""

    X_BO: Array  # (4, 4) centre, Z along the axis
    body: Cylinder
    confidence: float  # 0 ... 1: visible share, times quality of fit
    table: TableFit  # the camera, refined by the table

    @property
    def xy_m(self) -> Array:
        """(2,) the axis, in the base frame."""
        return np.asarray(self.X_BO[:2, 3])

    @property
    def centre_m(self) -> Array:
        """(3,) in the base frame."""
        return np.asarray(self.X_BO[:3, 3])


def find_bottle(
    frame: Frame,
    model: CameraModel,
    X_BC: Array,
    body: Cylinder,
    area: Area,
    mark_m: Array,
    within_m: float = 0.005,
) -> BottleDetection:
    """The one bottle in `area`, which stands within `within_m` of `mark_m` (2,); nothing else may stand there.

    `X_BC` (4, 4) is the colour camera in the base frame, whose plane z = 0 is the table top; the table in the picture
    refines it. Raises ObjectNotFound, naming the objects found instead and the remedy, and TableNotFound.
    """
    scan, raw, table = refine_scan(frame, model, X_BC, area)
    parts: list[_Bottle] = []
    others: list[Thing] = []
    for thing in things(scan, raw, NO_ARM):
        part = _bottle_in(scan, raw, thing, body)
        if part is None:
            others.append(thing)
        else:
            parts.append(part)
    bottles = _joined(parts, body)
    if not bottles:
        raise ObjectNotFound(_nothing(others, area, mark_m, body) + _poor_depth(scan, raw))
    if len(bottles) > 1:
        places = ", ".join(f"({c.thing.centre_m[0]:.3f}, {c.thing.centre_m[1]:+.3f})" for c in bottles)
        raise ObjectNotFound(f"{len(bottles)} bottles are on the table, near {places} m; leave one, on the mark")
    _require_whole(bottles[0])
    best = bottles[0].best
    if others:
        raise ObjectNotFound(
            f"beside the bottle there is something at {others[0].words}; clear the table, and keep hands away"
        )
    _require_on_mark(best.centre_m[:2], mark_m, within_m)
    return BottleDetection(best.X_BO, body, best.confidence, table)


def refine_scan(frame: Frame, model: CameraModel, X_BC: Array, area: Area) -> tuple[Scan, Raw, TableFit]:
    """(scan, its readings, the fit) with the camera's pose and depth corrected by the table in `frame`."""
    first = scan_of(model, X_BC, area, HEIGHT_M)
    table = refine(first, first.depth(first.raw(frame)))
    if table.off_m > _TABLE_OFF_M:
        raise TableNotFound(
            f"the table appears up to {1e3 * table.off_m:.0f} mm from where the calibration puts it, limit "
            f"{1e3 * _TABLE_OFF_M:.0f} mm: check that nothing moved the camera, and calibrate it again"
        )
    scan = scan_of(model, table.X_BV @ inverse(model.X_CD), area, HEIGHT_M, table.error)
    return scan, scan.raw(frame), table


@dataclass(frozen=True, eq=False)
class _Bottle:
    """A bottle in an object on the table."""

    thing: Thing
    best: BottleFix
    share: float  # of the object's readings that lie on the bottle


def _joined(parts: list[_Bottle], body: Cylinder) -> list[_Bottle]:
    """Join parts of one bottle, divided by missing readings: places too near to each other for two bottles."""
    joined: list[_Bottle] = []
    for part in parts:
        for i, other in enumerate(joined):
            if np.linalg.norm(other.best.centre_m - part.best.centre_m) < body.radius_m:
                joined[i] = _both(other, part)
                break
        else:
            joined.append(part)
    return joined


def _both(one: _Bottle, other: _Bottle) -> _Bottle:
    counts = [len(one.thing.points_m), len(other.thing.points_m)]
    share = float(np.average([one.share, other.share], weights=counts))
    points = np.concatenate([one.thing.points_m, other.thing.points_m])
    thing = Thing(points, at_edge=one.thing.at_edge or other.thing.at_edge)
    return _Bottle(thing, BottleFix.better([one.best, other.best]), share)


def _bottle_in(scan: Scan, raw: Raw, thing: Thing, body: Cylinder) -> _Bottle | None:
    guess = body.upright(thing.centre_m[:2])
    surface = patch(scan, raw, guess[:3, 3], NO_ARM)
    best = None if surface is None else locate_body(surface, body, guess)
    if best is None or best.fit < _BOTTLE_FIT:
        return None
    off = np.abs(distance_m(thing.points_m, best.X_BO, body))
    if best.tilt_deg < _UPRIGHT_DEG:
        share = float((off < _OWN_M).mean())
        return _Bottle(thing, best, share) if share > _TOUCHED_SHARE else None
    lies = best.tilt_deg > _LIES_DEG and (off < _LYING_M).mean() > _LYING_SHARE
    return _Bottle(thing, best, 1.0) if lies else None


def _require_whole(bottle: _Bottle) -> None:
    """Raises ObjectNotFound unless it stands upright, whole in the picture and untouched."""
    best = bottle.best
    at = f"the bottle at ({best.centre_m[0]:.3f}, {best.centre_m[1]:+.3f}) m"
    if best.tilt_deg > _UPRIGHT_DEG:
        raise ObjectNotFound(f"{at} lies on its side; stand it on its mark")
    if bottle.thing.at_edge or best.in_picture < 1:
        raise ObjectNotFound(f"{at} reaches beyond the edge of the depth image; move it, or the camera")
    if best.read < _FREE_VISIBLE * ENOUGH_READ:
        raise ObjectNotFound(
            f"the depth camera reads only {100 * best.read:.0f} % of {at}; a dark, shiny or printed face gives few "
            "readings: turn the bottle, or put matt tape around it"
        )
    if bottle.share < _FREE_SHARE or best.visible < _FREE_VISIBLE:
        raise ObjectNotFound(f"something touches or hides {at}; keep hands and other things away from it")


def _require_on_mark(xy_m: Array, mark_m: Array, within_m: float) -> None:
    off = np.asarray(mark_m) - xy_m
    distance_m_ = float(np.linalg.norm(off))
    if distance_m_ <= within_m:
        return
    along = f"{1e3 * abs(off[0]):.0f} mm {'away from' if off[0] > 0 else 'towards'} the robot"
    across = f"{1e3 * abs(off[1]):.0f} mm to the robot's {'left' if off[1] > 0 else 'right'}"
    raise ObjectNotFound(
        f"the bottle stands at ({xy_m[0]:.3f}, {xy_m[1]:+.3f}) m, {1e3 * distance_m_:.0f} mm from its mark at "
        f"({mark_m[0]:.3f}, {mark_m[1]:+.3f}) m, {1e3 * within_m:.0f} mm are allowed; move it {along} and {across}"
    )


def _poor_depth(scan: Scan, raw: Raw) -> str:
    """What is wrong with the depth readings of the table, and what to do; "" if nothing is."""
    depth_m = scan.depth(raw)
    in_view = np.isfinite(scan.table_m)
    missing = float((depth_m[in_view] == 0).mean())
    heights_m = scan.heights(depth_m, WHOLE)[in_view & (depth_m > 0)]
    near_m = np.abs(heights_m[np.abs(heights_m) < _TABLE_READING_M])
    scatter_m = 1.48 * float(np.median(near_m)) if len(near_m) else 0.0
    causes = []
    if scatter_m > _SCATTER_M:
        causes.append(f"scatter by {1e3 * scatter_m:.0f} mm on the table, limit {1e3 * _SCATTER_M:.0f}")
    if missing > _MISSING:
        causes.append(f"are missing in {missing:.0%} of the table, limit {_MISSING:.0%}")
    if not causes:
        return ""
    return (
        f". The depth readings {' and '.join(causes)}, so a bottle may be there unseen: keep sunlight and other depth "
        "cameras off the table, let the camera warm up, and move it nearer"
    )


def _nothing(others: list[Thing], area: Area, mark_m: Array, body: Cylinder) -> str:
    mark = f"({mark_m[0]:.3f}, {mark_m[1]:+.3f}) m"
    size = f"{2e2 * body.radius_m:.0f} cm wide and {1e2 * body.height_m:.0f} cm high"
    if others and others[0].at_edge:
        return (
            f"no bottle ({size}) is whole in the picture, but something at {others[0].words} reaches beyond the edge "
            f"of the depth image; move it, or the camera, and put the bottle on its mark at {mark}"
        )
    if others:
        return (
            f"no bottle ({size}) stands on the table, but something at {others[0].words}; take it away, and put the "
            f"bottle on its mark at {mark}"
        )
    where = f"x {area[0]:.2f} to {area[1]:.2f}, y {area[2]:.2f} to {area[3]:.2f} m"
    return f"no bottle: nothing stands in {where}; put it on its mark at {mark}"
