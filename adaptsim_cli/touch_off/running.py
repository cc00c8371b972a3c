"""From the command line to a running touch-off, and from its result to the screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from datetime import UTC, datetime

from adaptsim_cli.config import Config, Places, Resolved
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen, how_to_continue
from adaptsim_cli.touch_off import flow, terminal_views
from adaptsim_cli.touch_off.parts import Grasp, TouchRig
from adaptsim_cli.touch_off.store import TouchOffStore

OpenRig = Callable[[Config, Places, Grasp], AbstractContextManager[TouchRig]]
"""Connects the devices."""
_HINT = "Nothing was stored; the previous touch-off stays in use. Start again with: adaptsim touch-off"


def touch_off(
    resolved: Resolved,
    grasp: Grasp,
    store: TouchOffStore,
    sessions: Sequence[str],
    open_rig: OpenRig,
    screen: Screen,
    *,
    yes: bool,
) -> None:
    """The whole touch-off. Raises the error that stops it, with the command to continue.

    `sessions` are the open ones that use the present touch-off.
    """
    config = resolved.config
    if not config.is_simulated and yes:
        raise UsageError(flow.NEVER_CONFIRMS)
    if not yes:
        console.require_terminal()
    screen.resting("table and tool as now known", sessions)
    with how_to_continue(_HINT, "interrupted"), open_rig(config, resolved.places, grasp) as rig:
        screen.show(terminal_views.explanation(rig))
        now = datetime.now(UTC).isoformat(timespec="seconds")
        saved = flow.touch_off(rig, screen, unattended=yes, created=now)
    folder = store.save(saved)
    screen.plain(f"In use from now on: {folder}")
    screen.next((f"adaptsim rollout {config.same_lab}", "one trial with it"))
    screen.data("touch-off", terminal_views.summary(saved) | {"folder": str(folder)})
