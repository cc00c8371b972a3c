"""`adaptsim doctor`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def doctor(
    task: Annotated[str | None, typer.Option("--task", help="Which task, e.g. scooping.")] = None,
    world: Annotated[str | None, typer.Option("--world", help="World of the simulated lab: name or TOML file.")] = None,
    hw: Annotated[str | None, typer.Option("--hw", help="Which hardware: fake, panda or fr3.")] = None,
    assessment: Annotated[
        Path | None, typer.Option("--assessment", help="Write a risk assessment of this rig into a new .html file.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The checklist as one JSON object on stdout.")] = False,
) -> None:
    """Check everything that an iteration needs, and give the remedy for whatever is missing. Nothing moves.

    Exit code 3 when something is missing. With --assessment it only writes the sheet, to be completed and signed.

    Example: adaptsim doctor --hw fr3
    """
    from adaptsim_cli.doctor import examination
    from adaptsim_cli.screen import console
    from adaptsim_cli.wiring import settings

    resolved = settings.load({"task": task, "world": world, "hw": hw})
    if assessment is not None:
        from adaptsim_cli.doctor.assessment import write

        write(resolved, assessment, console.Screen(as_json=as_json))
        return
    screen = console.Screen(as_json=as_json)
    with screen.busy(f"Looking at everything that hw = {resolved.config.hw} needs"):
        found = tuple(examination.examine(resolved))
    examination.show(found, resolved.config, screen)
    if as_json:
        screen.data("doctor", examination.as_json(found, resolved.config))
    examination.require(found)
