"""`adaptsim run-iteration`: trials, tracking, adaptation, next policies."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli import options


def run_iteration(
    task: options.Task = None,
    iterations: Annotated[
        int | None, typer.Option("--iterations", "-n", min=1, help="How many iterations to run.", show_default="1")
    ] = None,
    until_done: Annotated[
        bool, typer.Option("--until-done", help="Go on until the verdict says stop, --iterations at most.")
    ] = False,
    world: options.World = None,
    seed: options.Seed = None,
    session: Annotated[
        str | None,
        typer.Option("--session", autocompletion=options.session_names, help="Which session to begin or continue."),
    ] = None,
    recorded: options.Recorded = None,
    held_out: options.HeldOut = None,
    start_from: Annotated[
        str | None,
        typer.Option(
            "--start-from", autocompletion=options.session_names, help="Begin with the posterior of this session."
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option("--method", show_default="adaptsim", help="How to adapt, e.g. adaptsim, udr or random."),
    ] = None,
    control: Annotated[
        str | None,
        typer.Option("--control", help="Add blind control trials by a method's first policies, or a session's best."),
    ] = None,
    solver: options.Solver = None,
    own: options.Object = None,
    hw: options.Hw = None,
    answer_with: options.AnswerWith = None,
    answer_moves: options.AnswerMoves = None,
    yes: options.Yes = False,
    own_calibration: Annotated[
        bool,
        typer.Option(
            "--own-calibration",
            rich_help_panel=options.ADVANCED,
            help="Go on with the calibration and touch-off of the session.",
        ),
    ] = False,
    realtime: options.Realtime = False,
    pace: options.Pace = None,
    operator: options.Operator = None,
    view: options.View = False,
    view_port: options.ViewPort = None,
    as_json: options.Json = False,
) -> None:
    """Run the trials of one iteration, adapt the simulation parameters and train the next task policies.

    Continues where the session stopped. Without --session, its name follows from task, world, method and seed; with
    none of these it is the newest session. Only --task begins a new one. With --until-done it ends where the
    verdict says stop, after --iterations at most; without it, a terminal asks there.

    With --control udr each trial from the second iteration on has a partner in the same place, in random order, by a
    policy that does not adapt; the result says whether adapting helps here.

    Example: adaptsim run-iteration --task scooping --world oreo --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.session import running
    from adaptsim_cli.wiring import session as wiring
    from adaptsim_cli.wiring import settings
    from adaptsim_cli.wiring.first_look import with_first_look
    from adaptsim_cli.wiring.hindsight import Reports

    flags = {"task": task, "world": world, "seed": seed, "method": method, "hw": hw, "solver": solver, "object": own}
    options = {"recorded": recorded, "held_out": held_out, "start_from": start_from, "control": control}
    options |= {"answer_with": answer_with, "answer_moves": answer_moves}
    options |= {"realtime": realtime or None, "pace": pace, "operator": operator}
    resolved = settings.load({**flags, **options})
    flag_keys = frozenset(key for key, source in resolved.sources.items() if source.startswith(("flag", "world ")))
    most = iterations or (None if until_done else 1)
    request = running.SessionRequest(session, flag_keys, most, yes, until_done)
    looking_on = wiring.beside(view_port) if view or view_port is not None else running.terminal_alone
    begun = running.facts_of(resolved, request) if own_calibration else None
    screen = Screen(as_json=as_json)
    prompt_screen = None if resolved.config.unattended(yes) else screen
    opener = partial(wiring.open_parts, own=begun, screen=prompt_screen)
    reports = Reports()
    view_of_session = with_first_look(looking_on)
    running.run_session(resolved, request, opener, reports.draw, screen, view_of_session, reports.ending)
