"""`adaptsim calibrate`, and its `board`, `check`, `solve`, `together` and `overlay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer()

_Task = Annotated[str | None, typer.Option("--task", help="Which task the world of the simulated lab is for.")]
_World = Annotated[str | None, typer.Option("--world", help="World of the simulated lab: name or TOML file.")]
_Seed = Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")]
_Hw = Annotated[str | None, typer.Option("--hw", help="Which hardware: fake, panda or fr3.")]
_Yes = Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; refused for a real arm.")]
_Realtime = Annotated[bool, typer.Option("--realtime", help="Simulated lab: at the arm's own pace, to watch.")]
_Pace = Annotated[
    float | None, typer.Option("--pace", help="Speed of every motion, 0.1 to 1, to watch a new rig first.")
]
_Operator = Annotated[str | None, typer.Option("--operator", help="Your name, for the record of a real arm.")]
_Json = Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")]
_Guide = Annotated[bool, typer.Option("--guide", help="Guide the arm by hand; no motion is planned.")]


@app.callback(invoke_without_command=True)
def calibrate(
    context: typer.Context,
    task: _Task = None,
    world: _World = None,
    seed: _Seed = None,
    hw: _Hw = None,
    guide: _Guide = False,
    views: Annotated[int, typer.Option("--views", min=12, max=100, help="How many places the arm visits.")] = 25,
    fresh: Annotated[bool, typer.Option("--fresh", help="Start again without the stored views.")] = False,
    yes: _Yes = False,
    realtime: _Realtime = False,
    pace: _Pace = None,
    operator: _Operator = None,
    as_json: _Json = False,
) -> None:
    """Find the camera's pose: the arm shows the camera a board from many sides. Takes about ten minutes.

    A stopped run continues with its stored views. A result that fails a check is not used.

    Example: adaptsim calibrate --hw fake --world ood-1 --seed 0 --yes
    """
    if context.invoked_subcommand is not None:
        return
    from functools import partial

    from adaptsim_cli.calibration import running
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.wiring import calibration as wiring
    from adaptsim_cli.wiring import rig_frames, settings

    flags = {"task": task, "world": world, "seed": seed, "hw": hw, "realtime": realtime or None}
    resolved, screen = settings.load({**flags, "pace": pace, "operator": operator}), Screen(as_json=as_json)
    request = running.CalibrationRequest(guide=guide, views=views, fresh=fresh, yes=yes, as_json=as_json)
    open_rig = partial(wiring.open_calibration_rig, screen=screen)
    running.calibrate(resolved, request, open_rig, wiring.calibrations, rig_frames.open_sessions, screen)


@app.command()
def board(
    out: Annotated[Path, typer.Option("--out", help="File to write: .pdf or .png.")] = Path("board.pdf"),
    paper: Annotated[str, typer.Option("--paper", help="a4, a3 or letter.")] = "a4",
    square_mm: Annotated[
        float | None, typer.Option("--square-mm", help="Edge of a square; default: the largest that fits.")
    ] = None,
    width_mm: Annotated[
        float | None, typer.Option("--width-mm", help="Measured width of all squares of a row together.")
    ] = None,
    as_json: _Json = False,
) -> None:
    """Write the calibration board at true scale, and store the size that you measured on the print.

    Run it again with --width-mm once it is printed and measured.

    Example: adaptsim calibrate board --paper a4 --out board.pdf
    """
    from adaptsim_cli import config
    from adaptsim_cli.calibration import running
    from adaptsim_cli.screen.console import Screen

    running.board(config.load({}), out, paper, square_mm, width_mm, Screen(as_json=as_json), as_json=as_json)


@app.command()
def check(
    task: _Task = None,
    world: _World = None,
    seed: _Seed = None,
    hw: _Hw = None,
    guide: _Guide = False,
    yes: _Yes = False,
    pace: _Pace = None,
    operator: _Operator = None,
    as_json: _Json = False,
) -> None:
    """Has the camera moved since it was calibrated, and by how much? Three places, one minute.

    Example: adaptsim calibrate check --hw fake --world ood-1 --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.calibration import running
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.wiring import calibration as wiring
    from adaptsim_cli.wiring import settings

    flags = {"task": task, "world": world, "seed": seed, "hw": hw}
    resolved, screen = settings.load({**flags, "pace": pace, "operator": operator}), Screen(as_json=as_json)
    request = running.CalibrationRequest(guide=guide, views=running.CHECK_PLACES, fresh=True, yes=yes, as_json=as_json)
    running.check(resolved, request, partial(wiring.open_calibration_rig, screen=screen), wiring.calibrations, screen)


