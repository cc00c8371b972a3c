"""The estimator of `solve` and `together`: from views that agree to the poses of one camera or several.

Two fits compete. One weighs all corners alike: a bundle adjustment over pixels. The other weighs every view by the
errors of arm, view and corners, whose sizes it estimates; joint offsets are adopted in it if the views support them.
Each predicts every view from the others, a fifth at a time. The second is kept only if it predicts clearly better
(`Choice`): the few views of a series often cannot tell errors of the arm from those of the lens, and wrong weights cost
more than equal ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.bundle import (
    ArmViews,
    CondensedViews,
    Fit,
    Model,
    Rows,
    Sizes,
    Unknowns,
    Weights,
    fit,
    observable_joints,
    predict,
)
from calib.condense import PoseCandidates, about
from calib.rejection import MIN_TO_FREE
from calib.types import Choice, JointOffsets
from calib.uncertainty import jackknife
from hw.types import Array

FOLDS = 5
BIC_LIMIT = -2.0  # "positive evidence"; by chance about once in 5,000 calibrations
HELD_OUT_MARGIN = 1.1  # four held-out views measure their error to about a tenth
CLEARLY = 0.9  # times the held-out error of the fit over pixels: below it, the fit by errors of arm and views is kept
_LEAST_PX = 0.02
_ROUNDS = 6
_SETTLED_M = 1e-6


@dataclass(frozen=True, eq=False)
class Data:
    """The data of the fits: views of one camera after another."""

    sights: tuple[PoseCandidates, ...]  # one a camera
    moved: ArmViews  # of all views, in this order
    seen: CondensedViews
    kept: Rows  # rows of agreeing views
    vague: bool  # single views say too little about their pose: they are condensed about the fit's predictions

    def rms_at(self, X_CM: Array) -> Array:
        """(N,) root mean square distance of the corners for boards at `X_CM` (N, 4, 4)."""
        parts = [sight.rms_at(X) for sight, X in self._by_camera(X_CM)]
        return np.concatenate(parts)

    def about(self, X_CM: Array, noise_px: float | None = None) -> CondensedViews:
        """The views, condensed about `X_CM` (N, 4, 4)."""
        parts = [about(sight, X, noise_px) for sight, X in self._by_camera(X_CM)]
        return CondensedViews(
            *(np.concatenate([getattr(p, name) for p in parts]) for name in ("X_CM", "information", "common"))
        )

    def _by_camera(self, X_CM: Array) -> list[tuple[PoseCandidates, Array]]:
        return [(sight, X_CM[self.moved.camera == c]) for c, sight in enumerate(self.sights)]

    def fit(self, rows: Rows, start: Unknowns, model: Model) -> Fit:
        """The fit to some of the views; over pixels, and for vague views, the optimum over all their corners."""
        pixels = model.weights is Weights.PIXELS
        if not pixels and not self.vague:
            return fit(self.moved.take(rows), self.seen.take(rows), start, model)
        X = predict(start, self.moved)
        found: Fit | None = None
        for _ in range(_ROUNDS):
            noise_px = max(_rms(self.rms_at(X)[rows]) / float(np.sqrt(2.0)), _LEAST_PX) if pixels else None
            before = X
            found = fit(
                self.moved.take(rows),
                self.about(X, noise_px).take(rows),
                start if found is None else found.state,
                model,
            )
            X = predict(found.state, self.moved)
            if np.abs(X - before).max() < _SETTLED_M:
                break
        assert found is not None
        return found


@dataclass(frozen=True, eq=False)
class HeldOutViews:
    """Views predicted by a fit to others."""

    rows: Rows
    px: Array  # root mean square distance of the corners, by row

    @property
    def rms_px(self) -> float:
        """Over the views."""
        return _rms(self.px)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The fit that is kept."""

    fit: Fit
    joints: JointOffsets | None
    held: HeldOutViews  # every fifth view, predicted by a fit to the others
    folds: HeldOutViews  # every view, predicted without its fifth
    choice: Choice
    noise: Sizes  # by the fit weighed by errors of arm and views, kept or not


