"""From the command line to a running calibration, and from its result to the screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from rich.text import Text

from adaptsim_cli.calibration import arm_picture, drift, flow, printing, terminal_views, together
from adaptsim_cli.calibration import page as report
from adaptsim_cli.calibration.parts import CalibrationRig
from adaptsim_cli.calibration.solving import Solved, Wishes, solve_folder
from adaptsim_cli.calibration.store import REPORT, CalibrationStore
from adaptsim_cli.calibration.visits import Automatic, HandGuided, Visits, plan
from adaptsim_cli.config import Config, Places, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import console, views
from adaptsim_cli.screen.console import Screen, how_to_continue
from adaptsim_cli.storage import durable
from adaptsim_cli.storage.durable import versions
from calib import residuals
from calib.errors import CalibrationMissing
from calib.saved import SavedCalibration
from perception.board.types import Board

OpenRig = Callable[[Config, Board, SavedCalibration | None], AbstractContextManager[CalibrationRig]]
"""(settings, the board in the gripper, an earlier calibration) -> the devices, connected."""

Stores = Callable[[Config, Places], CalibrationStore]
"""(settings) -> the calibrations of the rig."""

RESIDUALS, OVERLAY = "residuals.csv", "overlay"
Ends = Callable[[Config, Places], Sequence[str]]
"""Settings -> the open sessions that use the present calibration and touch-off."""

CHECK_PLACES = 6
"""Places planned for a check, which ends with the third view of the board."""


@dataclass(frozen=True)
class CalibrationRequest:
    """The operator's options on the command line."""

    guide: bool
    views: int
    fresh: bool
    yes: bool
    as_json: bool


def nothing_ends(config: Config, places: Places) -> tuple[str, ...]:
    """`Ends` without sessions."""
    return ()


def calibrate(
    resolved: Resolved,
    request: CalibrationRequest,
    open_rig: OpenRig,
    stores: Stores,
    ends: Ends = nothing_ends,
    screen: Screen | None = None,
) -> None:
    """The whole calibration. Raises the error that stops it, with the command to continue."""
    config, screen = resolved.config, screen or Screen(as_json=request.as_json)
    _need_terminal(resolved, request)
    store = stores(config, resolved.places)
    screen.resting("the calibration in use", ends(config, resolved.places))
    board = board_in_use(resolved, screen, yes=request.yes)
    with (
        store.locked(),
        _continued("adaptsim calibrate"),
        open_rig(config, board, store.current()) as rig,
    ):
        with screen.busy("Choosing where to hold the board"):
            visits = _visits(rig, screen, request)
        screen.show(terminal_views.explanation(rig, None if request.guide else request.views))
        options = flow.Options(request.fresh, _unattended(resolved, request), _now(), versions())
        solved, folder = flow.calibrate(rig, store, visits, screen, options)
    screen.next(*_after(config))
    if request.as_json:
        screen.data("calibrate", summary(solved.record) | {"folder": str(folder)})


def check(
    resolved: Resolved, request: CalibrationRequest, open_rig: OpenRig, stores: Stores, screen: Screen | None = None
) -> None:
    """Compare three views with the calibration in use. Raises CalibrationMissing without a calibration."""
    config, screen = resolved.config, screen or Screen(as_json=request.as_json)
    _need_terminal(resolved, request)
    store = stores(config, resolved.places)
    known = store.current()
    if known is None:
        raise CalibrationMissing("there is no calibration of this rig to check; make one: adaptsim calibrate")
    board = known.board.board()
    if not isinstance(board, Board):
        raise UsageError(
            f"this rig was calibrated with a {board.name}; a check needs adaptsim's own board: adaptsim calibrate"
        )
    with (
        store.locked(),
        _continued("adaptsim calibrate check"),
        open_rig(config, board, known) as rig,
    ):
        screen.show(views.badge(rig.name, rig.title))
        with screen.busy("Choosing where to hold the board"):
            visits = _visits(rig, screen, request)
        found = drift.check(rig, known, visits, screen)
    screen.show(Text(found.message, style="bold red" if found.moved else "green"))
    where = config.same_lab
    again = (f"adaptsim calibrate {where}", "finds the camera's new pose")
    screen.next(again if found.moved else (f"adaptsim run-iteration {where}", "the calibration is still valid"))
    if request.as_json:
        screen.data("calibrate check", drift.as_json(found))


