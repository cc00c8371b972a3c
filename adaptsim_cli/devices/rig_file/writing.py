"""`adaptsim config init`: from questions to files.

Each file is written whole or not at all, and none is replaced without asking.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from adaptsim_cli import config
from adaptsim_cli.config import Places
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.interview import ARMS, Ask, interview
from adaptsim_cli.devices.rig_file.inventory import Inventory, look
from adaptsim_cli.devices.rig_file.reading import tasks_with_tools
from adaptsim_cli.devices.rig_file.template import template
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen import console
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key, enter, stop
from adaptsim_cli.storage import durable


@dataclass(frozen=True)
class InitRequest:
    """The operator's options on the command line."""

    project: bool
    arm: str | None
    overwrite: bool
    yes: bool


@dataclass(frozen=True)
class Written:
    """The files that exist now."""

    settings: Path
    settings_new: bool
    rig_file: Path | None
    rig: RigDescription | None

    def as_json(self) -> dict[str, Any]:
        """The object that `config init --json` prints."""
        return {
            "settings": str(self.settings),
            "settings_written": self.settings_new,
            "rig_file": None if self.rig_file is None else str(self.rig_file),
            "rig": None if self.rig is None else asdict(self.rig),
        }


def init(places: Places, request: InitRequest, screen: Screen) -> Written:
    """Ask, then write. Raises UsageError, StoppedByOperator or SessionError before anything is written."""
    if request.arm is not None and request.arm not in ARMS:
        raise UsageError(f"--arm {request.arm}: choose one of {', '.join(ARMS)}")
    if not request.yes:
        console.require_terminal("there is no terminal to ask at: run in a terminal, or add --yes for every default")
    settings = places.project_file if request.project else places.user_file
    file = settings.with_name(config.RIG_FILE)
    if request.arm != "none":
        _may_replace(file, request, screen)
        with screen.busy("Looking for serial ports and cameras"):
            found = look()
    else:
        found = Inventory((), ())
    rig = interview(_asking(screen, request), screen.plain, found, request.arm or (ARMS[0] if request.yes else None))
    if rig is not None:
        text = template(rig, tasks_with_tools())
        durable.make_folder(file.parent)
        durable.replace_file(file, text.encode())
        screen.plain(f"Rig file: {file}")
        if rig.pedal is None:
            screen.note('No enabling pedal: the arm does not move until the file names one, or says waived = ["pedal"]')
    new = not settings.exists()
    if new:
        durable.make_folder(settings.parent)
        durable.write_file(settings, config.template().encode())
    screen.plain(f"Settings: {settings}" + ("" if new else " (unchanged)"))
    screen.next((f"adaptsim doctor{'' if rig is None else f' --hw {rig.arm.model}'}", "check the files first"))
    return Written(settings, new, None if rig is None else file, rig)


def _may_replace(file: Path, request: InitRequest, screen: Screen) -> None:
    """Raises UsageError or StoppedByOperator if a rig file exists and should stay."""
    if not file.exists() or request.overwrite:
        return
    if request.yes:
        raise UsageError(f"{file} exists already and is unchanged; edit it, or add --overwrite to replace it")
    keep = stop("Nothing is written.")
    replace = Key("y", "to replace it", "The questions follow; the file is replaced once all are answered.")
    if screen.choose(f"{file} exists already.", enter("to keep it", "Nothing is written."), replace, keep) != "y":
        raise StoppedByOperator(f"{file} is unchanged")


def _asking(screen: Screen, request: InitRequest) -> Ask:
    def ask(question: str, default: str) -> str:
        if request.yes:
            return default
        answer = screen.words(f"{question} [{default}]:")
        if answer is None:
            raise StoppedByOperator("stopped by the operator; nothing has been written")
        return answer or default

    return ask
