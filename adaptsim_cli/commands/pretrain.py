"""`adaptsim pretrain`: Phase 1."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def pretrain(
    task: Annotated[str | None, typer.Option("--task", help="Which task, e.g. scooping.")] = None,
    budget: Annotated[str, typer.Option("--budget", help="Size of the whole pretraining: full or small.")] = "full",
    rollouts: Annotated[int | None, typer.Option("--rollouts", min=64, help="Simulated trials in the dataset.")] = None,
    denser: Annotated[
        int | None, typer.Option("--denser", min=0, help="Further trials where the outcome is uncertain.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--steps", min=64, help="Adaptation steps from which the Q-policy learns.")
    ] = None,
    judged: Annotated[int | None, typer.Option("--judged", min=4, help="Unseen targets that judge the result.")] = None,
    solver: Annotated[
        str | None, typer.Option("--solver", help="emulator (default), or naf: the paper's, on true rollouts alone.")
    ] = None,
    targets: Annotated[
        str, typer.Option("--targets", help="Where they are drawn: paper (in the ranges) or wide (beyond them too).")
    ] = "paper",
    own: Annotated[str | None, typer.Option("--object", help="TOML file with the ranges of an own object.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")] = None,
    workers: Annotated[int | None, typer.Option("--workers", help="Number of processes; 0: one per core.")] = None,
    executor: Annotated[
        str, typer.Option("--executor", help="Where simulations run: processes or dask.")
    ] = "processes",
    scheduler: Annotated[str, typer.Option("--scheduler", help="Address of the Dask scheduler.")] = "",
    out: Annotated[
        Path | None, typer.Option("--out", help="Working folder; an unfinished run there continues.")
    ] = None,
    report: Annotated[
        bool, typer.Option("--report", help="Evaluate on true rollouts: a document with figures.")
    ] = False,
    docs: Annotated[Path | None, typer.Option("--docs", help="Where the report goes; default: in its folder.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Folder and held-out results on stdout.")] = False,
) -> None:
    """Phase 1: simulate a dataset, fit the emulator, train the adaptation policy, write a checkpoint.

    Stop it at any time: the same command continues. Use the checkpoint with the setting `checkpoint`.

    With --targets wide it learns from, and is judged on, targets that may lie beyond the ranges of the paper.

    With --executor dask the simulations run on a cluster of yours; the numbers are the same.

    With --report some 3,600 further rollouts (minutes) tell what emulator and policies are worth; a second report
    needs none. A finished folder given with --out is reported on as it is.

    Example: adaptsim pretrain --task scooping --budget small --report
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import console
    from adaptsim_cli.wiring import checkpoints, pretraining, verification

    if docs is not None and not report:
        raise UsageError("--docs says where the report goes: add --report")
    resolved = config.load({"task": task, "seed": seed, "workers": workers, "solver": solver, "object": own})
    screen = console.Screen(as_json=as_json)
    with screen.progress() as progress, pretraining.open_executor(resolved.config, executor, scheduler) as crew:
        if report and out is not None and verification.is_finished(out):
            folder = out / "checkpoint"
        else:
            folder = pretraining.pretrain(
                resolved, out, budget, targets, pretraining.Sizes(rollouts, denser, steps, judged), crew, progress
            )
        document = None
        if report:
            of = checkpoints.task_of(resolved.config)
            document = verification.write_report(of, folder.parent, docs, crew, progress)
    screen.plain(f"Checkpoint: {folder}")
    chosen = resolved.config
    whose = f" --object {chosen.object}" if chosen.object else ""
    screen.plain(f"Use it: adaptsim run-iteration --task {chosen.task}{whose}, with ADAPTSIM_CHECKPOINT={folder}")
    if document is not None:
        screen.plain(f"Report: {document}")
    if as_json:
        told = {"report": str(document)} if document else {}
        screen.data(
            {**told, "checkpoint": str(folder), "card": checkpoints.checkpoint_card(resolved.config.task, folder)}
        )
