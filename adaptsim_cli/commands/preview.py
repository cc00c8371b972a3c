"""`adaptsim preview`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def preview(
    task: Annotated[str | None, typer.Option("--task", help="Which task, e.g. scooping.")] = None,
    arm: Annotated[str | None, typer.Option("--arm", help="Arm with its factory limits: panda or fr3.")] = None,
    hw: Annotated[str | None, typer.Option("--hw", help="Plan for the lab of the rig file: panda or fr3.")] = None,
    context: Annotated[
        list[str] | None, typer.Option("--context", help="Context as name=value, repeatable; names: adaptsim lab list.")
    ] = None,
    action: Annotated[
        list[str] | None, typer.Option("--action", help="Action as name=value, repeatable; names: adaptsim lab list.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option("--html", help="Write the page to this file instead of serving it.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The limit table on stdout; no page is served.")] = False,
) -> None:
    """Plan one motion, show how close it comes to each limit, and play it in the browser. Nothing moves.

    A value that is not given is the middle of its range. With --hw, tool, table and boxes come from the rig file.

    Example: adaptsim preview --task scooping --action pitch_rate=0.1 --context y=0.02
    """
    from adaptsim_cli import config
    from adaptsim_cli.config import SIMULATED
    from adaptsim_cli.screen import console, keys, views
    from adaptsim_cli.wiring import motion

    resolved = config.load({"task": task, "hw": hw})
    screen = console.Screen(as_json=as_json)
    with screen.busy("Planning the motion"):
        planned = motion.planned(motion.mounted_for(resolved, arm), context or [], action or [])
    if as_json:
        screen.data("preview", planned.as_json())
    else:
        screen.show(views.badge(SIMULATED, "a preview"))
        screen.show(planned.table())
    if html is not None:
        from adaptsim_cli.storage import durable

        durable.replace_file(html, planned.page().html().encode())
        screen.plain(f"Written: {html}")
        screen.next(planned.next_step(resolved.config))
    elif not as_json:
        page = planned.page()
        screen.plain(f"The motion plays at {page.url}")
        close = keys.enter("to close the page", "The page ends, and so does the command."), keys.stop("The same.")
        screen.choose("Look at it in a browser.", *close)
        screen.next(planned.next_step(resolved.config))
