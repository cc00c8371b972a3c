"""`adaptsim doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from adaptsim_cli import options


def doctor(
    task: options.Task = None,
    world: options.World = None,
    hw: options.Hw = None,
    assessment: Annotated[
        Path | None, typer.Option("--assessment", help="Write a risk assessment of this rig into a new .html file.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Check everything that an iteration needs, and give the remedy for whatever is missing. Nothing moves.

    Exit code 3 when something is missing. With --assessment it only writes the sheet, to be completed and signed.

    Example: adaptsim doctor --hw fr3
    """
    from adaptsim_cli.doctor import assessment as risks
    from adaptsim_cli.doctor import checks, table
    from adaptsim_cli.screen import console
    from adaptsim_cli.wiring import settings

    resolved, screen = settings.load({"task": task, "world": world, "hw": hw}), console.Screen(as_json=as_json)
    if assessment is not None:
        risks.write(resolved, assessment, screen)
        return
    with screen.busy(f"Looking at everything that hw = {resolved.config.hw} needs"):
        found = tuple(checks.examine(resolved))
    table.show(found, resolved.config, screen)
    screen.data("doctor", table.as_json(found, resolved.config))
    table.require(found)
