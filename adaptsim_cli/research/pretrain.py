"""`adaptsim pretrain`: Phase 1."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli import options


def pretrain(
    task: options.Task = None,
    budget: Annotated[str, typer.Option("--budget", help="Size of the whole pretraining: full or small.")] = "full",
    rollouts: Annotated[
        int | None,
        typer.Option("--rollouts", rich_help_panel=options.ADVANCED, min=64, help="Simulated trials in the dataset."),
    ] = None,
    denser: Annotated[
        int | None,
        typer.Option(
            "--denser", rich_help_panel=options.ADVANCED, min=0, help="Further trials where the outcome is uncertain."
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(
            "--episodes",
            rich_help_panel=options.ADVANCED,
            min=64,
            help="Episodes from which each adaptation policy learns.",
        ),
    ] = None,
    judged: Annotated[
        int | None,
        typer.Option(
            "--judged", rich_help_panel=options.ADVANCED, min=4, help="Unseen targets on which the result is evaluated."
        ),
    ] = None,
    solver: Annotated[
        str | None,
        typer.Option("--solver", help="emulator (default), or naf: the paper's solver, on true rollouts alone."),
    ] = None,
    targets: Annotated[
        str, typer.Option("--targets", help="Where they are drawn: paper (in the ranges) or wide (beyond them too).")
    ] = "paper",
    own: options.Object = None,
    seed: options.Seed = None,
    workers: options.Workers = None,
    scheduler: options.Scheduler = "",
    share: options.ShareOfWork = "",
    out: options.WorkingFolder = None,
    methods: Annotated[
        bool, typer.Option("--methods", help="Train the paper's adaptation policies too, and their variants.")
    ] = False,
    evaluate: Annotated[
        bool, typer.Option("--evaluate", help="Judge sessions of the methods on unseen targets, by true rollouts.")
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Phase 1: simulate a dataset, fit the emulator, tabulate the prospects, write a checkpoint.

    The method adaptsim needs no more. --methods adds the paper's adaptation policies, --evaluate judges all methods;
    both take longer than all the rest. Add them whenever you like: finished stages are not repeated.

    Stop it at any time: the same command continues. Use the checkpoint with the setting `checkpoint`.

    --share K/N simulates a part of the dataset: first its even part, and run once more the denser one.

    With --targets wide the targets to learn from and to be judged on may lie beyond the paper's ranges.

    Example: adaptsim pretrain --task scooping --budget small
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.research.working import share_of, show_share, simulations
    from adaptsim_cli.screen import console
    from sim.research.pretraining.budget import Wanted

    if episodes is not None and not methods:
        raise UsageError("--episodes sets how much the adaptation policies learn from: add --methods")
    if judged is not None and not evaluate:
        raise UsageError("--judged sets on how many targets the methods are judged: add --evaluate")
    resolved = config.load({"task": task, "seed": seed, "workers": workers, "solver": solver, "object": own})
    screen = console.Screen(as_json=as_json)
    part = share_of(share, as_json=as_json)
    sizes = pretraining.RequestedSizes(rollouts, denser, episodes, judged)
    request = pretraining.checked(resolved, out, budget, targets, sizes)
    if part is not None:
        with screen.progress() as progress, simulations(resolved.config, workers, scheduler) as crew:
            complete = pretraining.pretrain_share(request, part, crew, progress)
        if complete:
            show_share(screen, part, "its part of the dataset", request.folder)
        else:
            screen.plain(f"Share {part} of the even part is complete in {request.folder}")
            screen.plain("Once all shares are, the same command simulates this share of the denser part.")
        return
    with screen.progress() as progress, simulations(resolved.config, workers, scheduler) as crew:
        stages = Wanted(policies=methods, evaluation=evaluate)
        folder = pretraining.pretrain(request, crew, progress, stages)
    screen.plain(f"Checkpoint: {folder}")
    chosen = resolved.config
    whose = f" --object {chosen.object}" if chosen.object else ""
    use = f"ADAPTSIM_CHECKPOINT={folder} adaptsim run-iteration --task {chosen.task}{whose}"
    screen.next(
        (use, "a session with it"), (f"adaptsim checkpoints verify {folder}", "are the figures on its card right?")
    )
    card = pretraining.checkpoint_card(resolved.config.task, folder)
    screen.data("pretrain", {"checkpoint": str(folder), "card": card})
