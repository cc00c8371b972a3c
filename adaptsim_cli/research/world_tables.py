"""`adaptsim world-tables`: true rollouts of worlds, for `adaptsim benchmark`."""

from __future__ import annotations

from typing import Annotated

import typer


def world_tables(
    task: Annotated[str | None, typer.Option("--task", help="Which task, e.g. pushing.")] = None,
    targets: Annotated[
        str, typer.Option("--targets", help="Worlds: names, files, or the sets develop, drawn and named.")
    ] = "develop,drawn,named",
    rollouts: Annotated[int, typer.Option("--rollouts", min=8, help="True rollouts of each world.")] = 320,
    workers: Annotated[int | None, typer.Option("--workers", help="Number of processes; 0: one per core.")] = None,
    executor: Annotated[str, typer.Option("--executor", help="Where they run: processes or dask.")] = "processes",
    scheduler: Annotated[str, typer.Option("--scheduler", help="Address of the Dask scheduler.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="The tables on stdout.")] = False,
) -> None:
    """Simulate the tables in which a benchmark looks up its trials: about a minute of one core a world.

    Stop it at any time: the same command continues. Damaged files of a table are made again.

    Example: adaptsim world-tables --task pushing --targets wd
    """
    from adaptsim_cli import config
    from adaptsim_cli.research import benchmarking as wiring
    from adaptsim_cli.research.pretraining import open_executor
    from adaptsim_cli.screen import console

    resolved = config.load({"task": task, "workers": workers})
    screen = console.Screen(as_json=as_json)
    with screen.progress() as progress, open_executor(resolved.config, executor, scheduler) as crew:
        made = wiring.make_tables(resolved, targets, rollouts, crew, progress)
    screen.plain(f"{len(made)} tables of {resolved.config.task}: {wiring.tables_folder(resolved)}")
    command = f"adaptsim benchmark --task {resolved.config.task} --targets {targets}"
    screen.next((command, "compares methods in these worlds"))
    if as_json:
        screen.data("world-tables", {"task": resolved.config.task, "tables": made})
