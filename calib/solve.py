"""From views to a calibration: `solve`.

1. Views are sorted, and each is condensed to the board's pose and its information. Views that cannot be condensed are
left out.
2. A closed form on random subsets gives a start that a minority of spoilt views cannot distort.
3. Views that disagree are rejected, with joint offsets and board size free, so that no view is rejected because of
those. Views that say little about their own tilt (one small marker) are fitted by all their corners together first, and
condensed again about the fit.
4. The final fit (`calib.estimate`) uses all kept views, held-out ones included, because a fifth more views lower the
error. The stated held-out error belongs to the fit without them, so it is on the safe side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calib.bundle import ArmViews, CondensedViews, Model, Unknowns, joint_spread, motion_of, observable_joints, predict
from calib.closed_form import cross_check, robust_start
from calib.condense import PoseCandidates, about, condense, unusable
from calib.errors import BoardDisagrees, DegenerateViews, TooFewViews, UnusableViews, determined
from calib.estimate import BestFit, Data, estimate
from calib.geometry import move, rotation_vector
from calib.projection import project
from calib.rejection import LIMIT, MARGIN, MIN_TO_FREE, chosen, reject
from calib.types import Forward, Noise, Setup, Solution, View, ViewFit
from calib.uncertainty import jackknife, uncertainty, view_influence
from hw.poses import inverse
from hw.types import Array

MIN_VIEWS = 6
VAGUE_RAD = 0.03
"""Limit of a view's own standard deviation of tilt.

