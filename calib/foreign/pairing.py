"""Diagnoses rejected views: pictures and poses that do not belong together, or a part that moved.

Each kind of fault has its own pattern. Pictures of exchanged views fit each other's poses. After a lost or doubled
picture, later pictures fit the pose of a neighbour. Stale joints repeat those of the previous view while the picture
changes. A slipped target changes only its pose in the holder; a moved camera changes only its own pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.bundle import motion_of
from calib.errors import UnusableViews, determined
from calib.foreign.labelling import renumbered, resolve_symmetry
from calib.foreign.pixels import Observations, PixelUnknowns, adjust, observations, poses, rms_px
from calib.foreign.sizing import solve_any_size
from calib.geometry import angle_deg, distance_mm, move
from calib.projection import LENS
from calib.types import Forward, Mounting, Setup, Solution, View
from hw.types import Array

MIN_SEGMENT = 4
_FITS = 4.0  # multiple of the usual error of agreeing views
_FITS_PX = 2.0
_STRAINED = 5.0
"""A fit with residuals this many times the corners' noise is a compromise between two arrangements."""
_WORSE = 4.0
"""A rejected view must fit another pose this many times better than its own."""
_SAME_MM, _SAME_DEG = 0.5, 0.05
_NO_WORSE = 1.2
"""An exchange may add views, but the error of predicted held-out views must not grow by more than this factor."""
_TELLS = 1.5
"""An explanation of a change counts if the other explanation leaves residuals this many times larger."""
_TWIST = np.array([0.02, -0.01, 0.015, 1e-3, 1e-3, -1e-3])


@dataclass(frozen=True)
class Fault:
    """One fault in words, and the option of `calibrate solve` that repairs it ("" if there is none)."""

    kind: str  # exchanged, shifted, lost, stale, repeated picture, slipped, moved, mounting
    sentence: str
    option: str
    views: tuple[str, ...]


@determined()
def faults(
    views: Sequence[View], setup: Setup, forward: Forward | None, solution: Solution | None
) -> tuple[Fault, ...]:
    """The faults of the views that the solution rejects, or of all views if there is no solution. Views by name."""
    ordered = sorted(views, key=lambda view: view.name)
    if solution is None or len(solution.used) < 0.7 * len(ordered):
        whole = _shift_of_all(ordered, setup, forward, solution) or _other_mounting(ordered, setup, forward, solution)
        if whole is not None:
            return (whole,)
        lost = _lost_pictures(ordered, setup, forward)
        if lost is not None:
            return (lost,)
    return _tried(_among(ordered, setup, forward, solution), ordered, setup, forward, solution)


def _among(
    ordered: Sequence[View], setup: Setup, forward: Forward | None, solution: Solution | None
) -> tuple[Fault, ...]:
    if solution is not None:
        misfits = _crossed(ordered, solution, setup, forward)
        faults = _explained(misfits)
        strained = solution.fit_px > _STRAINED * np.sqrt(2.0) * solution.noise.corner_px
        if faults or (len(misfits.bad) < MIN_SEGMENT and not strained):
            return faults
    for half, sized in _halves(ordered, setup, forward):
        faults = _explained(_crossed(ordered, half, sized, forward))
        if faults:
            return faults
    return ()


def _tried(
    faults: tuple[Fault, ...], views: Sequence[View], setup: Setup, forward: Forward | None, solution: Solution | None
) -> tuple[Fault, ...]:
    """The same faults. An exchange is offered only if the exchanged views give a better solution."""
    swaps = [fault for fault in faults if fault.kind == "exchanged"]
    if not swaps:
        return faults
    pairs = [(fault.views[0], fault.views[1]) for fault in swaps]
    try:
        other, _ = solve_any_size(resolve_symmetry(exchanged(views, pairs), setup, forward), setup, forward)
    except UnusableViews as error:
        return tuple(_untold(fault, f"so exchanged, the views cannot be solved ({error})") for fault in faults)
    if solution is None:
        return faults
    before, after = solution.choice.held_out_px, other.choice.held_out_px
    if len(other.used) > len(solution.used) and after < _NO_WORSE * before:
        return faults
    message = (
        f"so exchanged, {len(other.used)} views instead of {len(solution.used)} agree, and held-out ones are predicted "
        f"to {after:.2f} px instead of {before:.2f}: the views stay left out"
    )
    return tuple(_untold(fault, message) for fault in faults)


def _untold(fault: Fault, why: str) -> Fault:
    if fault.kind != "exchanged":
        return fault
    return replace(fault, sentence=f"{fault.sentence}; {why}", option="")