@app.command()
def solve(
    folder: Annotated[Path, typer.Argument(help="Folder of views; docs/guide/calibrate.md describes its files.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Where to write the report; default: in the folder.")
    ] = None,
    refine_intrinsics: Annotated[
        bool,
        typer.Option(
            "--refine-intrinsics", help="Use the focal length, centre and distortion estimated from the views."
        ),
    ] = False,
    exchange: Annotated[
        list[str] | None, typer.Option("--exchange", help="Two views with exchanged poses, as 25:26; repeatable.")
    ] = None,
    shift: Annotated[
        int, typer.Option("--shift", min=-5, max=5, help="Each picture belongs to the pose this many views later.")
    ] = 0,
    first: Annotated[str, typer.Option("--from", help="Leave out the views before this one.")] = "",
    last: Annotated[str, typer.Option("--until", help="Leave out the views after this one.")] = "",
    as_json: _Json = False,
) -> None:
    """Solve from views recorded elsewhere, on any robot, with the same checks and report.

    Example: adaptsim calibrate solve my-views --json
    """
    from adaptsim_cli.calibration import running
    from adaptsim_cli.calibration.solving import Wishes
    from adaptsim_cli.errors import UsageError

    pairs = tuple(tuple(pair.split(":")) for pair in exchange or ())
    if any(len(pair) != 2 for pair in pairs):
        raise UsageError("--exchange takes two names of views with a colon between them, as 25:26")
    wishes = Wishes(refine_intrinsics, tuple((a, b) for a, b in pairs), shift, first, last)
    running.solve(folder, out, wishes, as_json=as_json)


@app.command()
def together(
    folders: Annotated[list[Path], typer.Argument(help="Folders of views, one a camera; docs/guide/foreign-views.md.")],
    out: Annotated[Path, typer.Option("--out", help="File to write.")] = Path("together.json"),
    exchange: Annotated[
        list[str] | None,
        typer.Option(
            "--exchange", help="A folder and two of its views with exchanged poses, as cam:25:26; repeatable."
        ),
    ] = None,
    as_json: _Json = False,
) -> None:
    """Solve several fixed cameras that saw the same target on the same arm: better than each alone.

    Judged by the gates of one camera; a result that fails is written, and the command ends with an error.

    Views with the same name must show the same posture of the arm.

    Example: adaptsim calibrate together camera-0 camera-1 camera-2
    """
    from adaptsim_cli.calibration import running
    from adaptsim_cli.errors import UsageError

    named = [tuple(one.rsplit(":", 2)) for one in exchange or ()]
    if any(len(one) != 3 for one in named):
        raise UsageError("--exchange takes a folder's name and two of its views with colons between, as cam:25:26")
    running.solve_cameras(folders, out, [(a, b, c) for a, b, c in named], as_json=as_json)


@app.command()
def overlay(
    folder: Annotated[Path, typer.Argument(help="Folder of views; docs/guide/calibrate.md describes its files.")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the pictures; default: `overlay` in the folder of views.")
    ] = None,
    as_json: _Json = False,
) -> None:
    """Draw the arm into the pictures of a solved folder: its lines must lie on the edges of the real hand.

    Also measures how far the hand's outline lies off what moves in the pictures.

    Example: adaptsim calibrate overlay my-views
    """
    from adaptsim_cli.calibration import running

    running.overlay(folder, out, as_json=as_json)


_Calibration = Annotated[str, typer.Argument(help="Name or number, as `calibrate list` shows it.")]


