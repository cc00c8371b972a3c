"""`adaptsim preview`: one planned motion with its limits, played in the browser."""

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

_RigFile = Annotated[str | None, typer.Option("--hw", help="Plan for the lab of the rig file: panda, fr3 or fr3v2.")]


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
