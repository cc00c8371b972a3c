"""Turns stored views into views for the solver: finds the target in the pictures and reads the arm's poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib import files
from calib.condense import unusable
from calib.errors import TooFewViews
from calib.foreign.conventions import recognise
from calib.foreign.labelling import resolve_symmetry
from calib.foreign.sizing import where_the_target_was
from calib.pose_records import Convention
from calib.types import Setup, View
from perception.board import find
from perception.board.types import Board, CalibrationTarget, Corners
from perception.errors import BoardNotFound, PerceptionError

MIN_TO_RECOGNISE = 5


@dataclass(frozen=True, eq=False)
class DetectedViews:
    """The views with a target, and sentences about the others."""

    setup: Setup
    views: tuple[View, ...]
    left_out: tuple[str, ...]  # sentences: pictures without a target, with the reason
    recognised: tuple[str, ...]  # sentences: conventions that were recognised instead of stated


def detect_views(stored: files.Folder) -> DetectedViews:
    """Find the target in every picture and read every pose.

    A picture without it is left out and named. Raises PerceptionError if no picture shows it, UnusableViews if poses
    can be read in two ways.
    """
    setup, pattern_notes = _with_pattern(stored, files.as_setup(stored.setup))
    view_corners: list[tuple[files.StoredView, Corners]] = []
    failed: list[tuple[str, PerceptionError]] = []
    for view in stored.views:
        try:
            view_corners.append((view, corners_of(view, stored, setup.board)))
        except PerceptionError as error:
            failed.append((view.name, error))
    if not view_corners:
        _give_up(failed)
    how, convention_notes = _convention(stored, setup, view_corners)
    views = [
        View(
            name=view.name,
            corners=corners,
            q_rad=view.record.joints_rad(how),
            X_BF=view.record.flange(how),
            infrared=_infrared(view, setup),
            t_camera_s=view.record.t_camera_s,
            t_arm_s=view.record.t_arm_s,
        )
        for view, corners in view_corners
    ]
    left_out = tuple(f"view {name}: {error}" for name, error in failed)
    if stored.setup.work_box_m is None:
        setup = replace(setup, work_points_m=where_the_target_was(views, setup, stored.forward))
    return DetectedViews(
        setup, resolve_symmetry(views, setup, stored.forward), left_out, (*pattern_notes, *convention_notes)
    )


def corners_of(view: files.StoredView, stored: files.Folder, target: CalibrationTarget) -> Corners:
    """The corners found in the picture, or stated by the view. Raises PerceptionError."""
    if view.colour is None and (X_CM := view.record.target()) is not None:
        return files.posed_corners(X_CM, target, stored.setup.colour.intrinsics())
    if view.colour is None:
        return files.given_corners(view, stored.setup)
    return find(view.colour, target, stored.setup.colour.intrinsics())


def _give_up(failed: Sequence[tuple[str, PerceptionError]]) -> None:
    """Raise the commonest error of a folder in which no picture shows the target."""
    kinds = [type(error) for _, error in failed]
    most = max(dict.fromkeys(kinds), key=kinds.count)
    name, error = next((name, error) for name, error in failed if type(error) is most)
    if most is BoardNotFound:
        raise TooFewViews(f"none of {len(failed)} views shows the board: view {name}: {error}")
    raise most(f"none of {len(failed)} views can be used: view {name}: {error}")


def _with_pattern(stored: files.Folder, setup: Setup) -> tuple[Setup, tuple[str, ...]]:
    """Choose the pattern in the pictures: a ChArUco board with an even number of rows exists in two patterns."""
    board = setup.board
    if not isinstance(board, Board) or board.squares_down % 2:
        return setup, ()
    other = replace(board, legacy=not board.legacy)
    for view in stored.views:
        if view.colour is None or _shows(view, stored, board):
            return setup, ()
        if _shows(view, stored, other):
            which = "legacy pattern (OpenCV before 4.6)" if other.legacy else "pattern of OpenCV 4.6 and later"
            note = f"the board is of the {which}, not as stated; used so (legacy = {str(other.legacy).lower()})"
            return replace(setup, board=other), (note,)
    return setup, ()


def _shows(view: files.StoredView, stored: files.Folder, board: Board) -> bool:
    try:
        corners_of(view, stored, board)
    except PerceptionError:
        return False
    return True


def _convention(
    stored: files.Folder, setup: Setup, view_corners: Sequence[tuple[files.StoredView, Corners]]
) -> tuple[Convention, tuple[str, ...]]:
    """The convention of the poses: stated by the keys or by `[poses]`, or recognised from the pictures."""
    stated = {key: value for key, value in stored.setup.poses if value is not None}
    questions = frozenset[str]().union(*(view.record.questions() for view, _ in view_corners))
    if questions <= set(stated):
        return replace(Convention(), **stated), ()
    good = [(v, c) for v, c in view_corners if not unusable(c, setup.board, setup.colour)]
    if len(good) < MIN_TO_RECOGNISE:
        raise TooFewViews(
            f"{len(good)} usable views are too few to recognise the convention of the poses: state in [poses] of"
            f" {files.SETUP} {', '.join(sorted(questions - set(stated)))}"
        )
    names = [(view.name, corners) for view, corners in good]
    return recognise(names, [view.record for view, _ in good], stored.setup.poses, setup, stored.forward)


def _infrared(view: files.StoredView, setup: Setup) -> Corners | None:
    if view.infrared is None or setup.infrared is None:
        return None
    try:
        return find(view.infrared, setup.board, setup.infrared)
    except BoardNotFound:
        return None  # infrared is only a further check, not required
