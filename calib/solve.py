"""From views to a calibration: `solve`.

1. Views are sorted, and each is condensed to the board's pose and its information. Views that cannot be condensed are
left out.
2. A closed form on random subsets gives a start that a minority of spoilt views cannot distort.
3. Views that disagree are rejected, with joint offsets and board size free, so that no view is rejected because of
those. A view that says little about its own tilt (one small marker) is condensed again about the fit.
4. Joint offsets are adopted if the Bayesian information criterion asks for them and every fifth view, held out, is
   not predicted worse with them.
5. The final fit uses all kept views, held-out ones included, because a fifth more views lower the error. The stated
held-out error belongs to the fit without them, so it is on the safe side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.bundle import Fit, Model, Motion, State, fit, joint_spread, motion_of, observable_joints, predict
from calib.closed_form import cross_check, robust_start
from calib.condense import Sight, about, condense, unusable
from calib.errors import BoardDisagrees, DegenerateViews, TooFewViews, UnusableViews
from calib.geometry import rotation_vector
from calib.rejection import LIMIT, MARGIN, MIN_TO_FREE, reject
from calib.types import Forward, JointOffsets, Noise, Setup, Solution, View, ViewFit
from calib.uncertainty import jackknife, uncertainty
from calib.worth import worth
from hw.poses import inverse
from hw.types import Array

MIN_VIEWS = 6
HELD_OUT_EVERY = 5
BIC_LIMIT = -2.0  # "positive evidence"; by chance about once in 5,000 calibrations
HELD_OUT_MARGIN = 1.1  # four held-out views measure their error to about a tenth
VAGUE_RAD = 0.03
"""Limit of a view's own standard deviation of tilt.

