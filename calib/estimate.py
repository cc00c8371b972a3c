"""The estimator of `solve` and `together`: from views that agree to the poses of one camera or several.

Two fits compete. The first fit weighs every view by the errors of arm, view and corners, whose sizes it estimates. It
adopts joint offsets if the views support them. The second fit weighs all corners alike, as a bundle adjustment over
pixels. Each predicts every view from the others, a fifth at a time (`Choice`). The few views of a series often cannot
tell errors of the arm from those of the lens. So one of them is used alone only if it predicts clearly better;
otherwise the mean of both is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.bundle import (
    ArmViews,
    CondensedViews,
    ErrorSizes,
    Fit,
    Model,
    Rows,
    Unknowns,
    fit,
    observable_joints,
    predict,
)
from calib.condense import PoseCandidates, about
from calib.geometry import difference, move, rms
from calib.rejection import MIN_TO_FREE
from calib.types import Choice, JointOffsets, Weights
from calib.uncertainty import jackknife
from hw.types import Array

FOLDS = 5
BIC_LIMIT = -2.0  # "positive evidence"; by chance about once in 5,000 calibrations
HELD_OUT_MARGIN = 1.1  # four held-out views measure their error to about a tenth
CLEARLY = 0.85  # times the held-out error of the fit over pixels: below it, the other is kept alone
PIXELS_MARGIN = 0.98  # times the held-out error of the other fit: below it, the fit over pixels is kept alone
LARGEST_OFFSET_RAD = 0.03
"""No working arm has a joint zero so far off, because that is 2 cm at the flange, which anybody sees. A larger estimate
comes from another error, of the lens or of the pictures' poses. (Half of one real series gave 49 mrad, the other none.)
"""
_LEAST_PX = 0.02
_ROUNDS = 6
_SETTLED_M = 1e-6


@dataclass(frozen=True, eq=False)
class Data:
    """The data of the fits: views of one camera after another."""

    candidates: tuple[PoseCandidates, ...]  # one a camera
    moved: ArmViews  # of all views, in this order
    boards: CondensedViews
    agreeing: Rows  # rows of agreeing views
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
        return [(one, X_CM[self.moved.camera == c]) for c, one in enumerate(self.candidates)]

    def fit(self, rows: Rows, start: Unknowns, model: Model) -> Fit:
        """The fit to some of the views. With pixel weights, and for vague views, it is the optimum over all their
        corners.
        """
        pixels = model.weights is Weights.PIXELS
        if not pixels and not self.vague:
            return fit(self.moved.take(rows), self.boards.take(rows), start, model)
        X = predict(start, self.moved)
        current: Fit | None = None
        for _ in range(_ROUNDS):
            noise_px = max(rms(self.rms_at(X)[rows]) / float(np.sqrt(2.0)), _LEAST_PX) if pixels else None
            before = X
            current = fit(
                self.moved.take(rows),
                self.about(X, noise_px).take(rows),
                start if current is None else current.state,
                model,
            )
            X = predict(current.state, self.moved)
            if np.abs(X - before).max() < _SETTLED_M:
                break
        assert current is not None
        return current


@dataclass(frozen=True, eq=False)
class HeldOutViews:
    """Views predicted by a fit to others."""

    rows: Rows
    px: Array  # root mean square distance of the corners, by row

    @property
    def rms_px(self) -> float:
        """Over the views."""
        return rms(self.px)


@dataclass(frozen=True, eq=False)
class BestFit:
    """The choice between the two fits."""

    fit: Fit  # with the mean of both as its state, if both are kept
    joints: JointOffsets | None
    held: HeldOutViews  # every fifth view, predicted without them
    folds: HeldOutViews  # every view, predicted without its fifth
    choice: Choice
    noise: ErrorSizes  # by the fit weighed by errors of arm and views, kept or not


def estimate(data: Data, start: Unknowns, *, scale: bool) -> BestFit:
    """Fit by both weights, and choose by the error of held-out views. With `scale`, the board's size is free."""
    cameras = len(data.candidates)
    plain = data.fit(data.agreeing, start, Model(scale=scale, cameras=cameras))
    by_errors, joints = _with_offsets_where_supported(data, plain)
    by_pixels = data.fit(data.agreeing, plain.state, replace(plain.model, weights=Weights.PIXELS))
    offsets = joints is not None and joints.adopted
    errors, pixels = (_folds(data, [one]) for one in (by_errors, by_pixels))
    if pixels.rms_px < PIXELS_MARGIN * errors.rms_px:
        chosen_fits, folds = [by_pixels], pixels
    elif offsets or errors.rms_px < CLEARLY * pixels.rms_px:
        chosen_fits, folds = [by_errors], errors
    else:
        chosen_fits = [by_errors, by_pixels]
        folds = _folds(data, chosen_fits)
    choice = Choice(tuple(one.model.weights for one in chosen_fits), errors.rms_px, pixels.rms_px, folds.rms_px)
    if joints is not None and offsets and by_errors not in chosen_fits:
        reason = f"{joints.reason}; not used, because a fit over pixels without offsets predicts better"
        joints = replace(joints, adopted=False, offsets_rad=np.zeros(len(joints.offsets_rad)), reason=reason)
    final = replace(chosen_fits[-1], state=_mean([one.state for one in chosen_fits]))
    return BestFit(final, joints, _every_fifth(data, chosen_fits), folds, choice, by_errors.noise)


