"""`adaptsim lab show/list`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from rich.console import RenderableType

    from adaptsim_cli.config import Resolved
    from sim.tasks.task import Task
    from sim.types import Dimension

app = typer.Typer(help="The simulated lab and its worlds.", no_args_is_help=True)


@app.command()
@command("world", "task", "seed")
def show(
    resolved: Resolved,
    png: Annotated[
        Path | None,
        options.advanced("--png", "Write the camera picture to this file."),
    ] = None,
) -> Reply:
    """Show the true parameters of a world. For checks only: learning and tracking never read them.

    Example: adaptsim lab show --task scooping --world oreo --json
    """
    from adaptsim_cli.errors import UsageError
    from sim.lab.simulated import SimulatedLab, truth_of
    from sim.lab.world import load_world
    from sim.panda.tool import cell_as_shipped
    from sim.tasks import get_task

    chosen = resolved.config
    task = get_task(chosen.task)
    world = load_world(chosen.world, task)
    written = []
    if png is not None and task.hardware is None:
        raise UsageError(f"--png: {task.name} has no lab scene, it runs in simulation only; leave --png out")
    if png is not None and world.physics != "drake":
        world.require_lab()
    if task.hardware is None or world.physics != "drake":
        truth = truth_of(task, world)
    else:
        lab = SimulatedLab(task, world, chosen.seed, cell_as_shipped(task.hardware, "panda"))
        truth = lab.truth()
        if png is not None:
            from adaptsim_cli.screen import views
            from adaptsim_cli.storage import durable
            from hw.bounded import encode_image

            durable.replace_file(png, encode_image(lab.picture().colour[..., ::-1], ".png"))
            written = [views.FileLine("Written", png)]
    data, text = _truth(resolved, task, truth)
    session = f"adaptsim run-iteration --task {chosen.task} --world {chosen.world} --seed {chosen.seed}"
    return Reply(data, [*text, *written], [(session, "a session in this world; it never sees this table")])


def _truth(resolved: Resolved, task: Task, truth: dict[str, Any]) -> tuple[dict[str, Any], list[RenderableType]]:
    """The truth for a program, and the same for a person, with the belief of the newest session in this world."""
    from adaptsim_cli.screen import views
    from adaptsim_cli.show import truth_view
    from adaptsim_cli.show.reports import Reports
    from adaptsim_cli.show.truth import newest_in

    spaces = (task.parameters, task.nuisance)
    store = newest_in(resolved.places.sessions, task.name, resolved.config.lab_world)
    revealed = None if store is None else Reports().truth(store)
    units = {d.name: d.unit for space in spaces for d in space.dimensions}
    text: list[RenderableType] = [f"{truth['world']}: {truth['description']}"]
    if task.hardware is not None and truth["physics"] != "drake":
        text.append(f"Its physics is {truth['physics']}: trials run without arm or camera.")
    groups = ("parameters", "nuisance", "unmodelled", "sensing", "mount", "faults")
    named = {
        group: {d.name: d for d in space.dimensions}
        for group, space in (("parameters", task.parameters), ("nuisance", task.nuisance))
    }
    body = [
        (group, name, str(value), "") if d is None else (group, d.label, _in_words(d, value), d.plain)
        for group in groups
        for name, value in truth.get(group, {}).items()
        for d in (named.get(group, {}).get(name),)
    ]
    rows = truth.get("X_BC", [])
    body += [("camera", f"X_BC row {i}", "  ".join(f"{v:8.4f}" for v in row), "") for i, row in enumerate(rows)]
    if revealed is not None:
        text.append(truth_view.table(revealed))
        text.append(f"This belief is that of session {revealed.session}, the newest in this world.")
    text.append(views.rows(("", "name", "value", "plain name"), body))
    return truth | {"units": units, "revealed": revealed}, text


def _in_words(dimension: Dimension, value: float) -> str:
    """A value for a person: the word of a category."""
    from adaptsim_cli.screen import views

    return views.value_in_words(dimension, value) if dimension.words or dimension.scale == "integer" else str(value)


@app.command("list")
@command("task")
def list_all(resolved: Resolved) -> Reply:
    """List the worlds of a task, and explain its parameters, contexts and actions.

    Example: adaptsim lab list --task scooping
    """
    from adaptsim_cli.screen import quantities, views
    from sim.lab.physics import physics_name
    from sim.lab.world import list_worlds, load_world
    from sim.tasks import get_task

    task = get_task(resolved.config.task)
    worlds = [load_world(name, task) for name in list_worlds(task)]
    rows = [
        {"name": w.name, "task": w.task, "description": w.description, "physics": physics_name(task, w.physics)}
        for w in worlds
    ]
    spaces = (task.parameters, task.context, task.action, task.nuisance)
    words = [
        {"name": d.name, "plain_name": d.plain, "unit": d.unit, "meaning": d.meaning, "low": d.low, "high": d.high}
        for space in spaces
        for d in space.dimensions
    ]
    body = [(row["name"], row["physics"], row["description"]) for row in rows]
    table = views.rows(("world", "physics", "what it is"), body)
    session = (f"adaptsim run-iteration --task {task.name} --world NAME", "a session in one of these worlds")
    return Reply(
        {"worlds": rows, "quantities": words}, [table, quantities.meanings(task, with_symbols=True)], [session]
    )
