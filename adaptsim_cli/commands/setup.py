"""A lab before its first trial: `adaptsim setup`, `doctor` and `parts`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli import options


def setup(
    task: options.Task = None,
    world: options.World = None,
    seed: options.Seed = None,
    hw: Annotated[str | None, typer.Option("--hw", help="Which hardware: fr3, panda, or fake to practise.")] = None,
    begin: Annotated[str, typer.Option("--from", help="Do this step and all after it again, e.g. camera.")] = "",
    waive: Annotated[
        str, typer.Option("--waive", help="Ask why this lab goes without a safeguard, e.g. hand, and nothing else.")
    ] = "",
    operator: options.Operator = None,
    yes: options.Yes = False,
) -> None:
    """Set up a lab: from an unpacked arm to the first trial, with a check after every step.

    It asks, writes the rig file, and leads through calibration, touch-off and the first motions. A walk that was
    stopped goes on where it was. In the simulated lab it is practised, with a rig file of its own, practice.toml.

    Example: adaptsim setup --hw fr3 --task scooping
    """
    from adaptsim_cli.config import same_lab
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.setup import walk
    from adaptsim_cli.setup.answers import begun
    from adaptsim_cli.wiring import settings

    resolved = settings.load({"task": task, "world": world, "seed": seed, "hw": hw, "operator": operator})
    answers = begun(resolved, Screen(leads=False), yes=yes)
    if waive:
        walk.waive(answers, waive)
        return
    walk.walk(answers, begin=begin)
    lab = answers.config
    Screen().next(
        (f"adaptsim run-iteration {lab.same_lab}", "the first session"),
        (f"adaptsim doctor {same_lab(lab.task, lab.hw, lab.world)}", "everything in one table"),
    )


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
        findings = tuple(checks.examine(resolved))
    table.show(findings, resolved.config, screen)
    screen.data("doctor", table.as_json(findings, resolved.config))
    table.require(findings)


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
        pieces = all_parts()
        solids = [part for part in pieces if not part.flat]
        files = {f"{part.name}.stl": bytes(sheet.printed(part).export(file_type="stl")) for part in solids}
        files["parts.pdf"] = sheet.pdf(pieces)
    durable.write_folder(out, files)
    for part in pieces:
        for line in sheet.lines(part):
            screen.plain(line)
        screen.plain("")
    screen.plain(f"Written: {out / 'parts.pdf'}")
    rows = [
        {"file": str(out / f"{part.name}.stl"), "count": part.count, "notes": list(sheet.lines(part))}
        for part in solids
    ]
    screen.data("parts", {"sheet": str(out / "parts.pdf"), "parts": rows})


def all_parts() -> tuple[Part, ...]:
    """Those of every task with an arm, and the board's holder. Raises ExtraMissing without trimesh and manifold3d."""
    from sim.lab.board import holder
    from sim.tasks import get_task, task_names

    tools = [get_task(name).hardware for name in task_names()]
    return (*(part for tool in tools if tool for part in tool.parts()), holder())
