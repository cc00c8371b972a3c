"""`adaptsim run-iteration`: trials, tracking, adaptation, next policies."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli.commands import completing


def run_iteration(
    task: Annotated[
        str | None, typer.Option("--task", autocompletion=completing.tasks, help="Which task, e.g. scooping.")
    ] = None,
    iterations: Annotated[
        int | None, typer.Option("--iterations", "-n", min=1, help="How many iterations to run.", show_default="1")
    ] = None,
    until_done: Annotated[
        bool, typer.Option("--until-done", help="Go on until another iteration is not worth its trials.")
    ] = False,
    world: Annotated[
        str | None,
        typer.Option(
            "--world", autocompletion=completing.worlds, help="World of the simulated lab: name or TOML file."
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")] = None,
    session: Annotated[
        str | None,
        typer.Option("--session", autocompletion=completing.sessions, help="Which session to begin or continue."),
    ] = None,
    recorded: Annotated[
        str | None, typer.Option("--recorded", help="Folder of recorded trials that replace the lab.")
    ] = None,
    held_out: Annotated[
        float | None, typer.Option("--held-out", help="Share of the recorded trials that only scores, 0 to 0.9.")
    ] = None,
    start_from: Annotated[
        str | None,
        typer.Option(
            "--start-from", autocompletion=completing.sessions, help="Begin with the posterior of this session."
        ),
    ] = None,
    method: Annotated[str | None, typer.Option("--method", help="How to adapt, e.g. adaptsim, udr or random.")] = None,
    solver: Annotated[
        str | None, typer.Option("--solver", help="How task policies are found: emulator or naf.")
    ] = None,
    own: Annotated[str | None, typer.Option("--object", help="TOML file with the ranges of your own object.")] = None,
    hw: Annotated[str | None, typer.Option("--hw", help="Which hardware: fake, panda or fr3.")] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing; refused for a real arm.")] = False,
    own_calibration: Annotated[
        bool, typer.Option("--own-calibration", help="Go on with the calibration and touch-off of the session.")
    ] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Simulated lab: at the arm's own pace, to watch.")
    ] = False,
    pace: Annotated[
        float | None, typer.Option("--pace", help="Speed of every motion, 0.1 to 1; below 1 nothing counts.")
    ] = None,
    operator: Annotated[str | None, typer.Option("--operator", help="Your name, for the record of a real arm.")] = None,
    view: Annotated[bool, typer.Option("--view", help="Show camera, motion and track on a page of 127.0.0.1.")] = False,
    view_port: Annotated[
        int | None, typer.Option("--view-port", min=1024, max=65535, help="Port of that page; implies --view.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object per iteration on stdout.")] = False,
) -> None:
    """Run the trials of one iteration, adapt the simulation parameters and train the next task policies.

    Continues where the session stopped. Without --session, its name follows from task, world, method and seed; with
    none of these it is the newest session. Only --task begins a new one. With --until-done it stops when another
    iteration is not worth its trials, and runs --iterations at most.

    Example: adaptsim run-iteration --task scooping --world oreo --seed 0 --yes
    """
    from functools import partial

    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.session import running
    from adaptsim_cli.wiring import session as wiring
    from adaptsim_cli.wiring import settings
    from adaptsim_cli.wiring.hindsight import Reports

    flags = {"task": task, "world": world, "seed": seed, "method": method, "hw": hw, "solver": solver, "object": own}
    said = {"recorded": recorded, "held_out": held_out, "start_from": start_from}
    said |= {"realtime": realtime or None, "pace": pace, "operator": operator}
    resolved = settings.load({**flags, **said})
    given = frozenset(
        key for key, source in resolved.sources.items() if source == "flag" or source.startswith("world ")
    )
    most = iterations or (None if until_done else 1)
    request = running.SessionRequest(session, given, most, yes, as_json, until_done)
    looking_on = wiring.beside(view_port) if view or view_port is not None else running.terminal_alone
    begun = running.facts_of(resolved, request) if own_calibration else None
    screen = Screen(as_json=as_json)
    opener = partial(wiring.open_parts, own=begun, screen=screen)
    running.run_session(resolved, request, opener, Reports().draw, screen, looking_on)
