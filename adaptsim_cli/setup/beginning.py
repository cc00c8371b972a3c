"""Where a setup begins: the rig file that is there, or a first one."""

from __future__ import annotations

from pathlib import Path
from typing import cast

from adaptsim_cli.config import PRACTICE_FILE, Resolved
from adaptsim_cli.devices.rig_file.description import ArmPart, Model, RigDescription, as_shipped
from adaptsim_cli.devices.rig_file.reading import read, tasks_with_tools
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.setup.answers import Answers

ADDRESS = "172.16.0.2"
"""Default address of an arm's control box."""


def begun(resolved: Resolved, screen: Screen, *, yes: bool) -> Answers:
    """The answers so far. Raises UsageError: a rig file of another arm, no terminal, `yes` for a real arm."""
    config, places = resolved.config, resolved.places
    if yes and not config.is_simulated:
        raise UsageError("a real lab is set up by a person at a terminal: leave out --yes")
    if not yes:
        console.require_terminal("there is no terminal to ask at: run in a terminal; in the simulated lab add --yes")
    project, user = places.rig_files
    here = project if places.project_file.is_file() else user
    if config.is_simulated:
        file, new = here.with_name(PRACTICE_FILE), as_shipped("panda")
        rig = (
            read(file, tasks_with_tools()) if file.is_file() else RigDescription("practice", new.arm, waived=("pedal",))
        )
    else:
        file = Path(config.rig) if config.rig else here
        arm = ArmPart(cast(Model, config.hw), ADDRESS)
        rig = read(file, tasks_with_tools()) if file.is_file() else RigDescription("lab", arm)
        if rig.arm.model != config.hw:
            raise UsageError(f"{file} is the rig file of a {rig.arm.model}: say --hw {rig.arm.model}, or move it away")
    operator = config.operator
    while not (operator or config.is_simulated):
        answer = screen.words("Who sets it up? Your name goes into the record:")
        if answer is None:
            raise StoppedByOperator("stopped by the operator; nothing has been written")
        operator = answer
    config = config.model_copy(update={"rig": str(file), "operator": operator})
    return Answers(config, places, file, rig, screen, yes)
