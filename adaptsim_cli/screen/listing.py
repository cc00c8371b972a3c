"""A list of a rig's calibrations or touch-offs, with the sessions that use the current one."""

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


def tell(
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
