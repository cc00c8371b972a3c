"""What the true surface of an arm does on a commanded motion: the maker's meshes against boxes, table and itself.

Shares nothing with `hw`: kinematics of `own_judge`, surfaces of `arm_meshes`. The program judges by outlines of its
own; here every point of the meshes counts, a spacing apart, at every millisecond where it gets close.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from arm_meshes import Array, bodies, placed
from own_judge import CLEAR_M, DEEPEST_M, TABLE_M, TOUCH_M, Scene, Touching, poses, wrong_alone
from scipy.spatial import cKDTree

SPACING_M, COARSE_M = 0.012, 0.02
EVERY, EVERY_SELF, AROUND = 10, 60, 15
"""Samples between two looks; around the nearest of them each is looked at."""
STEP_M = 0.002
"""No point is faster than 2 m/s."""
CONTACT_M = 0.010
"""Two surfaces sampled at `COARSE_M` that come nearer than this touch, or almost."""
HAND = 8
_APART = 3
"""Bodies of links so many joints apart cannot be neighbours."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A body as points."""

    name: str
    link: int
    points_m: Array  # (P, 3) in the link's frame
    coarse_m: Array  # (Q, 3)


@cache
def surfaces(model: str) -> tuple[Surface, ...]:
    """Links 1 to 7, hand and fingers."""
    return tuple(
        Surface(body.name, body.link, body.points_m(SPACING_M), body.points_m(COARSE_M))
        for body in bodies(model)
        if body.link >= 1
    )


def nearest_m(q: Array, model: str, low: Array, high: Array, tip_F_m: Array) -> float:
    """The least distance (m) of the surface and the tip from a box during samples (N, 7); 0 inside it."""
    tip = Surface("tip", HAND, tip_F_m[None], tip_F_m[None])

    def gap_m(at_m: Array) -> Array:
        return np.asarray(np.linalg.norm(at_m - np.clip(at_m, low, high), axis=-1))

    return _least(q, (*surfaces(model), tip), gap_m)


def lowest_m(q: Array, model: str) -> float:
    """The least height (m) of the surface of links 2 to 7, hand and fingers in the base frame."""
    return _least(q, [part for part in surfaces(model) if part.link >= 2], lambda at_m: at_m[..., 2])


def _least(q: Array, parts: Sequence[Surface], gap_m: Callable[[Array], Array]) -> float:
    """The least gap of any point: coarse points at some samples, then all points of a part around its nearest."""
    rows, best_m = _every(len(q), EVERY), np.inf
    X = poses(q[rows])
    coarse = [gap_m(placed(part.coarse_m, X[:, part.link])).min(axis=-1) for part in parts]
    for i in np.argsort([gap.min() for gap in coarse]):
        if coarse[i].min() - COARSE_M - EVERY * STEP_M > best_m:
            continue
        nearest = int(rows[coarse[i].argmin()])
        around = np.arange(max(nearest - AROUND, 0), min(nearest + AROUND, len(q) - 1) + 1, 3)
        at_m = placed(parts[i].points_m, poses(q[around])[:, parts[i].link])
        best_m = min(best_m, float(gap_m(at_m).min()), float(coarse[i].min()))
    return best_m


def touches_itself(q: Array, model: str) -> str:
    """The pair of bodies that touch during samples (N, 7), or ""."""
    parts = surfaces(model)
    X = poses(q[_every(len(q), EVERY_SELF)])
    for at in X:
        clouds = [placed(part.coarse_m, at[part.link]) for part in parts]
        middles = [(cloud.mean(axis=0), np.linalg.norm(cloud - cloud.mean(axis=0), axis=1).max()) for cloud in clouds]
        trees: dict[int, cKDTree] = {}
        for i, a in enumerate(parts):
            for j in range(i + 1, len(parts)):
                if min(parts[j].link, 7) - a.link < _APART:
                    continue
                (p, r), (s, t) = middles[i], middles[j]
                if np.linalg.norm(p - s) > r + t + CONTACT_M:
                    continue
                tree = trees.setdefault(i, cKDTree(clouds[i]))
                if tree.query(clouds[j])[0].min() < CONTACT_M:
                    return f"{a.name} touches {parts[j].name}"
    return ""


def judged(
    q: Array,
    q_arm: Array,
    model: str,
    scene: Scene,
    touching: Touching | None = None,
    *,
    rests: bool = True,
    floor_m: float = 0.0,
) -> str:
    """What the samples at 1 kHz (N, 7) break, begun at `q_arm` (7,); "": nothing. See `own_judge.wrong`.

    `floor_m` is the height of what the tip may reach; the rest of the arm keeps clear of the table at 0.
    """
    return wrong_alone(q, q_arm, model, scene.load, rests=rests) or _places(q, model, scene, touching, floor_m)


def _places(q: Array, model: str, scene: Scene, touching: Touching | None, floor_m: float) -> str:
    for low, high in scene.boxes:
        gap_m = nearest_m(q, model, low, high, scene.tip_F_m)
        if gap_m < CLEAR_M - 1e-4:
            return f"the surface comes within {1e3 * gap_m:.1f} mm of a box"
    if touching is None and (low_m := lowest_m(q, model)) < TABLE_M - 1e-4:
        return f"the surface comes within {1e3 * low_m:.1f} mm of the table"
    X = poses(q)[:, HAND]
    deepest_m = floor_m - float((X[:, 2, :3] @ scene.tip_F_m + X[:, 2, 3]).min())
    allowed_m = TOUCH_M + (0.0 if touching is None else min(touching.depth_m, DEEPEST_M))
    if deepest_m > allowed_m + 1e-4:
        return f"tip {1e3 * (deepest_m - allowed_m):.2f} mm too deep"
    return touches_itself(q, model)


def _every(count: int, step: int) -> Array:
    return np.unique(np.append(np.arange(0, count, step), count - 1))
