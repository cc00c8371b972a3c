"""`adaptsim touch-off`, `touch-off list`, `touch-off restore`, `touch-off compare`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.commands.measurements import RIG, MeasurementKind, add_to
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.bench.touch_off.store import TouchOffStore
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen

app = typer.Typer()


@app.callback(invoke_without_command=True)
@command(*RIG, "realtime", "pace", "operator")
def touch_off(
    screen: Screen,
    resolved: Resolved,
    guide: Annotated[
        bool, typer.Option("--guide", help="Set the tool down by hand at seven places; nothing moves by itself.")
    ] = False,
    automatic: Annotated[
        bool,
        typer.Option(
            "--automatic", help="Let a real arm feel for the table by itself, which nobody has seen on one yet."
        ),
    ] = False,
    grasp_force_N: Annotated[
        float, typer.Option("--grasp-force", min=5.0, max=70.0, help="Grasp force of the hand, N.")
    ] = 40.0,
    handle_mm: Annotated[
        float | None,
        typer.Option(
            "--handle-mm",
            min=2.0,
            max=70.0,
            help="Width between the fingers, mm; default: that of the printed adapter.",
        ),
    ] = None,
    yes: options.Yes = False,
) -> Reply:
    """Find the table's height and the tool's pose in the hand by touching. Do this before the first scoop.

    With --guide you set the tool down by hand. Without it the arm feels for the table by itself, slowly; on a real arm
    only with --automatic. Planning uses the result from then on. Nothing is stored unless all touches agree.

    Example: adaptsim touch-off --task scooping --world steep-mount --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.bench import rig_frames
    from adaptsim_cli.bench import touch_off_in_use as wiring
    from adaptsim_cli.bench.touch_off import flow, guiding
    from adaptsim_cli.errors import UsageError

    store, sessions = _store(resolved), rig_frames.open_sessions(resolved.config, resolved.places)
    if guide:
        if automatic:
            raise UsageError("--guide and --automatic exclude each other: leave one out")
        open_guided = partial(wiring.open_guided_rig, screen=screen)
        return guiding.run(resolved, store, sessions, open_guided, screen, yes=yes)
    if not (automatic or resolved.config.is_simulated or yes):
        raise UsageError(flow.UNSEEN)
    grasp = wiring.grasp_of(resolved.config, handle_mm, grasp_force_N)
    open_rig = partial(wiring.open_touch_rig, screen=None if resolved.config.unattended(yes) else screen)
    return flow.run(resolved, grasp, store, sessions, open_rig, screen, yes=yes)


def _store(resolved: Resolved) -> TouchOffStore:
    from adaptsim_cli.bench import touch_off_in_use as wiring

    return wiring.touch_offs(resolved.config, resolved.places)


def _views() -> Any:
    from adaptsim_cli.bench.touch_off import terminal_views

    return terminal_views


_THEN = ("adaptsim rollout", "one trial with it")
add_to(app, MeasurementKind("touch-off", "touch-off", "--task scooping --hw fr3", _THEN, _store, _views))
