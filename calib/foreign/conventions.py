"""Recognises units and orders of poses that do not state them: every reading is tried against the pictures.

Closed forms rank the readings; the best few are solved in full. A reading is accepted only if most views agree under it
and no other reading comes near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from calib.closed_form import robust_start, size_by_motion
from calib.condense import condense
from calib.errors import UnusableViews
from calib.foreign.labelling import resolve_symmetry
from calib.foreign.sizing import roughly_sized
from calib.geometry import difference
from calib.pose_records import EULER, Convention, PoseKeys, PosesRecord
from calib.solve import demand_variety, solve
from calib.types import Forward, Mounting, Setup, View
from hw.poses import inverse
from hw.types import Array
from perception.board.types import Corners

_CLEAR = 3.0
"""The next best reading must fit worse by this factor."""
_SOLVED = 3
_MOST = 0.6  # of the views must agree under a reading
_LEVER_M = 0.5
_FAR_M = 10.0  # no flange is this far from its base: a larger number is in millimetres
_TURN_RAD = 7.0  # no joint turns this far: a larger number is in degrees

_OPTIONS = {
    "length": ("m", "mm"),
    "angle": ("rad", "deg"),
    "quaternion": ("wxyz", "xyzw"),
    "euler": EULER,
    "gives": ("flange_in_base", "base_in_flange"),
}


def recognise(
    named_corners: Sequence[tuple[str, Corners]],
    poses: Sequence[PoseKeys],
    record: PosesRecord,
    setup: Setup,
    forward: Forward | None,
) -> tuple[Convention, tuple[str, ...]]:
    """The reading of `poses` (N) that matches the motion in the pictures, and sentences about its recognised parts. The
    motion follows from the corners of each view (N); the names are for messages.

    Raises UnusableViews if no reading fits, or more than one; it names the key that `[poses]` must state;
    DegenerateViews if the views are too alike to tell.
    """
    questions = frozenset[str]().union(*(keys.questions() for keys in poses))
    stated = {key: value for key, value in record if value is not None}
    open_ones = {key: _by_size(key, poses) for key in sorted(questions - set(stated))}
    convention = replace(Convention(), **stated, **{key: values[0] for key, values in open_ones.items()})
    undecided = {key: values for key, values in open_ones.items() if len(values) > 1}
    if not undecided:
        return convention, _sentences(convention, open_ones)
    readings = [
        replace(convention, **dict(zip(undecided, chosen, strict=True))) for chosen in product(*undecided.values())
    ]
    sight = condense(
        [name for name, _ in named_corners], [corners for _, corners in named_corners], setup.board, setup.colour
    )
    demand_variety(sight.X_CM[0])
    rough = np.array([_score(poses, reading, sight.X_CM[0], setup, forward) for reading in readings])
    hopeful = [int(i) for i in np.argsort(rough, kind="stable")[:_SOLVED] if np.isfinite(rough[i])]
    fits = sorted((_misfit_px(named_corners, poses, readings[i], setup, forward), i) for i in hopeful)
    names = ", ".join(f"{key} ({' or '.join(values)})" for key, values in undecided.items())
    if not fits or not np.isfinite(fits[0][0]):
        raise UnusableViews(
            f"no reading of the poses fits the pictures: state in [poses] of setup.toml {names}; if that is already "
            "right, pictures and poses do not belong together"
        )
    best = readings[fits[0][1]]
    if len(fits) > 1 and fits[1][0] < _CLEAR * fits[0][0]:
        other = readings[fits[1][1]]
        alike = [f"{key} {getattr(best, key)} or {getattr(other, key)}" for key in undecided]
        raise UnusableViews(
            f"the poses can be read in two ways that both fit the pictures ({'; '.join(alike)}): state in [poses] of"
            f" setup.toml {names}"
        )
    return best, _sentences(best, open_ones)


def _misfit_px(
    named_corners: Sequence[tuple[str, Corners]],
    poses: Sequence[PoseKeys],
    how: Convention,
    setup: Setup,
    forward: Forward | None,
) -> float:
    """Root mean square distance of the corners in a full solution; inf if too few views agree on one."""
    X_BF = motion(poses, how, forward)
    views = [View(name, corners, X_BF=X) for (name, corners), X in zip(named_corners, X_BF, strict=True)]
    try:
        views = list(resolve_symmetry(views, setup, None))
        solution = solve(views, roughly_sized(views, setup, None), None)
    except UnusableViews:
        return float("inf")
    return solution.fit_px if len(solution.used) >= _MOST * len(views) else float("inf")


def _by_size(key: str, poses: Sequence[PoseKeys]) -> tuple[str, ...]:
    """The readings that are compatible with the sizes of the numbers."""
    if key == "length":
        far = [np.linalg.norm(p.position or [row[3] for row in (p.matrix or ())[:3]] or [0.0]) for p in poses]
        return ("mm",) if float(np.median(far)) > _FAR_M else ("m",)
    if key == "angle":
        most = max(max(map(abs, p.joints or p.rotation_vector or p.euler or (0.0,))) for p in poses)
        return ("deg",) if most > _TURN_RAD else _OPTIONS[key]
    return _OPTIONS[key]


def _sentences(convention: Convention, open_ones: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    if not open_ones:
        return ()
    listing = ", ".join(f'{key} = "{getattr(convention, key)}"' for key in open_ones)
    return (f"[poses] of setup.toml does not say how to read the poses; recognised: {listing}",)


def _score(poses: Sequence[PoseKeys], how: Convention, X_CM: Array, setup: Setup, forward: Forward | None) -> float:
    """Distance of the median view from a closed form of this reading, in m; inf if it gives no valid pose."""
    try:
        X_BF = motion(poses, how, forward)
    except ValueError:
        return float("inf")
    X_AH = X_BF if setup.mounting is Mounting.FIXED else inverse(X_BF)
    scaled_X_CM = X_CM.copy()
    if not setup.size_known:
        scaled_X_CM[:, :3, 3] *= size_by_motion(X_AH, X_CM)
    X_AC, X_HM = robust_start(X_AH, scaled_X_CM)
    off = difference(inverse(X_AC) @ X_AH @ X_HM, scaled_X_CM)
    return float(np.median(np.linalg.norm(off[:, 3:], axis=1) + _LEVER_M * np.linalg.norm(off[:, :3], axis=1)))


def motion(poses: Sequence[PoseKeys], how: Convention, forward: Forward | None) -> Array:
    """(N, 4, 4) X_BF. Raises ValueError if the numbers are not a pose in this reading."""
    flanges = []
    for keys in poses:
        q_rad = keys.joints_rad(how)
        X = keys.flange(how) if q_rad is None else None if forward is None else forward(q_rad)
        if X is None:
            raise ValueError("joints of an arm whose kinematics are not known")
        flanges.append(X)
    return np.stack(flanges)
