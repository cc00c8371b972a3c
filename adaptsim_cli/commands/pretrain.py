"""`adaptsim pretrain`: Phase 1."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def pretrain(
    task: Annotated[str | None, typer.Option("--task", help="Which task, e.g. scooping.")] = None,
    budget: Annotated[str, typer.Option("--budget", help="How much of everything: full or small.")] = "full",
    rollouts: Annotated[int | None, typer.Option("--rollouts", min=64, help="Simulated trials in the dataset.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Of all random numbers.")] = None,
    workers: Annotated[int | None, typer.Option("--workers", help="Processes; 0: one a core.")] = None,
    executor: Annotated[
        str, typer.Option("--executor", help="Where simulations run: processes or dask.")
    ] = "processes",
    scheduler: Annotated[str, typer.Option("--scheduler", help="Address of the Dask scheduler.")] = "",
    out: Annotated[Path | None, typer.Option("--out", help="Where to work; resumes what is there.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Folder and held-out results on stdout.")] = False,
) -> None:
    """Phase 1: simulate a dataset, fit the emulator, train the adaptation policy, write a checkpoint.

    Stop it at any time: the same command goes on. Use the checkpoint with the setting `checkpoint`.

    With --executor dask the simulations run on a cluster of yours; the numbers are the same.

    Example: adaptsim pretrain --task scooping --budget small
    """
    from adaptsim_cli import config, console, wiring

    resolved = config.load({"task": task, "seed": seed, "workers": workers})
    screen = console.Screen(as_json=as_json)
    with screen.progress() as progress, wiring.open_executor(resolved.config, executor, scheduler) as crew:
        folder = wiring.pretrain(resolved, out, budget, rollouts, crew, progress)
    screen.plain(f"Checkpoint: {folder}")
    screen.plain(f"Use it: adaptsim run-iteration, with ADAPTSIM_CHECKPOINT={folder}")
    if as_json:
        screen.data({"checkpoint": str(folder), "card": wiring.checkpoint_card(resolved.config.task, folder)})