def estimate(data: Data, start: Unknowns, *, scale: bool) -> Estimate:
    """Fit by both weights, and keep one by how well held-out views are predicted; `scale`: the board's size is free."""
    cameras = len(data.sights)
    plain = data.fit(data.kept, start, Model(scale=scale, cameras=cameras))
    by_errors, joints, held = _with_offsets_where_supported(data, plain)
    by_pixels = data.fit(data.kept, plain.state, replace(plain.model, weights=Weights.PIXELS))
    folds, folds_pixels = (_folds(data, found) for found in (by_errors, by_pixels))
    choice = Choice(folds.rms_px > CLEARLY * folds_pixels.rms_px, folds.rms_px, folds_pixels.rms_px)
    if not choice.pixels:
        return Estimate(by_errors, joints, held, folds, choice, by_errors.noise)
    if joints is not None and joints.adopted:
        reason = f"{joints.reason}; not used, because a fit over pixels without offsets predicts as well"
        joints = replace(joints, adopted=False, offsets_rad=np.zeros(len(joints.offsets_rad)), reason=reason)
    return Estimate(by_pixels, joints, _every_fifth(data, by_pixels), folds_pixels, choice, by_errors.noise)


def _with_offsets_where_supported(data: Data, plain: Fit) -> tuple[Fit, JointOffsets | None, HeldOutViews]:
    held = _every_fifth(data, plain)
    n = data.moved.joints
    if not n:
        return plain, None, held
    none = np.zeros(n)
    if len(data.kept) < MIN_TO_FREE:
        reason = f"{len(data.kept)} views are too few to estimate joint offsets, {MIN_TO_FREE} are needed"
        unknown = np.full(n, np.nan)
        return plain, JointOffsets(none, unknown, False, none, np.nan, reason), held
    free = data.fit(data.kept, plain.state, replace(plain.model, offsets=observable_joints(n)))
    held_free = _every_fifth(data, free)
    numbers = 6 * len(data.kept)
    delta_bic = -2 * (free.log_likelihood - plain.log_likelihood) + len(free.model.offsets) * np.log(numbers)
    adopted = delta_bic < BIC_LIMIT and held_free.rms_px < HELD_OUT_MARGIN * held.rms_px
    sigma = np.full(n, np.nan)
    columns = free.model.poses + np.arange(len(free.model.offsets))
    sigma[list(free.model.offsets)] = np.sqrt(np.diagonal(jackknife(free))[columns])
    reason = (
        f"{'supported' if adopted else 'not supported'}: information criterion {delta_bic:+.1f} (limit"
        f" {BIC_LIMIT:+.0f}), held-out error {held_free.rms_px:.2f} px with offsets, {held.rms_px:.2f} px without"
    )
    found = free.state.offsets_rad
    joints = JointOffsets(found if adopted else none, sigma, adopted, found, float(delta_bic), reason)
    return (free, joints, held_free) if adopted else (plain, joints, held)


def _every_fifth(data: Data, full: Fit) -> HeldOutViews:
    return _without(data, full, data.moved.posture[data.kept], FOLDS - 1)


def _folds(data: Data, full: Fit) -> HeldOutViews:
    postures = data.moved.posture[data.kept]
    parts = [_without(data, full, postures, fold) for fold in range(FOLDS)]
    return HeldOutViews(np.concatenate([p.rows for p in parts]), np.concatenate([p.px for p in parts]))


def _without(data: Data, full: Fit, postures: Rows, fold: int) -> HeldOutViews:
    """Every fifth of the kept postures from the `fold`-th on, predicted by a fit to the others."""
    out = np.unique(postures, return_inverse=True)[1] % FOLDS == fold
    without = data.fit(data.kept[~out], full.state, full.model)
    rows = data.kept[out]
    return HeldOutViews(rows, data.rms_at(predict(without.state, data.moved))[rows])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