Our board at 1 m has a tenth of it, a 4 cm marker ten times as much.
"""
MIN_TURN_DEG = 1.5
"""With smaller rotations about the second axis, some direction is almost undetermined."""

Rows = NDArray[np.int64]


def solve(views: Sequence[View], setup: Setup, forward: Forward | None) -> Solution:
    """Calibrate. `forward` is needed if the views give joints. Raises UnusableViews or a subclass."""
    ordered, left_out = _usable(_sorted(views), setup)
    data, start = _agreeing(_data(ordered, setup, forward), setup)
    data, plain = _settled(data, _without_extras(start), Model(scale=not setup.size_known))
    final, joints, held = _with_offsets_where_supported(data, plain)
    return _solution(ordered, setup, data, final, joints, held, left_out)


@dataclass(frozen=True, eq=False)
class _Data:
    """The data of the fits, with the chosen candidate pose of each view."""

    sight: Sight
    moved: Motion
    X_CM: Array  # (N, 4, 4)
    information: Array  # (N, 6, 6)
    distance2: Array  # (N,) squared distance of each view from a fit without it
    kept: Rows  # rows of agreeing views
    mirrored: NDArray[np.bool_]  # (N,) the better-fitting pose contradicts the arm; the mirror pose is used
    own_X_CM: Array  # (N, 4, 4) from each picture alone

    def fit(self, rows: Rows, start: State, model: Model) -> Fit:
        return fit(self.moved.take(rows), self.X_CM[rows], self.information[rows], start, model)


@dataclass(frozen=True, eq=False)
class _HeldOut:
    """Every fifth kept view, predicted by a fit to the others."""

    rows: Rows
    px: Array  # root mean square distance of the corners, by row

    @property
    def rms_px(self) -> float:
        return float(np.sqrt(np.mean(self.px**2)))


def _sorted(views: Sequence[View]) -> list[View]:
    """Sorted by name, so that the result does not depend on the order of the views, not even in the last digit."""
    if len(views) < MIN_VIEWS:
        raise TooFewViews(f"{len(views)} views, at least {MIN_VIEWS} are needed and 20 are good: record more")
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
        told = "; ".join(f"view {name}: {reasons[name]}" for name in bad)
        raise TooFewViews(f"{len(good)} usable views, at least {MIN_VIEWS} are needed and 20 are good ({told})")
    nan = float("nan")
    return good, tuple(ViewFit(n, False, reasons[n], nan, nan, nan, nan, False, nan, False) for n in bad)


def _data(views: Sequence[View], setup: Setup, forward: Forward | None) -> _Data:
    sight = condense([v.name for v in views], [v.corners for v in views], setup.board, setup.colour)
    moved = motion_of(views, setup.mounting, forward)
    none = np.zeros(len(views), dtype=bool)
    X_CM, rows = sight.X_CM[0], np.arange(len(views))
    return _Data(sight, moved, X_CM, sight.information[0], np.zeros(len(views)), rows, none, X_CM)


def _agreeing(data: _Data, setup: Setup) -> tuple[_Data, State]:
    """Reject views, choose among the mirror poses. Raises DegenerateViews or TooFewViews."""
    n = data.moved.joints
    _demand_variety(data.X_CM)
    X_AC, X_HM = robust_start(data.moved.X_AH(np.zeros(n)), data.X_CM)
    kept, side, now, both = reject(
        data.moved,
        data.sight.X_CM,
        data.sight.information,
        State(X_AC, X_HM, np.zeros(n)),
        _flexible(n, len(data.X_CM), setup),
    )
    every = np.arange(len(kept))
    chosen = replace(
        data,
        X_CM=data.sight.X_CM[side, every],
        information=data.sight.information[side, every],
        distance2=both[side, every],
        kept=np.flatnonzero(kept),
        mirrored=(side == 1) & (both[0] > MARGIN * LIMIT),
        own_X_CM=data.sight.X_CM[side, every],
    )
    if _vague(chosen):
        chosen, now = _judged_again(chosen, now, setup)
        kept = np.isin(every, chosen.kept)
    rows = chosen.kept
    if len(rows) < max(MIN_VIEWS - 1, (len(kept) + 1) // 2):
        raise TooFewViews(
            f"only {len(rows)} of {len(kept)} views agree with one another: check that board and camera are tight, "
            "that the arm rests before each picture, and that images and joints belong together"
        )
    _demand_variety(chosen.X_CM[rows])
    return chosen, now.state


def _vague(data: _Data) -> bool:
    """Whether a view says little about its own tilt. Then its error around its own best pose is not a parabola."""
    spread = np.linalg.inv(data.information)[:, :3, :3]
    return bool(np.median(np.sqrt(np.linalg.eigvalsh(spread)[:, -1])) > VAGUE_RAD)


def _judged_again(data: _Data, now: Fit, setup: Setup) -> tuple[_Data, Fit]:
    """Judge views by their corners around the prediction instead of by their own poses."""
    flexible = _flexible(data.moved.joints, len(data.X_CM), setup)
    for _ in range(3):
        X, information = about(data.sight, predict(now.state, data.moved))
        twice = np.stack([X, X]), np.stack([information, information])
        kept, _, now, both = reject(data.moved, *twice, now.state, flexible)
        changed = not np.array_equal(np.flatnonzero(kept), data.kept)
        data = replace(data, X_CM=X, information=information, distance2=both[0], kept=np.flatnonzero(kept))
        if not changed:
            break
    return data, now


def _settled(data: _Data, start: State, model: Model) -> tuple[_Data, Fit]:
    """The fit to the kept views; for vague views, the optimum over all pixels."""
    found = data.fit(data.kept, start, model)
    if not _vague(data):
        return data, found
    for _ in range(4):
        X, information = about(data.sight, predict(found.state, data.moved))
        data = replace(data, X_CM=X, information=information)
        before, found = found, data.fit(data.kept, found.state, model)
        if np.abs(found.state.X_AC - before.state.X_AC).max() < 1e-6:
            break
    return data, found


def _flexible(joints: int, views: int, setup: Setup) -> Model:
    enough = views >= MIN_TO_FREE
    return Model(observable_joints(joints) if enough else (), scale=enough or not setup.size_known)


def _without_extras(state: State) -> State:
    return State(state.X_AC, state.X_HM, np.zeros_like(state.offsets_rad))


def _spread_deg(X_CM: Array) -> Array:
    """(3,) root mean square rotation of the boards about three axes, largest first, degrees."""
    turns = rotation_vector(np.swapaxes(X_CM[:1, :3, :3], 1, 2) @ X_CM[:, :3, :3])
    turns = turns - turns.mean(axis=0)
    return np.asarray(np.rad2deg(np.linalg.svd(turns, compute_uv=False)) / np.sqrt(len(turns)))


def _demand_variety(X_CM: Array) -> None:
    spread = _spread_deg(X_CM)
    if spread[1] < MIN_TURN_DEG:
        raise DegenerateViews(
            f"the board has nearly the same tilt in all views ({spread[0]:.1f}° about one axis, {spread[1]:.1f}° about "
            "any"
            f" other, at least {MIN_TURN_DEG}° is needed and 10° is good): tilt it left, right, up and down"
        )


def _with_offsets_where_supported(data: _Data, plain: Fit) -> tuple[Fit, JointOffsets | None, _HeldOut]:
    held = _held_out(data, plain)
    n = data.moved.joints
    if not n:
        return plain, None, held
    none = np.zeros(n)
    if len(data.kept) < MIN_TO_FREE:
        reason = f"{len(data.kept)} views are too few to estimate joint offsets, {MIN_TO_FREE} are needed"
        unknown = np.full(n, np.nan)
        return plain, JointOffsets(none, unknown, False, none, np.nan, reason), held
    free = data.fit(data.kept, plain.state, Model(observable_joints(n), plain.model.scale))
    held_free = _held_out(data, free)
    numbers = 6 * len(data.kept)
    delta_bic = -2 * (free.log_likelihood - plain.log_likelihood) + len(free.model.offsets) * np.log(numbers)
    adopted = delta_bic < BIC_LIMIT and held_free.rms_px < HELD_OUT_MARGIN * held.rms_px
    sigma = np.full(n, np.nan)
    sigma[list(free.model.offsets)] = np.sqrt(np.diagonal(jackknife(free))[12 : 10 + n])
    reason = (
        f"{'supported' if adopted else 'not supported'}: information criterion {delta_bic:+.1f} (limit"
        f" {BIC_LIMIT:+.0f}), held-out error {held_free.rms_px:.2f} px with offsets, {held.rms_px:.2f} px without"
    )
    found = free.state.offsets_rad
    joints = JointOffsets(found if adopted else none, sigma, adopted, found, float(delta_bic), reason)
    return (free, joints, held_free) if adopted else (plain, joints, held)


def _held_out(data: _Data, full: Fit) -> _HeldOut:
    out = np.zeros(len(data.kept), dtype=bool)
    out[HELD_OUT_EVERY - 1 :: HELD_OUT_EVERY] = True
    without = data.fit(data.kept[~out], full.state, full.model)
    rows = data.kept[out]
    return _HeldOut(rows, data.sight.rms_at(predict(without.state, data.moved))[rows])


def _square_scale(data: _Data, plain: Fit, setup: Setup) -> tuple[float, float]:
    """Size of the board by the arm's motion over the stated size, and one standard deviation."""
    model = Model(_flexible(data.moved.joints, len(data.kept), setup).offsets, scale=True)
    free = data.fit(data.kept, plain.state, model)
    return free.state.scale, float(np.sqrt(jackknife(free)[-1, -1]))


