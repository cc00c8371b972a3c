"""`adaptsim task new/check/show`: a task of one file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.screen.console import Screen

app = typer.Typer(help="A task of your own, in one file.", no_args_is_help=True)

_File = Annotated[Path, typer.Argument(help="Python file of the task.")]
_Named = Annotated[str, typer.Argument(help="Python file of the task, or its name.", autocompletion=options.task_names)]


@app.command()
@command()
def new(file: _File, force: options.Force = False) -> Reply:
    """Write a small task that runs, to be changed into your own.

    Example: adaptsim task new my_task.py
    """
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import views
    from adaptsim_cli.storage import durable
    from sim.own.template import template

    if file.suffix != ".py" or not file.stem.isidentifier():
        raise UsageError(f"{file}: the file must end in .py, and its name must be a word of letters, digits and _")
    if file.exists() and not force:
        raise UsageError(f"{file} exists: name another file, or replace it with --force")
    durable.make_folder(file.absolute().parent)
    durable.replace_file(file, template(file.stem).encode())
    steps = [(f"adaptsim task check {file}", "what every task must keep"), (f"adaptsim task show {file}", "its spaces")]
    return Reply({"file": str(file.absolute())}, [views.FileLine("Written", file)], steps)


@app.command()
@command()
def check(
    screen: Screen,
    task: _Named,
    limit_s: Annotated[
        float, typer.Option("--limit", min=1.0, max=3600.0, help="Seconds that the rollouts may take, about.")
    ] = 60.0,
) -> Reply:
    """Check what every task must keep: numbers, order, ranges, units, rewards, contexts.

    Ends with exit code 2 if something is broken. A doubt is only a question, and refuses nothing.

    Example: adaptsim task check shuffle.py
    """
    from adaptsim_cli.research.task_check import checked
    from adaptsim_cli.screen import views
    from sim.errors import TaskError
    from sim.rollouts.cost import duration

    with screen.busy("Simulating rollouts", "simulating"):
        result = checked(task, limit_s)
    marks = {"kept": "✓", "doubtful": "?", "broken": "✗"}
    body = [(marks[one["mark"]], one["check"], one["detail"]) for one in result["findings"]]
    text: list[Any] = [views.rows(("", "what every task keeps", ""), body)]
    if result["rollouts"]:
        text.append(
            f"A rollout takes {duration(result['median_s'])} (median of {result['rollouts']}, "
            f"longest {duration(result['longest_s'])})."
        )
    broken = [one["detail"] for one in result["findings"] if one["mark"] == "broken"]
    failure = TaskError(f"{task}: {len(broken)} broken, first: {broken[0]}") if broken else None
    pretrain = (f"adaptsim pretrain --task {task} --budget small", "Phase 1")
    return Reply(result, text, [] if broken else [pretrain], failure)


@app.command()
@command()
def show(task: _Named) -> Reply:
    """Show the spaces, the observation and the worlds of a task.

    Example: adaptsim task show shuffle.py
    """
    from adaptsim_cli.research.task_check import described, loaded
    from adaptsim_cli.screen import views

    one = loaded(task)
    facts = described(one)
    roles = [
        (role, d.name, views.kinds(d), d.scale if not d.words else "category", d.meaning)
        for role in ("parameters", "context", "action", "nuisance")
        for d in getattr(one, role).dimensions
    ]
    roles += [("state", name, f"{low:g} to {high:g}", "", "") for name, low, high in facts["state"]]
    text: list[Any] = [
        f"{one.name}: {one.title}",
        f"Physics: {facts['physics']}; a trial lasts {facts['duration_s']:g} s and is observed at "
        f"{len(facts['times_s'])} moments.",
        views.rows(("", "name", "range", "scale", "meaning"), roles),
        f"Worlds: {', '.join(facts['worlds']) or 'none'}",
    ]
    return Reply(facts, text, [(f"adaptsim task check {task}", "what every task must keep")])
