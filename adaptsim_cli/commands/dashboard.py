"""`adaptsim dashboard`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen


@command(with_json=False)
def dashboard(
    screen: Screen,
    resolved: Resolved,
    port: Annotated[
        int | None,
        typer.Option("--port", min=1024, max=65535, help="Its port; by default 8765, or any free one."),
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
) -> Reply:
    """Show all sessions in the browser: search, tags, learning curves side by side, and the running session live.

    The page is served on 127.0.0.1 until you press Ctrl-C. It follows the sessions by itself and changes nothing.

    Example: adaptsim dashboard
    """
    import os
    import sys
    import threading
    import webbrowser

    from adaptsim_cli.show.dashboard import Dashboard
    from adaptsim_cli.show.server import LocalServer

    root = resolved.places.sessions
    with LocalServer(Dashboard(root), port) as server:
        screen.plain(f"Dashboard of the sessions in {root}: {server.address}")
        screen.plain(f"From another computer: {server.tunnel}")
        screen.plain("Ctrl-C ends it.")
        has_display = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
        if browser and has_display and sys.stdout.isatty():
            webbrowser.open(server.address)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return Reply(text=["The dashboard has ended. No session was changed."])
    return Reply()
