"""`adaptsim calibrate`, and its `board`, `check`, `solve`, `together` and `overlay`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.commands.measurements import RIG, MeasurementKind, add_to
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.bench.calibration.store import CalibrationStore
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen

app = typer.Typer()

_Guide = Annotated[bool, typer.Option("--guide", help="Guide the arm by hand; no motion is planned.")]


@app.callback(invoke_without_command=True)
@command(*RIG, "realtime", "pace", "operator")
def calibrate(
    screen: Screen,
    resolved: Resolved,
    guide: _Guide = False,
    views: Annotated[int, typer.Option("--views", min=12, max=100, help="Number of places that the arm visits.")] = 25,
    fresh: Annotated[bool, typer.Option("--fresh", help="Start again without the stored views.")] = False,
    yes: options.Yes = False,
) -> Reply:
    """Find the camera's pose: the arm shows the camera a board from many sides. Takes about ten minutes.

    A stopped run continues with its stored views. A result that fails a check is not used.

    Example: adaptsim calibrate --hw fake --world ood-1 --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.bench import calibration_in_use
    from adaptsim_cli.bench.calibration import running
    from adaptsim_cli.session import rig_sessions

    open_rig = partial(
        calibration_in_use.open_calibration_rig, screen=None if resolved.config.unattended(yes) else screen
    )
    sessions = rig_sessions.open_sessions(resolved.config, resolved.places)
    return running.calibrate(
        resolved, _store(resolved), sessions, open_rig, screen, guide=guide, views=views, fresh=fresh, yes=yes
    )


@app.command()
@command()
def board(
    screen: Screen,
    resolved: Resolved,
    out: Annotated[Path, typer.Option("--out", help="File to write: .pdf or .png.")] = Path("board.pdf"),
    paper: Annotated[str, typer.Option("--paper", help="a4, a3 or letter.")] = "a4",
    square_mm: Annotated[
        float | None,
        options.advanced("--square-mm", "Edge of a square; default: the largest that fits."),
    ] = None,
    width_mm: Annotated[
        float | None, typer.Option("--width-mm", help="Measured width of all squares of a row together.")
    ] = None,
) -> Reply:
    """Write the calibration board at true scale, and store the size that you measured on the print.

    Run it again with --width-mm once it is printed and measured.

    Example: adaptsim calibrate board --paper a4 --out board.pdf
    """
    from adaptsim_cli.bench.calibration import running

    return running.board(resolved, out, paper, square_mm, width_mm, screen)


@app.command()
@command(*RIG, "pace", "operator")
def check(screen: Screen, resolved: Resolved, guide: _Guide = False, yes: options.Yes = False) -> Reply:
    """Has the camera moved since it was calibrated, and by how much? Three places, one minute.

    Example: adaptsim calibrate check --hw fake --world ood-1 --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.bench import calibration_in_use
    from adaptsim_cli.bench.calibration import running

    open_rig = partial(
        calibration_in_use.open_calibration_rig, screen=None if resolved.config.unattended(yes) else screen
    )
    return running.check(resolved, _store(resolved), open_rig, screen, guide=guide, yes=yes)


@app.command()
@command()
def solve(
    screen: Screen,
    folder: Annotated[Path, typer.Argument(help="Folder of views; docs/guide/foreign-views.md describes its files.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Where to write the report; default: in the folder.")
    ] = None,
    refine_intrinsics: Annotated[
        bool,
        options.advanced(
            "--refine-intrinsics", "Use the focal length, centre and distortion estimated from the views."
        ),
    ] = False,
    exchange: Annotated[
        list[str] | None,
        options.advanced("--exchange", "Two views with exchanged poses, as 25:26; may be repeated."),
    ] = None,
    shift: Annotated[
        int,
        options.advanced("--shift", "Each picture belongs to the pose this many views later.", min=-5, max=5),
    ] = 0,
    first: Annotated[str, options.advanced("--from", "Leave out the views before this one.")] = "",
    last: Annotated[str, options.advanced("--until", "Leave out the views after this one.")] = "",
) -> Reply:
    """Solve from views recorded elsewhere, on any robot, with the same checks and report.

    Example: adaptsim calibrate solve my-views --json
    """
    from adaptsim_cli.bench.calibration import running
    from adaptsim_cli.bench.calibration.solving import SolveOptions
    from adaptsim_cli.errors import UsageError

    pairs = tuple(tuple(pair.split(":")) for pair in exchange or ())
    if any(len(pair) != 2 for pair in pairs):
        raise UsageError("--exchange takes two names of views with a colon between them, as 25:26")
    chosen = SolveOptions(refine_intrinsics, tuple((a, b) for a, b in pairs), shift, first, last)
    return running.solve(folder, out, chosen, screen)


@app.command()
@command()
def together(
    screen: Screen,
    folders: Annotated[list[Path], typer.Argument(help="A folder of views per camera; docs/guide/foreign-views.md.")],
    out: Annotated[Path, typer.Option("--out", help="File to write.")] = Path("together.json"),
    exchange: Annotated[
        list[str] | None,
        options.advanced(
            "--exchange", "A folder and two of its views with exchanged poses, as cam:25:26; may be repeated."
        ),
    ] = None,
) -> Reply:
    """Solve several fixed cameras that saw the same target on the same arm: better than each alone.

    The limits are those of one camera. A result beyond a limit is written, and the command ends with an error.

    Views with the same name must show the same posture of the arm.

    Example: adaptsim calibrate together camera-0 camera-1 camera-2
    """
    from adaptsim_cli.bench.calibration import running
    from adaptsim_cli.errors import UsageError

    named = [tuple(one.rsplit(":", 2)) for one in exchange or ()]
    if any(len(one) != 3 for one in named):
        raise UsageError("--exchange takes a folder's name and two of its views with colons between, as cam:25:26")
    return running.solve_cameras(folders, out, [(a, b, c) for a, b, c in named], screen)


@app.command()
@command()
def overlay(
    screen: Screen,
    folder: Annotated[Path, typer.Argument(help="Folder of views; docs/guide/foreign-views.md describes its files.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the pictures; default: `overlay` in the folder of views.")
    ] = None,
) -> Reply:
    """Draw the arm into the pictures of a solved folder: its lines must lie on the edges of the real hand.

    Also measures the distance of the hand's outline from the moving region of the pictures.

    Example: adaptsim calibrate overlay my-views
    """
    from adaptsim_cli.bench.calibration import running

    return running.overlay(folder, out, screen)


def _store(resolved: Resolved) -> CalibrationStore:
    from adaptsim_cli.bench import calibration_in_use

    return calibration_in_use.calibrations(resolved.config, resolved.places)


def _views() -> Any:
    from adaptsim_cli.bench.calibration import terminal_views

    return terminal_views


_THEN = ("adaptsim calibrate check", "has the camera moved?")
add_to(app, MeasurementKind("calibrate", "calibration", "--hw fr3", _THEN, _store, _views))
