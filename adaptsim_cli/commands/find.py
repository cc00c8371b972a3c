"""`adaptsim find`: the devices of a lab that this computer can reach."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen


@command("hw")
def find(screen: Screen, resolved: Resolved) -> Reply:
    """Find cameras, serial ports and the arm, and say where each belongs in the rig file. Nothing moves.

    The cameras are those of every known kind that are plugged in. The arm is asked at the address of the rig file, with
    --hw of a real arm.

    Example: adaptsim find --hw fr3
    """
    from rich.text import Text

    from adaptsim_cli.bench.doctor import reachable
    from adaptsim_cli.screen import views

    rows = []
    for kind in reachable.camera_kinds():
        with screen.busy(f"Looking for cameras of the kind {kind}"):
            rows += reachable.cameras(kind)
    rows += reachable.ports(Path("/dev"))
    if reachable.is_arm(resolved.config.hw):
        with screen.busy("Asking the arm"):
            rows.append(reachable.arm(resolved.config))
    text: list[RenderableType] = []
    for row in rows:
        text.append(Text.assemble((row["device"], "bold"), f": {row['name']}"))
        text.append(views.indent(Text(row["answer"])))
        if row["entry"]:
            text.append(views.indent(Text(f"Rig file: {row['entry']}")))
    if not any(row["device"] == reachable.PORT for row in rows):
        text.append("No USB device with a serial port is plugged in.")
    step = ("adaptsim setup --hw fr3", "writes the rig file; it offers these names")
    return Reply({"devices": rows}, text, [step])