Our board at 1 m has a tenth of it, and a 4 cm marker has ten times as much."""
_MISLED = 0.5
"""If a fit to all corners lowers their cost to this share, the views' own poses mislead, because errors that the
corners share turn a small target."""
_EVALUATIONS = 200
"""The most evaluations of a fit to all corners. Views that belong together take 7 (median) to 151; others may never
end."""
_JUDGED_AGAIN = 3
_TURNED_DEG = 80.0
_MEETS = 0.02  # of the image's width
_PLAIN = 9.0  # squared distance by which the arm prefers the mirror pose
MIN_TURN_DEG = 1.5
"""Least rotation about the second axis: with smaller ones some direction is almost undetermined."""


@determined()
def solve(views: Sequence[View], setup: Setup, forward: Forward | None) -> Solution:
    """Calibrate. `forward` is needed if the views give joints. Raises UnusableViews or a subclass."""
    ordered, left_out = _usable(_sorted(views), setup)
    agreed = _agreeing(ordered, setup, forward)
    best = estimate(agreed.data, agreed.start, scale=not setup.size_known)
    return _solution(ordered, setup, agreed, best, left_out)


@dataclass(frozen=True, eq=False)
class _Agreed:
    """The views, the choice among them, and a start without joint offsets."""

    data: Data
    start: Unknowns
    distance2: Array  # (N,) squared distance of each view from a fit without it
    mirrored: NDArray[np.bool_]  # (N,) the better-fitting pose contradicts the arm; the mirror pose is used
    own_X_CM: Array  # (N, 4, 4) from each picture alone


def _sorted(views: Sequence[View]) -> list[View]:
    """Sorted by name, so that the result does not depend on the order of the views, not even in the last digit."""
    if len(views) < MIN_VIEWS:
        raise TooFewViews(f"{len(views)} views, but at least {MIN_VIEWS} are needed and 20 are good: record more")
    names = [view.name for view in views]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UnusableViews(f"more than one view is called {', '.join(twice)}: give each view its own name")
    kinds = {None if view.q_rad is None else len(view.q_rad) for view in views}
    if len(kinds) > 1:
        raise UnusableViews("views differ in whether they have joints, or in how many: record all views alike")
    return sorted(views, key=lambda view: view.name)


def _usable(views: Sequence[View], setup: Setup) -> tuple[list[View], tuple[ViewFit, ...]]:
    """The views with a pose, and the others with the reason. Raises BoardDisagrees or TooFewViews."""
    reasons = {view.name: unusable(view.corners, setup.board, setup.colour) for view in views}
    bad = [name for name, reason in reasons.items() if reason]
    if 2 * len(bad) > len(views):
        raise BoardDisagrees(f"{len(bad)} of {len(views)} views cannot be used; view {bad[0]}: {reasons[bad[0]]}")
    good = [view for view in views if not reasons[view.name]]
    if len(good) < MIN_VIEWS:
        listing = "; ".join(f"view {name}: {reasons[name]}" for name in bad)
        raise TooFewViews(f"{len(good)} usable views, but at least {MIN_VIEWS} are needed and 20 are good ({listing})")
    return good, tuple(ViewFit(name=name, used=False, reason=reasons[name]) for name in bad)


def _agreeing(views: Sequence[View], setup: Setup, forward: Forward | None) -> _Agreed:
    """Reject views, choose among the mirror poses. Raises DegenerateViews or TooFewViews."""
    sight = condense([v.name for v in views], [v.corners for v in views], setup.board, setup.colour)
    moved = motion_of(views, setup.mounting, forward)
    n = moved.joints
    demand_variety(sight.X_CM[0])
    X_AH = moved.X_AH(np.zeros(n))
    if (turned := _spread_deg(X_AH)[1]) < MIN_TURN_DEG:
        raise DegenerateViews(
            f"the arm's poses hardly turn ({turned:.1f}° about a second axis, at least {MIN_TURN_DEG}° is needed), "
            "although the board does: check that each view has the pose of its own picture"
        )
    X_AC, X_HM = robust_start(X_AH, sight.X_CM[0])
    both = sight.candidate(0), sight.candidate(1)
    flexible = _flexible(n, len(views), setup)
    agreeing, side, now, far = reject(moved, both, Unknowns(X_AC[None], X_HM, np.zeros(n)), flexible)
    boards, distance2 = chosen(both, side), far[side, np.arange(len(side))]
    mirrored, own_X_CM = (side == 1) & (far[0] - far[1] > _PLAIN), boards.X_CM
    state = now.state
    corners, first = _AllCorners(sight, moved, scale=not setup.size_known), Unknowns(X_AC[None], X_HM, np.zeros(n))
    together = min((corners.fit(one) for one in (state, first)), key=corners.cost)
    if vague := _vague(boards) or corners.cost(together) < _MISLED * corners.cost(state):
        state = together
    for _ in range(_JUDGED_AGAIN if vague else 0):
        # by their corners around the prediction instead of by their own poses
        boards, before = about(sight, predict(state, moved)), agreeing
        agreeing, _, now, far = reject(moved, (boards, boards), state, flexible)
        state, distance2 = now.state, far[0]
        if (agreeing == before).all():
            break
    # a covariance of nonsense is large too: what does not even meet in the picture does not agree
    rows = np.flatnonzero(agreeing & (sight.rms_at(predict(state, moved)) < _MEETS * setup.colour.width))
    if len(rows) < max(MIN_VIEWS - 1, (len(agreeing) + 1) // 2):
        raise TooFewViews(
            f"only {len(rows)} of {len(agreeing)} views agree with one another: check that board and camera are tight, "
            "that the arm rests before each picture, and that images and joints belong together"
        )
    demand_variety(boards.X_CM[rows])
    start = Unknowns(state.X_AC, state.X_HM, np.zeros(n))
    return _Agreed(Data((sight,), moved, boards, rows, vague), start, distance2, mirrored, own_X_CM)


@dataclass(frozen=True)
class _AllCorners:
    """All corners of all views, outlying ones counting less, without joint offsets."""

    sight: PoseCandidates
    moved: ArmViews
    scale: bool  # the board's size is free

    def cost(self, state: Unknowns) -> float:
        return float(np.sum(np.sqrt(1 + self._off_px(state) ** 2) - 1))

    def fit(self, start: Unknowns) -> Unknowns:
        def stepped(x: Array) -> Unknowns:
            X_AC, X_HM = move(start.X_AC, x[None, :6]), move(start.X_HM, x[6:12])
            return Unknowns(X_AC, X_HM, np.zeros(self.moved.joints), start.scale * float(np.exp(np.sum(x[12:]))))

        none = np.zeros(13 if self.scale else 12)
        fit = least_squares(
            lambda x: self._off_px(stepped(x)), none, x_scale=1e-3, loss="soft_l1", max_nfev=_EVALUATIONS
        )
        return stepped(fit.x)

    def _off_px(self, state: Unknowns) -> Array:
        off = project(self.sight.camera, predict(state, self.moved), self.sight.p_M_m) - self.sight.px
        return np.asarray(off[self.sight.weight > 0].ravel())


def _vague(boards: CondensedViews) -> bool:
    """Whether a view says little about its own tilt. Then its error around its own best pose is not a parabola."""
    spread = np.linalg.inv(boards.information)[:, :3, :3]
    return bool(np.median(np.sqrt(np.linalg.eigvalsh(spread)[:, -1])) > VAGUE_RAD)


def _flexible(joints: int, views: int, setup: Setup) -> Model:
    enough = views >= MIN_TO_FREE
    return Model(observable_joints(joints) if enough else (), scale=enough or not setup.size_known)


def _spread_deg(X: Array) -> Array:
    """(3,) root mean square rotation of poses (N, 4, 4) about three axes, largest first, degrees."""
    turns = rotation_vector(np.swapaxes(X[:1, :3, :3], 1, 2) @ X[:, :3, :3])
    turns = turns - turns.mean(axis=0)
    return np.asarray(np.rad2deg(np.linalg.svd(turns, compute_uv=False)) / np.sqrt(len(turns)))


def demand_variety(X_CM: Array) -> None:
    """Raise DegenerateViews if the boards (N, 4, 4) are tilted too little to determine a calibration."""
    spread = _spread_deg(X_CM)
    if spread[1] < MIN_TURN_DEG:
        raise DegenerateViews(
            f"the board has nearly the same tilt in all views ({spread[0]:.1f}° about one axis, {spread[1]:.1f}° about "
            "any"
            f" other, at least {MIN_TURN_DEG}° is needed and 10° is good): tilt it left, right, up and down"
        )


def _square_scale(data: Data, final: BestFit, setup: Setup) -> tuple[float, float]:
    """Size of the board by the arm's motion over the stated size, and one standard deviation."""
    offsets = _flexible(data.moved.joints, len(data.agreeing), setup).offsets
    free = data.fit(data.agreeing, final.fit.state, replace(final.fit.model, offsets=offsets, scale=True))
    return free.state.scale, float(np.sqrt(jackknife(free)[-1, -1]))