def _explained(misfits: _Crossed) -> tuple[Fault, ...]:
    stale = misfits.stale()
    left = [i for i in misfits.bad if misfits.views[i].name not in {name for fault in stale for name in fault.views}]
    exchanged = misfits.exchanged(left)
    left = [i for i in left if misfits.views[i].name not in {name for fault in exchanged for name in fault.views}]
    return (*stale, *exchanged, *misfits.shifted_tail(left), *misfits.slipped_or_moved(left))


def exchanged(views: Sequence[View], pairs: Sequence[tuple[str, str]]) -> list[View]:
    """The views with the poses of each pair of names exchanged. Raises UnusableViews for an unknown name."""
    by_name = {view.name: view for view in views}
    for pair in pairs:
        missing = [name for name in pair if name not in by_name]
        if missing:
            raise UnusableViews(f"--exchange names view {missing[0]}; there are {', '.join(sorted(by_name))}")
        a, b = (by_name[name] for name in pair)
        by_name[a.name], by_name[b.name] = _posed(a, b), _posed(b, a)
    return [by_name[view.name] for view in views]


def pictures_exchanged(views: Sequence[View], pairs: Sequence[tuple[str, str]]) -> list[View]:
    """`exchanged`, but names stay with the poses: with several cameras a name means a posture of the arm."""
    names = {name: other for a, b in pairs for name, other in ((a, b), (b, a))}
    return [replace(view, name=names.get(view.name, view.name)) for view in exchanged(views, pairs)]


def shifted(views: Sequence[View], by: int) -> list[View]:
    """Each picture with the pose of the view that is `by` places later in the order of names. Pictures without such a
    view are left out.
    """
    ordered = sorted(views, key=lambda view: view.name)
    at = [(i, i + by) for i in range(len(ordered)) if 0 <= i + by < len(ordered)]
    return [_posed(ordered[i], ordered[j]) for i, j in at]


def _posed(view: View, other: View) -> View:
    return replace(view, q_rad=other.q_rad, X_BF=other.X_BF)