def solve(folder: Path, out: Path | None, wishes: Wishes, *, as_json: bool) -> None:
    """Solve views recorded elsewhere. Raises ViewFolderError, CalibrationError, PerceptionError."""
    screen = Screen(as_json=as_json)
    with screen.busy("Finding the board and solving"):
        solved = solve_folder(folder.absolute(), hw="recorded", created=_now(), versions=versions(), wishes=wishes)
    for sentence in solved.recognised:
        screen.note(f"  {sentence}")
    for sentence in solved.not_seen:
        screen.note(f"  not used: {sentence}")
    screen.show(terminal_views.calibration(solved.record))
    for sentence in solved.worth.sentences:
        screen.plain(f"  {sentence}")
    for fault in solved.faults:
        screen.note(f"  {fault.sentence}" + (f". To use them so: {fault.option}" if fault.option else ""))
    path = (out or folder / REPORT).absolute()
    durable.make_folder(path.parent)
    durable.replace_file(path, report.render(solved).encode())
    screen.plain(f"Report: {path}")
    beside = path.stem if out else ""
    flow.show_arm(solved, path.with_name(_named(beside, arm_picture.PICTURE)), screen)
    table = path.with_name(_named(beside, RESIDUALS))
    durable.replace_file(table, residuals.table(solved.residuals).encode())
    if solved.record.accepted:
        screen.next((f"xdg-open {path}", "the place and the residual of every view"))
    left_mm = [view.rms_mm for view in solved.residuals if view.used]
    screen.plain(f"Residual of every point: {table} (on the target {np.median(left_mm):.2f} mm in the middle view)")
    if as_json:
        screen.data(
            "calibrate solve",
            summary(solved.record)
            | {"residuals": str(table), "report": str(path), "recognised": solved.recognised, "advice": solved.advice}
            | _told(solved),
        )
    if not solved.record.accepted:
        raise flow.rejected(solved, path, f"Next: {solved.advice}")


def _named(report: str, name: str) -> str:
    """The name of a file beside a report with a name of its own."""
    return f"{report}.{name}" if report else name


def overlay(folder: Path, out: Path | None, *, as_json: bool) -> None:
    """Draw the arm into every picture of a folder. Raises ViewFolderError, CalibrationError, PerceptionError."""
    screen = Screen(as_json=as_json)
    with screen.busy("Finding the board, solving and drawing"):
        solved = solve_folder(folder.absolute(), hw="recorded", created=_now(), versions=versions())
        drawn = arm_picture.draw(solved)
    into = (out or folder / OVERLAY).absolute()
    durable.make_folder(into)
    for name, picture in drawn.by_view.items():
        durable.replace_file(into / f"{name}.jpg", arm_picture.jpeg(picture))
    sheet = into / arm_picture.PICTURE
    durable.replace_file(sheet, drawn.sheet())
    screen.plain(f"Look at {sheet}: the lines must lie on the edges of the arm")
    screen.show(Text(drawn.sentence, style="bold" if drawn.fit is None or drawn.fits else "bold red"))
    screen.next((f"xdg-open {sheet}", "the pictures, side by side"))
    if as_json:
        files = {name: str(into / f"{name}.jpg") for name in drawn.by_view}
        screen.data("calibrate overlay", {"outline": drawn.as_json(), "sheet": str(sheet), "pictures": files})


def solve_cameras(
    folders: Sequence[Path], out: Path, exchange: Sequence[tuple[str, str, str]] = (), *, as_json: bool
) -> None:
    """Solve several cameras around one arm; `exchange` are folders' names with two views each.

    Raises ViewFolderError, CalibrationError, PerceptionError.
    """
    screen = Screen(as_json=as_json)
    with screen.busy("Finding the target and solving"):
        found = together.solve([folder.absolute() for folder in folders], exchange)
    screen.show(together.show(found))
    path = out.absolute()
    durable.make_folder(path.parent)
    durable.replace_file(path, together.content(found))
    screen.plain(f"Written: {path}")
    if found.accepted:
        screen.next((f"adaptsim calibrate solve {folders[0]}", "one camera alone, with every check and a report"))
    if as_json:
        screen.data("calibrate together", together.as_json(found) | {"file": str(path)})
    if not found.accepted:
        raise together.rejected(found, path)