def _solution(
    views: Sequence[View],
    setup: Setup,
    data: _Data,
    final: Fit,
    joints: JointOffsets | None,
    held: _HeldOut,
    left_out: tuple[ViewFit, ...],
) -> Solution:
    kept, moved = data.kept, data.moved
    predicted = predict(final.state, moved)
    rms = data.sight.rms_at(predicted)
    X_AH = moved.X_AH(final.state.offsets_rad)[kept]
    scale, scale_sigma = _square_scale(data, final, setup)
    centre = setup.board.outline_m.mean(axis=0)
    seen = data.X_CM[kept, :3, :3] @ centre + data.X_CM[kept, :3, 3]
    return Solution(
        mounting=setup.mounting,
        X_AC=final.state.X_AC,
        X_HM=final.state.X_HM,
        joints=joints,
        views=tuple(sorted((*_view_fits(views, data, predicted, rms, centre, held), *left_out), key=lambda v: v.name)),
        fit_px=float(np.sqrt(np.mean(rms[kept] ** 2))),
        held_out_px=held.rms_px,
        noise=_noise(data, final, centre),
        uncertainty=uncertainty(final, moved.take(kept), setup, joints),
        methods=cross_check(X_AH, data.X_CM[kept], final.state.X_AC),
        square_scale=scale,
        square_scale_sigma=scale_sigma,
        target=setup.board.name,
        size_known=setup.size_known,
        tilt_spread_deg=float(_spread_deg(data.X_CM[kept])[1]),
        pose_span_m=float(np.linalg.norm(np.ptp(seen, axis=0))),
        worth=worth(final, [views[i].name for i in kept], setup.p_AP_m - final.state.X_AC[:3, 3]),
    )


def _view_fits(
    views: Sequence[View], data: _Data, predicted: Array, rms: Array, centre: Array, held: _HeldOut
) -> tuple[ViewFit, ...]:
    off = inverse(predicted) @ data.own_X_CM
    off_mm = 1e3 * np.linalg.norm(off[:, :3, :3] @ centre + off[:, :3, 3] - centre, axis=1)
    off_deg = np.rad2deg(np.linalg.norm(rotation_vector(off[:, :3, :3]), axis=1))
    kept, out = set(data.kept.tolist()), dict(zip(held.rows.tolist(), held.px.tolist(), strict=True))
    return tuple(
        ViewFit(
            name=view.name,
            used=i in kept,
            reason="" if i in kept else _reason(off_mm[i], off_deg[i], data.distance2[i]),
            rms_px=float(rms[i]),
            own_rms_px=float(data.sight.rms_at(data.own_X_CM)[i]),
            off_mm=float(off_mm[i]),
            off_deg=float(off_deg[i]),
            held_out=i in out,
            held_out_px=float(out.get(i, np.nan)),
            mirrored=i in kept and bool(data.mirrored[i]),
        )
        for i, view in enumerate(views)
    )


def _reason(off_mm: float, off_deg: float, distance2: float) -> str:
    times = np.sqrt(distance2 / (MARGIN * LIMIT))
    return (
        f"the board is {off_mm:.1f} mm and {off_deg:.2f}° from where the other views and the joints put it, "
        f"{times:.1f} times the limit: the arm was still moving, the image belongs to other joints, or the board "
        "slipped"
    )


def _noise(data: _Data, final: Fit, centre: Array) -> Noise:
    """Noise of corners and joints, and the spread of the board's centre due to the joints."""
    G = joint_spread(final.state, data.moved.take(data.kept))
    at_centre = G[:, 3:] - np.cross(centre, np.swapaxes(G[:, :3], 1, 2)).swapaxes(1, 2)
    flange_mm = 1e3 * final.joint_rad * np.sqrt(np.mean(np.sum(at_centre**2, axis=(1, 2))))
    return Noise(data.sight.corner_px, final.joint_rad if data.moved.joints else float("nan"), float(flange_mm))
