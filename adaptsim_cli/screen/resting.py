"""What the calibrations and touch-offs of a rig share: their list, and the open sessions that rest on one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen


@dataclass(frozen=True)
class Listing:
    """The kind of a list."""

    plural: str
    command: str  # `adaptsim COMMAND` makes one, `adaptsim COMMAND compare` compares two
    folder: Path
    head: Sequence[str]


def tell_list(
    screen: Screen,
    listed: Listing,
    found: Sequence[Mapping[str, Any]],
    rows: Sequence[Sequence[str]],
    resting: Sequence[str],
) -> None:
    """Show the `rows` of `found`, oldest first, the sessions that use the current one (`resting`), and the next
    command.
    """
    if found:
        screen.show(views.rows(listed.head, rows))
    else:
        screen.plain(f"No {listed.plural} yet in {listed.folder}")
    if resting:
        screen.show(f"Open sessions that use the current one: {', '.join(resting)}")
    if len(found) > 1:
        names = f"{found[-2]['name']} {found[-1]['name']}"
        screen.next((f"adaptsim {listed.command} compare {names}", "with the same --task, --world or --hw"))
    else:
        screen.next((f"adaptsim {listed.command}", "makes one, with the same --task, --world or --hw"))


def tell_resting(screen: Screen, what: str, sessions: Sequence[str]) -> None:
    """Name the `sessions` that use `what`, if there are any."""
    if not sessions:
        return
    many = "s" if len(sessions) > 1 else ""
    screen.note(f"Open session{many} that rest{'' if many else 's'} on {what}: {', '.join(sessions)}.")
    screen.plain("Once it is replaced, each can continue only with its own, if the camera has not moved:")
    screen.plain(f"  adaptsim run-iteration --session {sessions[0]} --own-calibration")
