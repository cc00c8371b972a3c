"""A lab before its first trial: `adaptsim setup`, `doctor` and `parts`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from sim.types import Part

_ArmOrPractice = Annotated[
    str | None, typer.Option("--hw", help="Which hardware: fr3, fr3v2, panda, or fake to practise.")
]


@command("task", "world", "seed", "operator", hw=_ArmOrPractice, with_json=False)
def setup(
    screen: Screen,
    resolved: Resolved,
    begin: Annotated[str, typer.Option("--from", help="Do this step and all after it again, e.g. camera.")] = "",
    waive: Annotated[
        str, typer.Option("--waive", help="Ask why this lab goes without a safeguard, e.g. hand, and nothing else.")
    ] = "",
    yes: options.Yes = False,
) -> Reply:
    """Set up a lab: from an unpacked arm to the first trial, with a check after every step.

    It asks, writes the rig file, and leads through calibration, touch-off and the first motions. The same command
    continues a walk that was stopped. In the simulated lab it is practised, with a rig file of its own, practice.toml.

    Example: adaptsim setup --hw fr3 --task scooping
    """
    from adaptsim_cli.commands.setup_steps import walk
    from adaptsim_cli.commands.setup_steps.answers import begun
    from adaptsim_cli.config import same_lab

    answers = begun(resolved, screen, yes=yes)
    if waive:
        walk.waive(answers, waive)
        return Reply()
    walk.walk(answers, begin=begin)
    lab = answers.config
    table = (f"adaptsim doctor {same_lab(lab.task, lab.hw, lab.world)}", "everything in one table")
    return Reply(next=[(f"adaptsim run-iteration {lab.same_lab}", "the first session"), table])


@command("task", "world", "hw")
def doctor(
    screen: Screen,
    resolved: Resolved,
    assessment: Annotated[
        Path | None, typer.Option("--assessment", help="Write a risk assessment of this rig into a new .html file.")
    ] = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="Also measure for a minute what the arm needs before a motion.")
    ] = False,
) -> Reply:
    """Check everything that an iteration needs, and give the remedy for whatever is missing. Nothing moves.

    With --measure it also sends the arm the settings of ten motions, without a motion, watches it at rest for a minute,
    and proposes the bounds of [arm.starting]. Exit code 3 when something is missing. With --assessment it only writes
    the sheet, to be completed and signed.

    Example: adaptsim doctor --hw fr3
    """
    from adaptsim_cli.bench.doctor import assessment as risks
    from adaptsim_cli.bench.doctor import checks, table

    if assessment is not None:
        risks.write(resolved, assessment, screen)
        return Reply()
    with screen.busy(f"Looking at everything that hw = {resolved.config.hw} needs"):
        names = (*checks.CHECKS, *(checks.MEASUREMENTS if measure else ()))
        findings = tuple(checks.examine(resolved, names))
    screen.print(table.checklist(findings, resolved.config))
    return table.reply(findings, resolved.config)


@command()
def parts(
    screen: Screen,
    out: Annotated[Path, typer.Option("--out", help="A new folder for the files.")] = Path("parts"),
) -> Reply:
    """Write the parts that a lab prints: pusher, adapter of the turner, holder of the board, and a sheet.

    The numbers are those of scene, limits and masks. The sheet says how to print each, has its drawing, and the patch
    of the pushing task at true size. The board itself: adaptsim calibrate board.

    Example: adaptsim parts --out parts
    """
    from adaptsim_cli.bench import printed_parts as sheet
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import views
    from adaptsim_cli.storage import durable

    if out.exists():
        raise UsageError(f"{out} exists already: give another folder with --out")
    with screen.busy("Building the solids"):
        pieces = all_parts()
        solids = [part for part in pieces if not part.flat]
        files = {f"{part.name}.stl": bytes(sheet.printed(part).export(file_type="stl")) for part in solids}
        files["parts.pdf"] = sheet.pdf(pieces)
    durable.write_folder(out, files)
    lines = [line for part in pieces for line in (*sheet.lines(part), "")]
    rows = [
        {"file": str(out / f"{part.name}.stl"), "count": part.count, "notes": list(sheet.lines(part))}
        for part in solids
    ]
    data = {"sheet": str(out / "parts.pdf"), "parts": rows}
    return Reply(data, [*lines, views.FileLine("Written", out / "parts.pdf")])


def all_parts() -> tuple[Part, ...]:
    """Parts of every task with an arm, and the board's holder. Raises ExtraMissing without trimesh and manifold3d."""
    from sim.lab.board import holder
    from sim.tasks import get_task, task_names

    tools = [get_task(name).hardware for name in task_names()]
    return (*(part for tool in tools if tool for part in tool.parts()), holder())
