"""A calibration from the first picture to the stored result. Read downwards: this is the order of events.

Every view is on the disk before the next motion. If anything stops the series (an operator, a cable, a power cut), the
next run continues from its folder.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.bench.calibration import camera_check, pictures, terminal_views, touching
from adaptsim_cli.bench.calibration import page as report
from adaptsim_cli.bench.calibration.board_mover import Arrival, BoardMover
from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.bench.calibration.solving import SolvedFolder, solve_folder
from adaptsim_cli.bench.calibration.store import REPORT, CalibrationStore, Series
from adaptsim_cli.bench.calibration.taking import Look, ViewRefused, look, record_motion
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.views import Readiness, failures
from adaptsim_cli.storage import durable
from calib import files, touch
from calib.bundle import Unknowns
from calib.drift import MIN_VIEWS, drift
from calib.errors import CalibrationRejected, TooFewViews, UnusableViews
from calib.poses import Coverage, coverage
from calib.saved import SavedCalibration
from calib.types import Drift, Grade, View
from hw.kinematics import forward
from hw.types import Array
from perception.board.types import Corners
from perception.errors import BoardMirrored, BoardNotFound, WrongBoard

TRIES = 3


@dataclass(frozen=True, eq=False)
class BoardViews:
    """The views so far."""

    names: tuple[str, ...] = ()
    corners: tuple[Corners, ...] = ()
    X_CM: tuple[Array, ...] = ()

    def with_view(self, name: str, corners: Corners, X_CM: Array) -> BoardViews:
        """These and another view: its name, corners in pixels, and board pose (4, 4) in the camera."""
        return BoardViews((*self.names, name), (*self.corners, corners), (*self.X_CM, X_CM))

    def coverage(self, rig: CalibrationRig) -> Coverage | None:
        """The coverage of the views; None before the first view."""
        return coverage(self.corners, self.X_CM, rig.board, rig.camera.model().colour) if self.names else None


def calibrate(
    rig: CalibrationRig,
    store: CalibrationStore,
    mover: BoardMover,
    screen: Screen,
    *,
    fresh: bool,
    unattended: bool,
    created: str = "",
) -> tuple[SolvedFolder, Path]:
    """Check, visit, solve, store; return the solution and the folder of the stored calibration.

    `fresh` begins a new series, even if one is unfinished; `unattended`: nobody answers questions; `created` is now or
    ISO 8601.

    Raises PreflightFailed, HardwareError, PerceptionError, StoppedByOperator, CalibrationError, SessionError.
    """
    setup = files.setup_record(rig.camera.model(), rig.board, rig.arm.model, rig.X_FM)
    series, begun = store.series(setup, fresh=fresh)
    screen.file("  Views", series.folder)
    board_views = _seen_before(series, rig, screen) if begun else BoardViews()
    _ready(rig, screen)
    board_views = visit_all(rig, series, mover, screen, board_views)
    if not board_views.names:
        raise TooFewViews(
            "no view shows the board: check that it is in the gripper, with its print towards the camera, and well lit"
        )
    touching.offer(rig, series, screen, unattended=unattended)
    with screen.busy("Solving"):
        solved = solve_folder(series.folder, hw=rig.name, created=created)
    return solved, conclude(solved, store, series.folder, screen)


def check(rig: CalibrationRig, calibration: SavedCalibration, mover: BoardMover, screen: Screen) -> Drift:
    """`calibrate check`: take three views and compare them with the calibration in use.

    Stores nothing. Raises TooFewViews, HardwareError, PerceptionError, StoppedByOperator.
    """
    from perception.board import detect

    camera = rig.camera.model().colour
    setup = files.as_setup(files.setup_record(rig.camera.model(), rig.board, rig.arm.model))
    views: list[View] = []
    with mover.series():
        for number in mover.numbers(frozenset()):
            if mover.go(number, None) is not Arrival.THERE:
                continue
            try:
                shot = look(rig)
                corners = detect(shot.frame.colour, rig.board, camera)
            except (ViewRefused, BoardNotFound, WrongBoard, BoardMirrored) as error:
                screen.note(f"  place {number + 1} left out: {error}")
                continue
            views.append(View(f"{number + 1:03d}", corners, q_rad=shot.q_rad))
            screen.show(f"  {len(views)} of {MIN_VIEWS}  {len(corners)} of {rig.board.corners} corners")
            if len(views) == MIN_VIEWS:
                break
        mover.end(lambda: None)
    joint_rad = float("nan") if calibration.joint_rad is None else calibration.joint_rad
    was = Unknowns(np.array(calibration.X_AC)[None], np.array(calibration.X_HM), calibration.offsets_rad())
    return drift(views, setup, forward, was, joint_rad)


def _seen_before(series: Series, rig: CalibrationRig, screen: Screen) -> BoardViews:
    """The views of an interrupted run."""
    from perception.board import detect, locate

    board_views, camera = BoardViews(), rig.camera.model().colour
    if not series.has_views:
        return board_views
    folder = files.read_folder(series.folder)
    for view in folder.views:
        assert view.colour is not None  # our own views always have a picture
        corners = detect(view.colour, rig.board, camera)
        X_CM = locate(corners, rig.board, camera).X_VM
        if not series.path_of_picture(view.name).exists():  # the run was stopped just before this
            _picture(rig, series, board_views, view.name, view.colour, corners, X_CM)
        board_views = board_views.with_view(view.name, corners, X_CM)
    for sentence in folder.damaged:
        screen.note(f"  taken again: {sentence}")
    screen.note(f"Continuing with {len(board_views.names)} stored views. --fresh starts again without them.")
    return board_views


def _ready(rig: CalibrationRig, screen: Screen) -> None:
    state = rig.arm.state()
    healthy = Readiness("arm", state.fault is None, state.fault or f"{rig.arm.model}, no fault")
    checks = (healthy, *camera_check.before(rig.camera.snapshot(), rig.camera.model()), _warm(rig))
    screen.checks(checks)
    if problem := failures(checks):
        raise PreflightFailed(f"not ready, nothing has moved: {problem}")


def _warm(rig: CalibrationRig) -> Readiness:
    return camera_check.warm(rig.is_real, rig.temperatures_C().get("camera"))


def visit_all(
    rig: CalibrationRig, series: Series, mover: BoardMover, screen: Screen, board_views: BoardViews
) -> BoardViews:
    """Visit all places without a view. Raises the error that stops it; every view taken is stored."""
    done_numbers = {int(name) - 1 for name in board_views.names}
    left = mover.numbers(done_numbers)
    if not left and series.has_motion:
        return board_views
    with mover.series():
        if not left:
            mover.go(max(done_numbers), None)  # a place with the board in view, for the missing film of the swing
        for number in left:
            arrival = mover.go(number, board_views.coverage(rig))
            if arrival is Arrival.ENOUGH:
                break
            if arrival is Arrival.THERE:
                board_views = _view(rig, series, screen, board_views, number, len(done_numbers) + len(left))
        mover.end(lambda: record_motion(rig, series, screen))
    return board_views


def _view(
    rig: CalibrationRig, series: Series, screen: Screen, board_views: BoardViews, number: int, total: int
) -> BoardViews:
    """Take, store and show one view. A view that does not count is named and left out."""
    from perception.board import detect, locate

    name, camera = f"{number + 1:03d}", rig.camera.model().colour
    try:
        shot = _look_again(rig, screen)
        corners = detect(shot.frame.colour, rig.board, camera)
        pose = locate(corners, rig.board, camera)
    except (ViewRefused, BoardNotFound, WrongBoard, BoardMirrored) as error:
        if isinstance(error, WrongBoard | BoardMirrored) and not board_views.names:
            raise  # of the first picture: the board is another than stated
        screen.note(f"  view {name} left out: {error}")
        return board_views
    if not board_views.names:
        checks = camera_check.at_board(shot.frame, corners)
        screen.checks(checks)
        if problem := failures(checks):
            raise PreflightFailed(f"the camera cannot calibrate like this: {problem}")
    series.add(files.view_files(name, shot.frame, shot.q_rad, shot.t_arm_s, number, rig.temperatures_C()))
    path = _picture(rig, series, board_views, name, shot.frame.colour, corners, pose.X_VM)
    board_views = board_views.with_view(name, corners, pose.X_VM)
    so_far = board_views.coverage(rig)
    assert so_far is not None
    screen.show(terminal_views.view(len(board_views.names), total, len(corners), rig.board.corners, pose, so_far, path))
    return board_views


def _picture(
    rig: CalibrationRig,
    series: Series,
    before: BoardViews,
    name: str,
    colour: NDArray[np.uint8],
    corners: Corners,
    X_CM: Array,
) -> Path:
    """Store the picture of a view for people, with its corners and those of earlier views; return the picture."""
    drawn = pictures.draw_view(colour, corners, X_CM, before.corners, rig.board, rig.camera.model().colour)
    series.picture("latest.jpg", drawn)
    return series.picture(series.path_of_picture(name).name, drawn)


def _look_again(rig: CalibrationRig, screen: Screen) -> Look:
    """Try several times, because the arm may still swing. Raises the last ViewRefused."""
    for _ in range(TRIES - 1):
        try:
            return look(rig)
        except ViewRefused as error:
            screen.note(f"  taken again: {error}")
    return look(rig)


def conclude(solved: SolvedFolder, store: CalibrationStore, views: Path, screen: Screen) -> Path:
    """Show, and store if accepted.

    Else raise CalibrationRejected: the report lies beside the views, and nothing is replaced.
    """
    page = report.render(solved).encode()
    screen.show(terminal_views.calibration(solved.record))
    for sentence in solved.influence.sentences:
        screen.plain(f"  {sentence}")
    show_arm(solved, views / pictures.ARM_PICTURE, screen)
    if not solved.record.accepted:
        durable.replace_file(views / REPORT, page)
        advice = "The calibration in use stays. --fresh starts a new series of views"
        if any(check.name == touch.NAME and check.verdict == Grade.BAD for check in solved.record.checks):
            Series(views).set_aside_touch()
            advice += "; without it, the same views are used again and you touch the corner again"
        raise rejected(solved, views / REPORT, advice)
    folder = store.save(solved.record, page)
    screen.file("Report", folder / REPORT)
    return folder


def show_arm(solved: SolvedFolder, path: Path, screen: Screen) -> None:
    """Show a picture with the arm drawn into it, if the arm's looks are known. A person judges it; it never rejects."""
    try:
        drawn = pictures.draw_arm(solved)
    except UnusableViews:
        return
    durable.replace_file(path, drawn.sheet())
    screen.file("Look whether the lines lie on the edges of the arm", path)
    screen.note(f"  {drawn.sentence}")


def rejected(solved: SolvedFolder, page: Path, advice: str) -> CalibrationRejected:
    """The error with every reason, the page to read, and the remedy."""
    record = solved.record
    reasons = "; ".join(gate.message for gate in (*record.gates, *record.checks) if gate.verdict == "bad")
    error = CalibrationRejected(f"not accepted: {reasons}")
    error.add_note(f"Report: {page}\n{advice}")
    return error
