"""`adaptsim rollout`: single trials, from which nothing is learnt."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.session.target import Openers


@command("task", "world", "seed", "hw", "answer_with", "answer_moves", "realtime", "pace", "operator")
def rollout(
    screen: Screen,
    resolved: Resolved,
    openers: Openers,
    context: options.Context = None,
    action: options.Action = None,
    param: Annotated[
        list[str] | None,
        typer.Option("--param", help="Parameter to train the policy for, as name=value; may be repeated."),
    ] = None,
    session: Annotated[
        str | None,
        typer.Option(
            "--session",
            autocompletion=options.session_names,
            help="With --best: the session that gives policy, task and world.",
        ),
    ] = None,
    best: Annotated[bool, typer.Option("--best", help="The best policy of --session.")] = False,
    trials: Annotated[int, typer.Option("--trials", min=1, help="With --best: that many, at drawn contexts.")] = 1,
    out: Annotated[
        Path | None, typer.Option("--out", help="New folder for it; by default beside the sessions.")
    ] = None,
    view: options.View = False,
    view_port: options.ViewPort = None,
    yes: options.Yes = False,
) -> Reply:
    """Execute one trial with a chosen action, or with the action of a policy. Nothing is adapted.

    It is stored as a session without adaptation, which `sessions` lists, shows and exports. The policy chooses the
    actions that are not given. `--session NAME --best` takes task, world and the best policy of a session. With
    `--trials 5` its reward is measured at five drawn contexts, and the session's report says so.

    Example: adaptsim rollout --task scooping --action pitch_rate=0.1 --world wd --yes
    """
    from functools import partial

    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.session import rollouts
    from adaptsim_cli.show import page
    from adaptsim_cli.show.live import live_view

    if best != (session is not None):
        raise UsageError("--session and --best go together: adaptsim rollout --session NAME --best")
    open_view = (
        partial(live_view, port=view_port, root=resolved.places.sessions) if view or view_port is not None else None
    )
    request = rollouts.RolloutRequest(context or (), action or (), param or (), session, trials, out, yes)
    return rollouts.run(resolved, request, openers.parts, screen, page.write, open_view)