def _mean(states: Sequence[Unknowns]) -> Unknowns:
    """The only state, or the state half way between two states without joint offsets."""
    a, b = states[0], states[-1]
    if a is b:
        return a
    X_AC, X_HM = (move(X, difference(X, Y) / 2) for X, Y in ((a.X_AC, b.X_AC), (a.X_HM, b.X_HM)))
    return Unknowns(X_AC, X_HM, a.offsets_rad, float(np.sqrt(a.scale * b.scale)))


def _with_offsets_where_supported(data: Data, plain: Fit) -> tuple[Fit, JointOffsets | None]:
    n = data.moved.joints
    if not n:
        return plain, None
    none = np.zeros(n)
    if len(data.agreeing) < MIN_TO_FREE:
        reason = f"{len(data.agreeing)} views are too few to estimate joint offsets; {MIN_TO_FREE} are needed"
        unknown = np.full(n, np.nan)
        return plain, JointOffsets(none, unknown, False, none, np.nan, reason)
    free = data.fit(data.agreeing, plain.state, replace(plain.model, offsets=observable_joints(n)))
    held, held_free = (_every_fifth(data, [one]) for one in (plain, free))
    numbers = 6 * len(data.agreeing)
    delta_bic = -2 * (free.log_likelihood - plain.log_likelihood) + len(free.model.offsets) * np.log(numbers)
    largest_rad = float(np.abs(free.state.offsets_rad).max())
    possible = largest_rad <= LARGEST_OFFSET_RAD
    adopted = possible and delta_bic < BIC_LIMIT and held_free.rms_px < HELD_OUT_MARGIN * held.rms_px
    sigma = np.full(n, np.nan)
    columns = free.model.poses + np.arange(len(free.model.offsets))
    sigma[list(free.model.offsets)] = np.sqrt(np.diagonal(jackknife(free))[columns])
    reason = (
        f"{'supported' if adopted else 'not supported'}: information criterion {delta_bic:+.1f} (limit"
        f" {BIC_LIMIT:+.0f}), held-out error {held_free.rms_px:.2f} px with offsets, {held.rms_px:.2f} px without"
    )
    if not possible:
        reason += (
            f"; the largest would be {1e3 * largest_rad:.0f} mrad, more than an arm that works can have "
            f"({1e3 * LARGEST_OFFSET_RAD:.0f}): another error causes them"
        )
    offsets_rad = free.state.offsets_rad
    joints = JointOffsets(offsets_rad if adopted else none, sigma, adopted, offsets_rad, float(delta_bic), reason)
    return (free, joints) if adopted else (plain, joints)


def _every_fifth(data: Data, full: Sequence[Fit]) -> HeldOutViews:
    return _without(data, full, data.moved.posture[data.agreeing], FOLDS - 1)


def _folds(data: Data, full: Sequence[Fit]) -> HeldOutViews:
    postures = data.moved.posture[data.agreeing]
    parts = [_without(data, full, postures, fold) for fold in range(FOLDS)]
    return HeldOutViews(np.concatenate([p.rows for p in parts]), np.concatenate([p.px for p in parts]))


def _without(data: Data, full: Sequence[Fit], postures: Rows, fold: int) -> HeldOutViews:
    """Every fifth of the kept postures from the `fold`-th on, predicted by the mean of the fits to the others."""
    out = np.unique(postures, return_inverse=True)[1] % FOLDS == fold
    without = _mean([data.fit(data.agreeing[~out], one.state, one.model).state for one in full])
    rows = data.agreeing[out]
    return HeldOutViews(rows, data.rms_at(predict(without, data.moved))[rows])
