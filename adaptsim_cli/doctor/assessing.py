"""Writes the risk assessment of the rig of some settings."""

from __future__ import annotations

from pathlib import Path

from adaptsim_cli.config import Resolved
from adaptsim_cli.devices.known_arm import KnownArm, folder_of
from adaptsim_cli.devices.rig_file.reading import rig_of, tasks_with_tools
from adaptsim_cli.doctor.assessment import motions_of, page
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.storage import durable
from adaptsim_cli.wiring.motion import mounted_for, planned


def write(resolved: Resolved, path: Path, screen: Screen) -> None:
    """Plan the task's middle action with this rig and write the page. Nothing moves, and no device is opened.

    Raises UsageError (no real arm, no rig file, an existing file), and the errors of planning.
    """
    if resolved.config.is_simulated:
        raise UsageError("--assessment: the simulated lab hurts nobody; name an arm with --hw")
    if path.exists():
        raise UsageError(f"{path} exists already: name a new file")
    rig, there = rig_of(resolved.config, tasks_with_tools()), mounted_for(resolved, None)
    moves = motions_of(there, planned(there, (), ()).paths)
    text = page(there, rig, moves, KnownArm(folder_of(resolved.places, rig)).read())
    durable.write_file(path.absolute(), text.encode())
    screen.plain(f"Written: {path}. Complete it, decide, and sign it")