@dataclass(frozen=True, eq=False)
class _Crossed:
    """The fit of every picture with every pose."""

    views: Sequence[View]
    observations: Observations
    place: PixelUnknowns
    px: Array  # (N, N) error of picture i with the pose of view j
    bad: tuple[int, ...]
    limit_px: float
    noise_px: float
    scale: bool

    def fits(self, i: int, j: int) -> bool:
        """Does picture i belong to the pose of view j?"""
        return bool(self.px[i, j] < self.limit_px and self.px[i, j] * _WORSE < self.px[i, i])

    def stale(self) -> tuple[Fault, ...]:
        """Poses or pictures that repeat those of the previous view."""
        faults = []
        for i in self.bad:
            if i == 0:
                continue
            name, before = self.views[i].name, self.views[i - 1].name
            X, X_before = self.observations.X_AH[i], self.observations.X_AH[i - 1]
            if distance_mm(X, X_before) < _SAME_MM and angle_deg(X, X_before) < _SAME_DEG:
                message = (
                    f"the pose of view {name} repeats that of {before} although the picture has changed: the joints "
                    "were read too early; the view is left out"
                )
                faults.append(Fault("stale", message, "", (name,)))
            elif self._same_picture(i, i - 1):
                message = f"the picture of view {name} repeats that of {before}: an old frame; the view is left out"
                faults.append(Fault("repeated picture", message, "", (name,)))
        return tuple(faults)

    def _same_picture(self, i: int, j: int) -> bool:
        both = self.observations.present[i] & self.observations.present[j]
        apart = np.linalg.norm(self.observations.px[i] - self.observations.px[j], axis=-1)[both]
        return len(apart) > 0 and float(np.median(apart)) < 3.0 * self.noise_px and self.fits(i, j)

    def exchanged(self, rows: Sequence[int]) -> tuple[Fault, ...]:
        """Pairs of views that fit each other's pose."""
        pairs = [(i, j) for i in rows for j in rows if i < j and self.fits(i, j) and self.fits(j, i)]
        return tuple(
            Fault(
                "exchanged",
                f"{self.views[i].name} and {self.views[j].name} look swapped: with each other's pose they fit to"
                f" {self.px[i, j]:.1f} and {self.px[j, i]:.1f} px, with their own to {self.px[i, i]:.0f} and"
                f" {self.px[j, j]:.0f}",
                f"--exchange {self.views[i].name}:{self.views[j].name}",
                (self.views[i].name, self.views[j].name),
            )
            for i, j in pairs
            if sum(i in pair or j in pair for pair in pairs) == 1
        )

    def shifted_tail(self, rows: Sequence[int]) -> tuple[Fault, ...]:
        """A lost picture, or one taken twice: from one view to the end every picture fits the pose of a neighbour."""
        n = len(self.views)
        if len(rows) < MIN_SEGMENT - 1 or list(rows) != list(range(rows[0], rows[-1] + 1)) or rows[-1] < n - 2:
            return ()
        for by in (1, -1):
            inside = [i for i in rows if 0 <= i + by < n]
            if len(inside) >= MIN_SEGMENT - 1 and sum(self.fits(i, i + by) for i in inside) >= 0.8 * len(inside):
                first, which = self.views[rows[0]].name, "after" if by == 1 else "before"
                message = f"from view {first} on every picture fits the pose of the view {which} it: one was lost there"
                names = tuple(self.views[i].name for i in rows)
                return (Fault("shifted", message, "", names),)
        return ()

    def slipped_or_moved(self, rows: Sequence[int]) -> tuple[Fault, ...]:
        """A change that lasts from one view to an end of the series."""
        n = len(self.views)
        at_end = list(rows) == list(range(n - len(rows), n))
        at_start = list(rows) == list(range(len(rows)))
        if len(rows) < MIN_SEGMENT or not (at_end or at_start):
            return ()
        later = np.isin(np.arange(n), list(rows)).astype(np.int64)
        twice = np.stack([np.zeros(6), _TWIST])
        one = self.place
        slipped = adjust(
            replace(self.observations, mounting=later),
            replace(one, X_HM=move(np.repeat(one.X_HM, 2, axis=0), twice)),
            self.noise_px,
            scale=self.scale,
            lens=False,
        )
        moved = adjust(
            replace(self.observations, cameras=self.observations.cameras * 2, camera=later),
            replace(one, X_AC=move(np.repeat(one.X_AC, 2, axis=0), twice), lens=np.zeros((2, LENS))),
            self.noise_px,
            scale=self.scale,
            lens=False,
        )
        if min(slipped.px, moved.px) > 2 * self.limit_px or max(slipped.px, moved.px) < _TELLS * min(
            slipped.px, moved.px
        ):
            return ()
        last = n - len(rows) - 1 if at_end else len(rows) - 1
        before, after = self.views[last].name, self.views[last + 1].name
        names = tuple(self.views[i].name for i in rows)
        option = f"--until {before}" if at_end else f"--from {after}"
        if slipped.px < moved.px:
            X, Y = slipped.place.X_HM
            what, other, left, instead = "the board slipped", "a moved camera", slipped.px, moved.px
        else:
            X, Y = moved.place.X_AC
            what, other, left, instead = "the camera was moved", "a slipped board", moved.px, slipped.px
        message = (
            f"{what} between {before} and {after}, by {distance_mm(X, Y):.1f} mm and {angle_deg(X, Y):.1f}°: that"
            f" leaves {left:.1f} px, {other} {instead:.1f}"
        )
        return (Fault("slipped" if slipped.px < moved.px else "moved", message, option, names),)


def _crossed(views: Sequence[View], solution: Solution, setup: Setup, forward: Forward | None) -> _Crossed:
    moved = motion_of(views, setup.mounting, forward)
    X_AH = moved.X_AH(solution.offsets_rad(moved.joints))
    readings = [renumbered(view.corners, setup.board) for view in views]
    numbered = [
        observations([reading[k] for reading in readings], X_AH, setup.board, setup.colour)
        for k in range(1 + len(setup.board.turns))
    ]
    of = numbered[0]
    place = PixelUnknowns(solution.X_AC[None], solution.X_HM[None], 1.0, np.zeros((1, LENS)))
    n = len(views)
    px = np.full((n, n), np.inf)
    for j in range(n):
        for one in numbered:
            under = replace(one, X_AH=np.broadcast_to(X_AH[j], (n, 4, 4)))
            in_front = poses(place, under)[:, 2, 3] > 0.05
            px[:, j] = np.minimum(px[:, j], np.where(in_front, rms_px(place, under), np.inf))
    used = [i for i, view in enumerate(views) if view.name in set(solution.used)]
    usual = float(np.median(px[used, used]))
    limit = max(_FITS * usual, _FITS_PX)
    bad = tuple(i for i in range(n) if px[i, i] > limit)
    return _Crossed(views, of, place, px, bad, limit, max(usual / np.sqrt(2.0), 0.02), not setup.size_known)


