"""`adaptsim run-iteration`: trials, tracking, adaptation, next policies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.session.target import Openers


@command(
    *("task", "world", "seed", "method", "control", "pairs", "object", "start_from", "recorded", "held_out", "solver"),
    *("hw", "answer_with", "answer_moves", "realtime", "pace", "operator"),
)
def run_iteration(
    screen: Screen,
    resolved: Resolved,
    openers: Openers,
    iterations: Annotated[
        int | None, typer.Option("--iterations", "-n", min=1, help="Number of iterations to run.", show_default="1")
    ] = None,
    until_done: Annotated[
        bool, typer.Option("--until-done", help="Go on until the verdict says stop, --iterations at most.")
    ] = False,
    session: Annotated[
        str | None,
        typer.Option("--session", autocompletion=options.session_names, help="Which session to begin or continue."),
    ] = None,
    yes: options.Yes = False,
    own_calibration: Annotated[
        bool,
        options.advanced("--own-calibration", "Go on with the calibration and touch-off of the session."),
    ] = False,
    view: options.View = False,
    view_port: options.ViewPort = None,
    log: Annotated[
        list[str] | None,
        typer.Option("--log", help="Keep the session in a logger too: tensorboard, wandb, mlflow; may be repeated."),
    ] = None,
) -> Reply:
    """Run the trials of one iteration, adapt the simulation parameters and train the next task policies.

    Continues where the session stopped. Without --session, its name follows from task, world, method and seed; with
    none of these it is the newest session. Only --task begins a new one. With --until-done it ends where the
    verdict says stop, after --iterations at most; without it, a terminal asks there.

    With --control udr each trial from the second iteration on has a partner in the same place, in random order, by a
    policy that does not adapt; the result says whether adapting helps here. --pairs states how many pairs you plan.

    Example: adaptsim run-iteration --task scooping --world oreo --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.commands import settings
    from adaptsim_cli.session import running
    from adaptsim_cli.show.first_look import with_first_look
    from adaptsim_cli.show.live import live_page
    from adaptsim_cli.show.reports import Reports

    most = iterations or (None if until_done else 1)
    request = running.SessionRequest(session, settings.named_by_flags(resolved), most, yes, until_done)
    looking_on = live_page(view_port) if view or view_port is not None else running.terminal_alone
    begun = running.facts_of(resolved, request) if own_calibration else None
    opener = partial(openers.parts, own=begun, screen=None if resolved.config.unattended(yes) else screen)
    reports = Reports()
    view_of_session = with_first_look(looking_on)
    if log:
        from adaptsim_cli.show.loggers.feed import with_loggers

        view_of_session = with_loggers(log, resolved.places.logs, view_of_session)
    return running.run_session(resolved, request, opener, reports.draw, screen, view_of_session, reports.ending)
