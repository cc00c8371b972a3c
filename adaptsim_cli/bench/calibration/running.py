"""From the command line to a running calibration, and from its result to the screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from rich.text import Text

from adaptsim_cli.bench.calibration import flow, pictures, printing, terminal_views, together
from adaptsim_cli.bench.calibration import page as report
from adaptsim_cli.bench.calibration.board_mover import Automatic, BoardMover, HandGuided, plan
from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.bench.calibration.solving import SolveOptions, solve_folder
from adaptsim_cli.bench.calibration.store import REPORT, CalibrationStore
from adaptsim_cli.config import Config, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.continuing import how_to_continue
from adaptsim_cli.screen.guided import GuidedArm
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.screen.views import FileLine, badge
from adaptsim_cli.storage import durable
from calib import checks
from calib.errors import CalibrationMissing
from calib.saved import SavedCalibration
from perception.board.types import Board

OpenRig = Callable[[Config, Board, SavedCalibration | None], AbstractContextManager[CalibrationRig]]
"""(settings, the board in the gripper, an earlier calibration) -> the devices, connected."""

RESIDUALS, OVERLAY = "residuals.csv", "overlay"

CHECK_PLACES = 6
"""Places planned for a check, which ends with the third view of the board."""


def calibrate(
    resolved: Resolved,
    store: CalibrationStore,
    sessions: Sequence[str],
    open_rig: OpenRig,
    screen: Screen,
    *,
    guide: bool = False,
    views: int = 25,
    fresh: bool = False,
    yes: bool = False,
) -> Reply:
    """The whole calibration. Raises the error that stops it, with the command to continue.

    `guide`: a person moves the arm; else it visits `views` places. `sessions` are the open ones that use the present
    calibration. `fresh` begins a new series, even if one is unfinished.
    """
    config = resolved.config
    unattended = _unattended(resolved, yes=yes, guide=guide)
    screen.resting("the calibration in use", sessions)
    board = board_in_use(resolved, screen, yes=yes)
    with (
        store.locked(),
        _continued("adaptsim calibrate"),
        open_rig(config, board, store.current()) as connected,
    ):
        rig = _guided(connected, screen) if guide else connected
        mover = _mover(rig, screen, None if guide else views, yes=yes)
        screen.show(terminal_views.explanation(rig, None if guide else views))
        solved, folder = flow.calibrate(rig, store, mover, screen, fresh=fresh, unattended=unattended)
    where = config.same_lab
    steps = [
        (f"adaptsim touch-off {where}", "finds table and tool, if the tool of the task touches the table"),
        (f"adaptsim run-iteration {where}", "the first trials with this calibration"),
    ]
    return Reply(terminal_views.summary(solved.record) | {"folder": str(folder)}, next=steps)


def check(
    resolved: Resolved,
    store: CalibrationStore,
    open_rig: OpenRig,
    screen: Screen,
    *,
    guide: bool = False,
    yes: bool = False,
) -> Reply:
    """Compare three views with the calibration in use. Raises CalibrationMissing without a calibration."""
    _unattended(resolved, yes=yes, guide=guide)
    config, calibration = resolved.config, store.current()
    if calibration is None:
        raise CalibrationMissing("there is no calibration of this rig to check; make one: adaptsim calibrate")
    board = calibration.board.board()
    if not isinstance(board, Board):
        raise UsageError(
            f"this rig was calibrated with a {board.name}; a check needs adaptsim's own board: adaptsim calibrate"
        )
    with (
        store.locked(),
        _continued("adaptsim calibrate check"),
        open_rig(config, board, calibration) as connected,
    ):
        rig = _guided(connected, screen) if guide else connected
        screen.show(badge(rig.name, rig.title))
        drift = flow.check(rig, calibration, _mover(rig, screen, None if guide else CHECK_PLACES, yes=yes), screen)
    screen.show(Text(drift.message, style="bold red" if drift.moved else "green"))
    where = config.same_lab
    again = (f"adaptsim calibrate {where}", "finds the camera's new pose")
    step = again if drift.moved else (f"adaptsim run-iteration {where}", "the calibration is still valid")
    return Reply(asdict(drift) | {"X_BC_now": drift.X_BC_now.tolist()}, next=[step])


def solve(folder: Path, out: Path | None, options: SolveOptions, screen: Screen) -> Reply:
    """Solve views recorded elsewhere. Raises ViewFolderError and PerceptionError; a rejected result is returned as the
    failure.
    """
    with screen.busy("Finding the board and solving"):
        solved = solve_folder(folder.absolute(), options=options)
    for sentence in solved.recognised:
        screen.note(f"  {sentence}")
    for sentence in solved.not_seen:
        screen.note(f"  not used: {sentence}")
    screen.show(terminal_views.calibration(solved.record))
    for sentence in solved.influence.sentences:
        screen.plain(f"  {sentence}")
    for fault in solved.faults:
        screen.note(f"  {fault.sentence}" + (f". To use them so: {fault.option}" if fault.option else ""))
    path = (out or folder / REPORT).absolute()
    durable.make_folder(path.parent)
    durable.replace_file(path, report.render(solved).encode())
    screen.file("Report", path)
    prefix = f"{path.stem}." if out else ""  # reports with names of their own do not share the files beside them
    flow.show_arm(solved, path.with_name(prefix + pictures.ARM_PICTURE), screen)
    table = path.with_name(prefix + RESIDUALS)
    durable.replace_file(table, checks.residuals_table(solved.residuals).encode())
    left_mm = [view.rms_mm for view in solved.residuals if view.used]
    screen.plain(f"Residual of every point: {table} (on the target {np.median(left_mm):.2f} mm in the middle view)")
    influence = solved.influence
    data = terminal_views.summary(solved.record) | {
        "residuals": str(table),
        "report": str(path),
        "recognised": solved.recognised,
        "advice": solved.advice,
        "views_that_help": dict(influence.without),
        "three_more": {"like": influence.more, "error_left": influence.left, "to_halve": influence.to_halve},
        "faults": [{"kind": f.kind, "what": f.sentence, "option": f.option, "views": f.views} for f in solved.faults],
    }
    if not solved.record.accepted:
        return Reply(data, failure=flow.rejected(solved, path, f"Next: {solved.advice}"))
    return Reply(data, next=[(f"xdg-open {path}", "the place and the residual of every view")])


def overlay(folder: Path, out: Path | None, screen: Screen) -> Reply:
    """Draw the arm into every picture of a folder. Raises ViewFolderError, CalibrationError, PerceptionError."""
    with screen.busy("Finding the board, solving and drawing"):
        solved = solve_folder(folder.absolute())
        drawn = pictures.draw_arm(solved)
    into = (out or folder / OVERLAY).absolute()
    durable.make_folder(into)
    for name, picture in drawn.by_view.items():
        durable.replace_file(into / f"{name}.jpg", pictures.jpeg(picture))
    sheet = into / pictures.ARM_PICTURE
    durable.replace_file(sheet, drawn.sheet())
    screen.file("Look whether the lines lie on the edges of the arm", sheet)
    screen.show(Text(drawn.sentence, style="bold" if drawn.fit is None or drawn.fits else "bold red"))
    files = {name: str(into / f"{name}.jpg") for name in drawn.by_view}
    data = {"outline": drawn.as_json(), "sheet": str(sheet), "pictures": files}
    return Reply(data, next=[(f"xdg-open {sheet}", "the pictures, side by side")])


def solve_cameras(
    folders: Sequence[Path], out: Path, exchange: Sequence[tuple[str, str, str]], screen: Screen
) -> Reply:
    """Solve several cameras around one arm; `exchange` are folders' names with two views each.

    Raises ViewFolderError, CalibrationError, PerceptionError; a rejected result is the failure.
    """
    with screen.busy("Finding the target and solving"):
        solution = together.solve([folder.absolute() for folder in folders], exchange)
    path = out.absolute()
    durable.make_folder(path.parent)
    durable.replace_file(path, together.content(solution))
    screen.print([together.show(solution), FileLine("Written", path)])
    data = together.as_json(solution) | {"file": str(path)}
    if not solution.accepted:
        return Reply(data, failure=together.rejected(solution, path))
    alone = (f"adaptsim calibrate solve {folders[0]}", "one camera alone, with every check and a report")
    return Reply(data, next=[alone])


def board(
    resolved: Resolved,
    out: Path,
    paper: str,
    square_mm: float | None,
    width_mm: float | None,
    screen: Screen,
) -> Reply:
    """Write the page, and remember it with its measured width. Raises UsageError, SessionError."""
    if out.suffix not in printing.FORMATS:
        raise UsageError(f"--out {out}: the name ends in one of {', '.join(printing.FORMATS)}")
    printed = printing.fitting(paper, square_mm)
    path = out.absolute()
    durable.make_folder(path.parent)
    with screen.busy("Drawing the board"):
        durable.replace_file(path, printing.page(printed, paper, out.suffix))
    screen.file("Written", path)
    record = printing.remember(resolved.places.data, printed, width_mm)
    if width_mm is None:
        screen.note(
            "Print at 100 %, glue it to something stiff and flat, measure all squares of a row together, and run this "
            "again with --width-mm (adaptsim calibrate asks for it too)."
        )
    measured = f"adaptsim calibrate board --paper {paper} --out {out} --width-mm WIDTH"
    step = (measured, "with the width that you measured") if width_mm is None else ("adaptsim calibrate", "with it")
    return Reply({"file": str(path), "paper": paper, **record.model_dump()}, next=[step])


def board_in_use(resolved: Resolved, screen: Screen, *, yes: bool) -> Board:
    """The board in use, with its measured size; asks for the size if a person is there."""
    record = printing.stored_board(resolved.places.data)
    if record is None:
        if not resolved.config.is_simulated:
            raise UsageError("no board is known yet. Print one: adaptsim calibrate board")
        return Board()
    if record.measured or yes:
        return record.board.board()
    across = record.board.squares_across
    planned_mm = across * record.nominal_square_mm
    width_mm = screen.length(
        f"How wide are all {across} squares of a row together on the print, in mm? (Enter: {planned_mm:g}, as planned; "
        "q stops):",
        planned_mm,
    )
    return printing.remember(resolved.places.data, record.board.board(), width_mm).board.board()


def _guided(rig: CalibrationRig, screen: Screen) -> CalibrationRig:
    """The rig while a person guides its arm, which may end the connection."""
    return replace(rig, arm=GuidedArm(rig.arm, screen, "Every view and touch so far is kept."))


def _mover(rig: CalibrationRig, screen: Screen, places: int | None, *, yes: bool) -> BoardMover:
    """The arm's visits to the places; None if a person guides it."""
    if places is None:
        return HandGuided(screen)
    with screen.busy("Choosing where to hold the board"):
        return Automatic(rig, screen, plan(rig, places), rig.arm.state().q_rad, yes)


def _unattended(resolved: Resolved, *, yes: bool, guide: bool) -> bool:
    """Whether nobody answers questions. Raises UsageError if somebody must and there is no terminal."""
    unattended = resolved.config.unattended(yes) and not guide
    if not unattended:
        console.require_terminal()
    return unattended


def _continued(command: str) -> AbstractContextManager[None]:
    return how_to_continue(f"Every view so far is stored. Continue with: {command}", "interrupted")