def _told(solved: Solved) -> dict[str, Any]:
    worth = solved.worth
    return {
        "views_that_help": dict(worth.without),
        "three_more": {"like": worth.more, "error_left": worth.left, "to_halve": worth.to_halve},
        "faults": [{"kind": f.kind, "what": f.sentence, "option": f.option, "views": f.views} for f in solved.faults],
    }


def board(
    resolved: Resolved,
    out: Path,
    paper: str,
    square_mm: float | None,
    width_mm: float | None,
    screen: Screen,
) -> None:
    """Write the page, and remember it with its measured width. Raises UsageError, SessionError."""
    if out.suffix not in printing.FORMATS:
        raise UsageError(f"--out {out}: the name ends in one of {', '.join(printing.FORMATS)}")
    printed = printing.fitting(paper, square_mm)
    path = out.absolute()
    durable.make_folder(path.parent)
    with screen.busy("Drawing the board"):
        durable.replace_file(path, printing.page(printed, paper, out.suffix))
    screen.plain(f"Written: {path}")
    kept = printing.remember(resolved.places.data, printed, width_mm)
    if width_mm is None:
        screen.note(
            "Print at 100 %, glue it to something stiff and flat, measure all squares of a row together, and run this "
            "again with --width-mm (adaptsim calibrate asks for it too)."
        )
    measured = f"adaptsim calibrate board --paper {paper} --out {out} --width-mm WIDTH"
    step = (measured, "with the width that you measured") if width_mm is None else ("adaptsim calibrate", "with it")
    screen.next(step)
    screen.data("calibrate board", {"file": str(path), "paper": paper, **kept.model_dump()})


def summary(record: SavedCalibration) -> dict[str, Any]:
    """A calibration for JSON."""
    u = record.uncertainty
    return {
        "accepted": record.accepted,
        ("X_BC" if record.mounting == "fixed" else "X_FC"): record.X_AC,
        "sigma_mm": u.sigma_mm,
        "sigma_deg": u.sigma_deg,
        "worst_95_mm": u.worst_95_mm,
        "fit_px": record.fit_px,
        "held_out_px": record.held_out_px,
        "views_used": [view.name for view in record.views if view.used],
        "views_rejected": {view.name: view.reason for view in record.views if not view.used},
        "joint_offsets_mrad": [1e3 * float(q) for q in record.offsets_rad()],
        "target": record.board.board().name,
        "refined_intrinsics": None if record.refined_intrinsics is None else record.refined_intrinsics.model_dump(),
        "temperatures_C": record.temperatures_C,
        "uncertainty": u.model_dump(),
        "checks": [c.model_dump() for c in record.checks],
        "gates": [c.model_dump() for c in record.gates],
        "sha256": record.sha256(),
    }


def _after(config: Config) -> tuple[tuple[str, str], ...]:
    where = config.same_lab
    return (
        (f"adaptsim touch-off {where}", "finds table and tool, if the tool of the task touches the table"),
        (f"adaptsim run-iteration {where}", "the first trials with this calibration"),
    )


def board_in_use(resolved: Resolved, screen: Screen, *, yes: bool) -> Board:
    """The board in use, with its measured size; asks for the size if a person is there."""
    known = printing.known(resolved.places.data)
    if known is None:
        if not resolved.config.is_simulated:
            raise UsageError("no board is known yet. Print one: adaptsim calibrate board")
        return Board()
    if known.measured or yes:
        return known.board.board()
    across = known.board.squares_across
    planned_mm = across * known.nominal_square_mm
    width_mm = screen.length(
        f"How wide are all {across} squares of a row together on the print, in mm? (Enter: {planned_mm:g}, as planned; "
        "q stops):",
        planned_mm,
    )
    return printing.remember(resolved.places.data, known.board.board(), width_mm).board.board()


def _visits(rig: CalibrationRig, screen: Screen, request: CalibrationRequest) -> Visits:
    if request.guide:
        return HandGuided(screen)
    home_rad = rig.arm.state().q_rad
    return Automatic(rig, screen, plan(rig, request.views), home_rad, request.yes)


def _unattended(resolved: Resolved, request: CalibrationRequest) -> bool:
    return resolved.config.unattended(request.yes) and not request.guide


def _need_terminal(resolved: Resolved, request: CalibrationRequest) -> None:
    if not _unattended(resolved, request):
        console.require_terminal()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _continued(command: str) -> AbstractContextManager[None]:
    return how_to_continue(f"Every view so far is stored. Continue with: {command}", "interrupted")