def _shift_of_all(
    views: Sequence[View], setup: Setup, forward: Forward | None, solution: Solution | None
) -> Fault | None:
    """The fault that every picture has the pose of its neighbour; None if that is not the case."""
    agreed = 0 if solution is None else len(solution.used)
    for by in (1, -1):
        try:
            other, _ = solve_any_size(shifted(views, by), setup, forward)
        except UnusableViews:
            continue
        if len(other.used) >= 0.8 * (len(views) - 1) and len(other.used) > agreed + 2:
            which = "after" if by == 1 else "before"
            message = (
                f"pictures and poses are shifted by one: with the pose of the view {which} it, each of"
                f" {len(other.used)} views fits ({other.fit_px:.1f} px)"
            )
            return Fault("shifted", message, f"--shift {by}", tuple(view.name for view in views))
    return None


FARTHEST = 5
"""A picture's pose is searched among those of neighbours that are at most this many places away."""
_MOST_LOST = 6  # places at which pictures are missing or doubled
_SHARE = 0.8


def _lost_pictures(views: Sequence[View], setup: Setup, forward: Forward | None) -> Fault | None:
    """The fault that a few pictures, or poses, are missing: from some views on, each picture has the pose of a view a
    few places away.

    An agreeing part of the series gives a calibration, with which every picture finds its own pose.
    """
    for part, sized in _parts(views, setup, forward):
        misfits = _crossed(views, part, sized, forward)
        shifts = [_shift(misfits, i) for i in range(len(views))]
        own = [shift for shift in shifts if shift is not None]
        if len(own) < _SHARE * len(views) or not any(own):
            continue
        steps, now = list[tuple[str, int]](), 0
        for i, shift in enumerate(shifts):
            if shift is None or shift == now or i + 1 >= len(views) or shifts[i + 1] not in (shift, None):
                continue  # one picture alone may fit a neighbour by chance
            steps.append((views[i].name, shift))
            now = shift
        if not 0 < len(steps) <= _MOST_LOST:
            continue
        places = ", ".join(f"{name} (by {shift:+d})" for name, shift in steps)
        agree = [view.name for view, shift in zip(views, shifts, strict=True) if shift == 0]
        message = (
            f"pictures and poses are shifted from view {places} on: pictures are missing or doubled there. "
            f"{len(agree)} views agree as they are{f', {agree[0]} to {agree[-1]}' if agree else ''}; give each picture "
            "from there on the pose of the view so many places later"
        )
        return Fault("lost", message, "", tuple(view.name for view, shift in zip(views, shifts, strict=True) if shift))
    return None


def _shift(misfits: _Crossed, i: int) -> int | None:
    """The number of places from picture i to its pose; None if it fits none."""
    inside = [s for s in range(-FARTHEST, FARTHEST + 1) if 0 <= i + s < len(misfits.views)]
    best = min(inside, key=lambda s: (float(misfits.px[i, i + s]), abs(s)))
    return best if misfits.px[i, i + best] < misfits.limit_px else None


def _parts(views: Sequence[View], setup: Setup, forward: Forward | None) -> Iterator[tuple[Solution, Setup]]:
    """Solutions of runs of views that agree: the first half, then shorter runs from front to back."""
    n = len(views)
    for length in dict.fromkeys(max(size, 8) for size in (n // 2, n // 3, n // 5)):
        for start in range(0, n - length + 1, max(length // 2, 1)):
            part = views[start : start + length]
            try:
                solution, sized = solve_any_size(part, setup, forward)
            except UnusableViews:
                continue
            if len(solution.used) >= _SHARE * len(part):
                yield solution, sized


def _other_mounting(
    views: Sequence[View], setup: Setup, forward: Forward | None, solution: Solution | None
) -> Fault | None:
    """The fault of a wrong mounting in setup.toml (fixed instead of wrist, or the other way round), if there is one."""
    other = Mounting.WRIST if setup.mounting is Mounting.FIXED else Mounting.FIXED
    try:
        other_solution, _ = solve_any_size(
            views, Setup(other, setup.board, setup.colour, size_known=setup.size_known), forward
        )
    except UnusableViews:
        return None
    if len(other_solution.used) < 0.8 * len(views) or (
        solution is not None and len(other_solution.used) <= len(solution.used) + 2
    ):
        return None
    message = (
        f'the camera is declared camera = "{setup.mounting.value}" in setup.toml, but with camera = "{other.value}" '
        f"{len(other_solution.used)} of {len(views)} views fit ({other_solution.fit_px:.1f} px)"
    )
    return Fault("mounting", message, "", tuple(view.name for view in views))


def _halves(views: Sequence[View], setup: Setup, forward: Forward | None) -> Iterator[tuple[Solution, Setup]]:
    """Solutions of the first and of the second half, in case something changed in between."""
    middle = len(views) // 2
    for part in (views[:middle], views[middle:]):
        try:
            solution, sized = solve_any_size(part, setup, forward)
        except UnusableViews:
            continue
        if len(solution.used) >= 0.8 * len(part):
            yield solution, sized
