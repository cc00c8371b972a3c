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
@command(*RIG, "operator")
def touch_off(
    screen: Screen,
    resolved: Resolved,
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
    """Measure the table and the tool's pose in the hand. Do this before the first scoop.

    You set the tool down by hand at seven places; the arm never moves by itself. A hand that does not hold the tool
    yet takes it first. Planning uses the result from then on. Nothing is stored unless all places agree.

    Example: adaptsim touch-off --task scooping --world steep-mount --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.bench import touch_off_in_use
    from adaptsim_cli.bench.touch_off import guiding
    from adaptsim_cli.session import rig_sessions

    config = resolved.config
    sessions = rig_sessions.open_sessions(config, resolved.places)
    grasp = touch_off_in_use.grasp_of(config, handle_mm, grasp_force_N)
    open_rig = partial(touch_off_in_use.open_guided_rig, screen=None if config.unattended(yes) else screen)
    return guiding.run(resolved, grasp, _store(resolved), sessions, open_rig, screen, yes=yes)


def _store(resolved: Resolved) -> TouchOffStore:
    from adaptsim_cli.bench import touch_off_in_use

    return touch_off_in_use.touch_offs(resolved.config, resolved.places)


def _views() -> Any:
    from adaptsim_cli.bench.touch_off import terminal_views

    return terminal_views


_THEN = ("adaptsim rollout", "one trial with it")
add_to(app, MeasurementKind("touch-off", "touch-off", "--task scooping --hw fr3", _THEN, _store, _views))