def _solution(
    views: Sequence[View], setup: Setup, agreed: _Agreed, best: BestFit, left_out: tuple[ViewFit, ...]
) -> Solution:
    data, final = agreed.data, best.fit
    rows, moved, boards = data.agreeing, data.moved, data.boards.X_CM
    X_AC = final.state.X_AC[0]
    predicted = predict(final.state, moved)
    rms = data.rms_at(predicted)
    X_AH = moved.X_AH(final.state.offsets_rad)[rows]
    scale, scale_sigma = _square_scale(data, best, setup)
    centre = setup.board.outline_m.mean(axis=0)
    centres = boards[rows, :3, :3] @ centre + boards[rows, :3, 3]
    fits = _view_fits(views, agreed, predicted, rms, centre, best)
    return Solution(
        mounting=setup.mounting,
        X_AC=X_AC,
        X_HM=final.state.X_HM,
        joints=best.joints,
        views=tuple(sorted((*fits, *left_out), key=lambda v: v.name)),
        fit_px=float(np.sqrt(np.mean(rms[rows] ** 2))),
        held_out_px=best.held.rms_px,
        noise=_noise(data, best, centre),
        choice=best.choice,
        uncertainty=uncertainty(final, moved.take(rows), setup, best.joints),
        methods=cross_check(X_AH, boards[rows], X_AC),
        square_scale=scale,
        square_scale_sigma=scale_sigma,
        target=setup.board.name,
        size_known=setup.size_known,
        tilt_spread_deg=float(_spread_deg(boards[rows])[1]),
        distance_m=float(np.median(np.linalg.norm(centres, axis=1))),
        influence=view_influence(final, [views[i].name for i in rows], setup.p_AP_m - X_AC[:3, 3]),
    )


def _view_fits(
    views: Sequence[View], agreed: _Agreed, predicted: Array, rms: Array, centre: Array, best: BestFit
) -> tuple[ViewFit, ...]:
    data, held = agreed.data, best.held
    off = inverse(predicted) @ agreed.own_X_CM
    off_mm = 1e3 * np.linalg.norm(off[:, :3, :3] @ centre + off[:, :3, 3] - centre, axis=1)
    off_deg = np.rad2deg(np.linalg.norm(rotation_vector(off[:, :3, :3]), axis=1))
    own_px = data.rms_at(agreed.own_X_CM)
    agreeing, out = set(data.agreeing.tolist()), dict(zip(held.rows.tolist(), held.px.tolist(), strict=True))
    return tuple(
        ViewFit(
            name=view.name,
            used=i in agreeing,
            reason="" if i in agreeing else _reason(off_mm[i], off_deg[i], agreed.distance2[i]),
            rms_px=float(rms[i]),
            own_rms_px=float(own_px[i]),
            off_mm=float(off_mm[i]),
            off_deg=float(off_deg[i]),
            held_out=i in out,
            held_out_px=float(out.get(i, np.nan)),
            mirrored=i in agreeing and bool(agreed.mirrored[i]),
        )
        for i, view in enumerate(views)
    )


def _reason(off_mm: float, off_deg: float, distance2: float) -> str:
    times = np.sqrt(distance2 / (MARGIN * LIMIT))
    if off_deg > _TURNED_DEG:
        cause = "its corners are numbered from another end, or the image belongs to other joints"
    else:
        cause = "the arm was still moving, the image belongs to other joints, or the board slipped"
    return (
        f"the board is {off_mm:.1f} mm and {off_deg:.2f}° from where the other views and the joints put it, "
        f"{times:.1f} times the limit: {cause}"
    )


def _noise(data: Data, best: BestFit, centre: Array) -> Noise:
    """Noise of corners, views and joints, and the spread of the board's centre due to the joints."""
    G = joint_spread(best.fit.state, data.moved.take(data.agreeing))
    at_centre = G[:, 3:] - np.cross(centre, np.swapaxes(G[:, :3], 1, 2)).swapaxes(1, 2)
    sizes = best.noise
    flange_mm = 1e3 * sizes.joint_rad * np.sqrt(np.mean(np.sum(at_centre**2, axis=(1, 2))))
    joint_rad = sizes.joint_rad if data.moved.joints else float("nan")
    return Noise(data.candidates[0].corner_px, sizes.view_px, joint_rad, float(flange_mm))
