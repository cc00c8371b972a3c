"""Tests the stated intrinsics against the views.

A second fit has free focal length, centre and distortion, and both fits are judged on held-out views. Refined
intrinsics are reported only if they predict better, and used only if the operator asks for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.bundle import motion_of
from calib.errors import determined
from calib.foreign.pixels import PixelFit, PixelUnknowns, adjust, held_out_px, jackknife, observations
from calib.foreign.sizing import solve_any_size
from calib.geometry import difference, rms
from calib.projection import LENS, with_lens
from calib.types import Check, Forward, Grade, Setup, Solution, View
from hw.types import Array, Intrinsics

NAME = "intrinsics"
SUSPICIOUS = 1.5
"""The test runs if views disagree by this many times the noise of their corners."""
SMOOTH = 0.5
"""Or if the error common to the corners of a view is larger than this many times that noise."""
MIN_VIEWS = 6
TO_REFINE = 10  # views needed to use the refined intrinsics
FOLDS = 5
_DOUBTED = 3.0
_BETTER = 0.9  # times the held-out error with the stated intrinsics
_SIGNIFICANT = 3.0
_OTHER_RESOLUTION = 0.08
_ALIKE = 0.06


@dataclass(frozen=True, eq=False)
class IntrinsicsCheck:
    """The fits with stated and with estimated intrinsics."""

    stated_px: float  # held out: each view predicted without it, with the stated intrinsics
    refined_px: float  # the same with focal length, centre and distortion free
    lens: Array  # (LENS,) change of log focal length, centre u and v in px, k1, k2
    sigma: Array  # (LENS,) one standard deviation of it
    refined: Intrinsics
    covariance: Array  # (6, 6) of X_AC's twist in the camera's axes, due to the uncertain lens
    doubt: Array  # (6, 6) the same if the stated lens is used: also by how far the free one moves the camera
    better: bool  # the views support it beyond their noise
    sentence: str
    used: tuple[str, ...]  # the views of the test
    rescued: int  # views that agree with refined intrinsics but not with the stated ones


def suspicious(solution: Solution) -> bool:
    """Do the views, or the corners of one view, disagree by more than the noise of the corners?"""
    noise = solution.noise
    apart = solution.fit_px > SUSPICIOUS * np.sqrt(2.0) * noise.corner_px
    return bool(apart or noise.view_px > SMOOTH * noise.corner_px)


def settle(
    views: Sequence[View], setup: Setup, forward: Forward | None, *, refine: bool = False
) -> tuple[Solution, Setup, IntrinsicsCheck | None]:
    """Solve with the stated or, on request, the refined intrinsics. Raises UnusableViews.

    If the views give reason to doubt the stated lens, the stated error includes that doubt.
    """
    solution, setup = solve_any_size(views, setup, forward)
    tried = trial(views, setup, solution, forward) if refine or suspicious(solution) else None
    if tried is None:
        return solution, setup, None
    if refine and len(solution.used) >= TO_REFINE:
        return *solve_any_size(views, adopted(setup, tried), forward), tried
    return *solve_any_size(views, replace(setup, lens_covariance=tried.doubt), forward), tried


@determined()
def trial(views: Sequence[View], setup: Setup, solution: Solution, forward: Forward | None) -> IntrinsicsCheck | None:
    """Test with the views that the solution uses; None if they are too few."""
    used = [view for view in views if view.name in set(solution.used)]
    if len(used) < MIN_VIEWS:
        return None
    moved = motion_of(used, setup.mounting, forward)
    X_AH = moved.X_AH(solution.offsets_rad(moved.joints))
    of = observations([v.corners for v in used], X_AH, setup.board, setup.colour)
    start = PixelUnknowns(solution.X_AC[None], solution.X_HM[None], 1.0, np.zeros((1, LENS)))
    noise = max(solution.fit_px / np.sqrt(2.0), 0.02)
    scale = not setup.size_known
    stated = adjust(of, start, noise, scale=scale, lens=False)
    free = adjust(of, stated.place, max(stated.px / np.sqrt(2.0), 0.02), scale=scale, lens=True)
    free = adjust(of, free.place, max(free.px / np.sqrt(2.0), 0.02), scale=scale, lens=True)
    before = rms(held_out_px(of, stated, FOLDS, scale=scale, lens=False))
    after = rms(held_out_px(of, free, FOLDS, scale=scale, lens=True))
    lens, covariance = free.place.lens[0], jackknife(free)
    sigma = np.sqrt(np.diagonal(covariance)[-LENS:])
    better = after < _BETTER * before and bool((np.abs(lens) > _SIGNIFICANT * sigma).any())
    refined = with_lens(setup.colour, lens)
    sentence = _sentence(setup.colour, lens, sigma, before, after)
    by_lens = _into_pose(free, covariance)
    moved_by = difference(stated.place.X_AC[0], free.place.X_AC[0])
    doubt = by_lens + np.outer(moved_by, moved_by) / _DOUBTED  # so that the 95 % level includes the free camera
    names = tuple(view.name for view in used)
    rescued = 0
    if better and len(used) >= TO_REFINE and solution.rejected:
        again, _ = solve_any_size(views, replace(setup, colour=refined), forward)
        rescued = len(again.used) - len(used)
    return IntrinsicsCheck(before, after, lens, sigma, refined, by_lens, doubt, better, sentence, names, rescued)


def adopted(setup: Setup, lens_check: IntrinsicsCheck) -> Setup:
    """The setup with the refined intrinsics; their uncertainty enters the stated error."""
    return replace(setup, colour=lens_check.refined, lens_covariance=lens_check.covariance)


def check(lens_check: IntrinsicsCheck | None, *, refined: bool) -> Check:
    """The result as a check."""
    if lens_check is None:
        reason = "not tried: the views agree within the noise of their corners, or are too few"
        return Check.unmeasured(NAME, reason)
    message = f"refined: {lens_check.sentence}" if refined else lens_check.sentence
    measured = 100 * (1 - lens_check.refined_px / lens_check.stated_px), 100 * (1 - _BETTER), "%"
    advice = ": add --refine-intrinsics to use these, or state the right ones"
    return Check.graded(NAME, message, measured, advice, good=refined or not lens_check.better, worse=Grade.SUSPECT)


def rescues(lens_check: IntrinsicsCheck) -> str:
    """The gain of refined intrinsics, in words; "" if they were not better or the views are too few."""
    if not lens_check.better or len(lens_check.used) < TO_REFINE:
        return ""
    more = f" and {lens_check.rescued} more views agree" if lens_check.rescued > 0 else ""
    held = f"{lens_check.refined_px:.2f} px, not {lens_check.stated_px:.2f}"
    return f"With refined intrinsics held-out views are predicted to {held}{more}"


def _sentence(stated: Intrinsics, lens: Array, sigma: Array, before: float, after: float) -> str:
    held = f"held out {before:.2f} → {after:.2f} px"
    if after >= _BETTER * before:
        return f"with free focal length, centre and distortion the views are predicted no better ({held})"
    factor = float(np.exp(lens[0]))
    centre = (stated.K[:2, 2] + lens[1:3]) / stated.K[:2, 2]
    if abs(factor - 1) > _OTHER_RESOLUTION and np.abs(centre / factor - 1).max() < _ALIKE:
        return (
            f"the stated intrinsics are of another resolution: focal length and centre fit when scaled by {factor:.3f}"
            f" ({held})"
        )
    off = 100 * np.expm1(lens[0]), 100 * sigma[0]
    changes = [
        f"focal length {off[0]:+.1f} ± {off[1]:.1f} %",
        f"centre {lens[1]:+.0f} ± {sigma[1]:.0f}, {lens[2]:+.0f} ± {sigma[2]:.0f} px",
    ]
    k1 = f"k1 = {stated.distortion[0] + lens[3]:+.3f} ± {sigma[3]:.3f}"
    if not (np.abs(lens) > _SIGNIFICANT * sigma).any():
        return (
            f"the intrinsics may be off, but these views cannot tell by how much ({k1}, {', '.join(changes)}; {held})"
        )
    lacks = not stated.distortion.any() and abs(lens[3]) > _SIGNIFICANT * sigma[3]
    head = f"the stated intrinsics have no distortion: {k1}" if lacks else f"the stated intrinsics do not fit: {k1}"
    return f"{head}, {', '.join(changes)}; {held}"


def _into_pose(free: PixelFit, covariance: Array) -> Array:
    """The uncertainty of the camera's pose due to the lens, through the normal equations of all other unknowns."""
    rest = np.arange(len(free.normal) - LENS)
    lens = np.arange(len(free.normal) - LENS, len(free.normal))
    moves = -np.linalg.solve(free.normal[np.ix_(rest, rest)], free.normal[np.ix_(rest, lens)])[:6]
    return np.asarray(moves @ covariance[np.ix_(lens, lens)] @ moves.T)
