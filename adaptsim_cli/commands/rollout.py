"""`adaptsim rollout` and `adaptsim preview`: single trials, of which nothing is learnt."""

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

_RigFile = Annotated[str | None, typer.Option("--hw", help="Plan for the lab of the rig file: panda, fr3 or fr3v2.")]


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


@command("task", hw=_RigFile)
def preview(
    screen: Screen,
    resolved: Resolved,
    arm: Annotated[str | None, typer.Option("--arm", help="Arm with its factory limits: panda, fr3 or fr3v2.")] = None,
    context: options.Context = None,
    action: options.Action = None,
    html: Annotated[
        Path | None, typer.Option("--html", help="Write the page to this file instead of serving it.")
    ] = None,
) -> Reply:
    """Plan one motion, show how close it comes to each limit, and play it in the browser. Nothing moves.

    A value that is not given is the middle of its range. With --hw, tool, table and boxes come from the rig file. With
    --json the limit table is printed, and no page is served.

    Example: adaptsim preview --task scooping --action pitch_rate=0.1 --context y=0.02
    """
    from adaptsim_cli.bench import motion
    from adaptsim_cli.config import SIMULATED
    from adaptsim_cli.screen import keys, views

    with screen.busy("Planning the motion"):
        planned = motion.planned(motion.mounted_for(resolved, arm), context or [], action or [])
    if not screen.as_json:
        screen.show(views.badge(SIMULATED, "a preview"))
        screen.show(planned.table())
    written = []
    if html is not None:
        from adaptsim_cli.storage import durable

        durable.replace_file(html, planned.html().encode())
        written = [views.FileLine("Written", html)]
    elif not screen.as_json:
        page = planned.page()
        screen.plain(f"The motion plays at {page.url}")
        close = keys.enter("to close the page", "The page ends, and so does the command."), keys.stop("The same.")
        screen.choose("Look at it in a browser.", *close)
    return Reply(planned.as_json(), written, [planned.next_step(resolved.config)])
