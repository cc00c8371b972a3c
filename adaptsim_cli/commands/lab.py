"""`adaptsim lab show/list`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli import options

if TYPE_CHECKING:
    from adaptsim_cli.screen.console import Screen
    from sim.tasks.task import Task

app = typer.Typer(help="The simulated lab and its worlds.", no_args_is_help=True)


@app.command()
def show(
    world: options.World = None,
    task: options.Task = None,
    seed: options.Seed = None,
    png: Annotated[
        Path | None,
        typer.Option("--png", rich_help_panel=options.ADVANCED, help="Write the camera picture to this file."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Show the true parameters of a world. For checks only: learning and tracking never read them.

    Example: adaptsim lab show --task scooping --world oreo --json
    """
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import console
    from adaptsim_cli.wiring import settings
    from sim.lab.simulated import SimulatedLab, truth_of
    from sim.lab.world import load_world
    from sim.panda.tool import cell_as_shipped
    from sim.tasks import get_task

    chosen = settings.load({"task": task, "world": world, "seed": seed}).config
    the_task = get_task(chosen.task)
    the_world = load_world(chosen.world, the_task)
    screen, session_world = console.Screen(as_json=as_json), chosen.lab_world
    if the_task.hardware is None:
        if png is not None:
            raise UsageError(f"--png: {the_task.name} has no lab scene, it runs in simulation only; leave --png out")
        _show(screen, the_task, session_world, truth_of(the_task, the_world))
    elif the_world.physics != "drake":
        if png is not None:
            the_world.require_lab()
        _show(screen, the_task, session_world, truth_of(the_task, the_world))
    else:
        lab = SimulatedLab(the_task, the_world, chosen.seed, cell_as_shipped(the_task.hardware, "panda"))
        _show(screen, the_task, session_world, lab.truth())
        if png is not None:
            import cv2

            from adaptsim_cli.storage import durable

            durable.replace_file(png, cv2.imencode(".png", lab.picture().colour[..., ::-1])[1].tobytes())
            screen.plain(f"Written: {png}")
    command = f"adaptsim run-iteration --task {chosen.task} --world {chosen.world} --seed {chosen.seed}"
    screen.next((command, "a session in this world; it never sees this table"))


def _show(screen: Screen, task: Task, world: str, truth: dict[str, Any]) -> None:
    from adaptsim_cli.config import load
    from adaptsim_cli.screen import views
    from adaptsim_cli.session import truth_view
    from adaptsim_cli.wiring.hindsight import Reports
    from adaptsim_cli.wiring.truth import newest_in

    spaces = (task.parameters, task.nuisance)
    store = newest_in(load().places.sessions, task.name, world)
    revealed = None if store is None else Reports().truth(store)
    units = {d.name: d.unit for space in spaces for d in space.dimensions}
    if screen.data("lab show", truth | {"units": units, "revealed": revealed}):
        return
    screen.plain(f"{truth['world']}: {truth['description']}")
    if task.hardware is not None and truth["physics"] != "drake":
        screen.plain(f"Its physics is {truth['physics']}: trials run without arm or camera.")
    groups = ("parameters", "nuisance", "unmodelled", "sensing", "mount", "faults")
    named = {
        group: {d.name: (d.label, d.plain) for d in space.dimensions}
        for group, space in (("parameters", task.parameters), ("nuisance", task.nuisance))
    }
    body = [
        (group, label, str(value), plain)
        for group in groups
        for name, value in truth.get(group, {}).items()
        for label, plain in (named.get(group, {}).get(name, (name, "")),)
    ]
    rows = truth.get("X_BC", [])
    body += [("camera", f"X_BC row {i}", "  ".join(f"{v:8.4f}" for v in row), "") for i, row in enumerate(rows)]
    screen.show(views.rows(("", "name", "value", "plain name"), body))
    if revealed is not None:
        screen.show(truth_view.table(revealed))
        screen.plain(f"Found by session {revealed.session}, the newest in this world.")


@app.command("list")
def list_all(task: options.Task = None, as_json: options.Json = False) -> None:
    """List the worlds of a task, and explain its parameters, contexts and actions.

    Example: adaptsim lab list --task scooping
    """
    from adaptsim_cli import config
    from adaptsim_cli.screen import console, views
    from sim.lab.world import list_worlds, load_world
    from sim.tasks import get_task

    the_task = get_task(config.load({"task": task}).config.task)
    worlds = [load_world(name, the_task) for name in list_worlds(the_task)]
    screen = console.Screen(as_json=as_json)
    rows = [{"name": w.name, "task": w.task, "description": w.description, "physics": w.physics} for w in worlds]
    spaces = (the_task.parameters, the_task.context, the_task.action, the_task.nuisance)
    words = [
        {"name": d.name, "plain_name": d.plain, "unit": d.unit, "meaning": d.meaning, "low": d.low, "high": d.high}
        for space in spaces
        for d in space.dimensions
    ]
    if not screen.data("lab list", {"worlds": rows, "quantities": words}):
        body = [(w.name, w.physics, w.description) for w in worlds]
        screen.show(views.rows(("world", "physics", "what it is"), body))
        screen.show(views.meanings(*spaces))
        screen.next((f"adaptsim run-iteration --task {the_task.name} --world NAME", "a session in one of these worlds"))