@app.command("list")
def list_calibrations(
    task: _Task = None, world: _World = None, seed: _Seed = None, hw: _Hw = None, as_json: _Json = False
) -> None:
    """List the calibrations of a rig or world, oldest first, and the sessions that rest on the one in use.

    Example: adaptsim calibrate list --hw fr3
    """
    from adaptsim_cli.calibration import kept
    from adaptsim_cli.screen import console
    from adaptsim_cli.wiring import calibration as wiring
    from adaptsim_cli.wiring import rig_frames, settings

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.calibrations(resolved.config, resolved.places)
    screen, found = console.Screen(as_json=as_json), kept.listed(store)
    resting = rig_frames.open_sessions(resolved.config, resolved.places)
    if as_json:
        screen.data("calibrate list", {"rig": store.folder.name, "calibrations": found, "open_sessions": list(resting)})
        return
    kept.tell(screen, store, found, resting)


@app.command("show")
def show_calibration(
    name: _Calibration,
    task: _Task = None,
    world: _World = None,
    seed: _Seed = None,
    hw: _Hw = None,
    as_json: _Json = False,
) -> None:
    """Show one calibration with every check, and where its report lies.

    Example: adaptsim calibrate show calibration-0001 --hw fr3
    """
    from adaptsim_cli.calibration import running, terminal_views
    from adaptsim_cli.calibration.store import REPORT
    from adaptsim_cli.screen import console
    from adaptsim_cli.wiring import calibration as wiring
    from adaptsim_cli.wiring import settings

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.calibrations(resolved.config, resolved.places)
    path, screen = store.numbered.named(name), console.Screen(as_json=as_json)
    known = store.read(path)
    if as_json:
        screen.data("calibrate show", running.summary(known) | {"folder": str(path)})
        return
    screen.show(terminal_views.calibration(known))
    screen.plain(f"Report: {path / REPORT}")
    screen.next((f"adaptsim calibrate restore {path.name} {resolved.config.same_lab}", "puts it in use again"))


@app.command("restore")
def restore_calibration(
    name: _Calibration,
    task: _Task = None,
    world: _World = None,
    seed: _Seed = None,
    hw: _Hw = None,
    as_json: _Json = False,
) -> None:
    """Put an earlier calibration in use again, as a copy with the next number. Nothing is deleted.

    Names the open sessions that rest on the one in use until now.

    Example: adaptsim calibrate restore calibration-0001 --hw fr3
    """
    from datetime import UTC, datetime

    from adaptsim_cli.screen import console, resting
    from adaptsim_cli.wiring import calibration as wiring
    from adaptsim_cli.wiring import rig_frames, settings

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.calibrations(resolved.config, resolved.places)
    screen = console.Screen(as_json=as_json)
    store.numbered.named(name)
    resting.tell_resting(screen, "the calibration in use", rig_frames.open_sessions(resolved.config, resolved.places))
    with store.locked():
        path = store.numbered.restore(name, datetime.now(UTC).isoformat(timespec="seconds"))
    if as_json:
        source = store.numbered.named(name).name
        screen.data("calibrate restore", {"in_use": path.name, "restored_from": source, "folder": str(path)})
        return
    screen.plain(f"In use from now on: {path}")
    screen.next((f"adaptsim calibrate check {resolved.config.same_lab}", "has the camera moved?"))


@app.command("compare")
def compare_calibrations(
    first: _Calibration,
    second: _Calibration,
    task: _Task = None,
    world: _World = None,
    seed: _Seed = None,
    hw: _Hw = None,
    as_json: _Json = False,
) -> None:
    """Say how far the camera's poses of two calibrations lie apart, beside how well both are known.

    Example: adaptsim calibrate compare 1 2 --hw fr3
    """
    from adaptsim_cli.calibration import kept
    from adaptsim_cli.screen import console
    from adaptsim_cli.wiring import calibration as wiring
    from adaptsim_cli.wiring import settings

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw})
    store = wiring.calibrations(resolved.config, resolved.places)
    screen, found = console.Screen(as_json=as_json), kept.compared(store, first, second)
    if as_json:
        screen.data("calibrate compare", found)
        return
    screen.show(kept.sentence(found))
    again = f"adaptsim calibrate restore {found['first']} {resolved.config.same_lab}"
    screen.next((again, "puts the first in use again"))
