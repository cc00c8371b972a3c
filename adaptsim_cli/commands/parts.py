"""`adaptsim parts`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli import options

if TYPE_CHECKING:
    from sim.types import Part


def parts(
    out: Annotated[Path, typer.Option("--out", help="A new folder for the files.")] = Path("parts"),
    as_json: options.Json = False,
) -> None:
    """Write the parts that a lab prints: pusher, adapter of the turner, holder of the board, and a sheet.

    The numbers are those of scene, limits and masks. The sheet says how to print each, has its drawing, and the patch
    of the pushing task at true size. The board itself: adaptsim calibrate board.

    Example: adaptsim parts --out parts
    """
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.report import parts as sheet
    from adaptsim_cli.screen import console
    from adaptsim_cli.storage import durable

    screen = console.Screen(as_json=as_json)
    if out.exists():
        raise UsageError(f"{out} exists already: give another folder with --out")
    with screen.busy("Building the solids"):
        made = all_parts()
        solids = [part for part in made if not part.flat]
        files = {f"{part.name}.stl": bytes(sheet.printed(part).export(file_type="stl")) for part in solids}
        files["parts.pdf"] = sheet.pdf(made)
    durable.write_folder(out, files)
    for part in made:
        for line in sheet.lines(part):
            screen.plain(line)
        screen.plain("")
    screen.plain(f"Written: {out / 'parts.pdf'}")
    told = [
        {"file": str(out / f"{part.name}.stl"), "count": part.count, "notes": list(sheet.lines(part))}
        for part in solids
    ]
    screen.data("parts", {"sheet": str(out / "parts.pdf"), "parts": told})


def all_parts() -> tuple[Part, ...]:
    """Those of every task with an arm, and the board's holder. Raises ExtraMissing without trimesh and manifold3d."""
    from sim.lab.board import holder
    from sim.tasks import get_task, task_names

    tools = [get_task(name).hardware for name in task_names()]
    return (*(part for tool in tools if tool for part in tool.parts()), holder())
