"""`adaptsim pretrain`: Phase 1."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen

_Solver = Annotated[
    str | None,
    typer.Option("--solver", help="emulator (default), or naf: the paper's solver, on true rollouts only."),
]


@command("task", "seed", "object", "workers", solver=_Solver)
def pretrain(
    screen: Screen,
    resolved: Resolved,
    budget: Annotated[str, typer.Option("--budget", help="Size of the whole pretraining: full or small.")] = "full",
    rollouts: Annotated[
        int | None,
        options.advanced("--rollouts", "Simulated trials in the dataset.", min=64),
    ] = None,
    denser: Annotated[
        int | None,
        options.advanced("--denser", "Further trials where the outcome is uncertain.", min=0),
    ] = None,
    episodes: Annotated[
        int | None,
        options.advanced("--episodes", "Episodes from which each adaptation policy learns.", min=64),
    ] = None,
    judged: Annotated[
        int | None,
        options.advanced("--judged", "Unseen targets on which the result is evaluated.", min=4),
    ] = None,
    targets: Annotated[
        str, typer.Option("--targets", help="Where they are drawn: paper (in the ranges) or wide (beyond them too).")
    ] = "paper",
    scheduler: options.Scheduler = "",
    share: options.ShareOfWork = "",
    out: options.WorkingFolder = None,
    methods: Annotated[
        bool, typer.Option("--methods", help="Train the paper's adaptation policies too, and their variants.")
    ] = False,
    evaluate: Annotated[
        bool, typer.Option("--evaluate", help="Score sessions of the methods on unseen targets, by true rollouts.")
    ] = False,
) -> Reply:
    """Phase 1: simulate a dataset, fit the emulator, tabulate the rewards, write a checkpoint.

    The method adaptsim needs nothing else. --methods adds the paper's adaptation policies, and --evaluate scores all
    methods; both take longer than all the rest. Add them whenever you like: finished stages are not repeated.

    Stop it at any time: the same command continues. Use the checkpoint with the setting `checkpoint`.

    --share K/N simulates a part of the dataset: first its even part, and run once more the denser one. Of a task that
    trains its policies, it first trains a part of these, and run once more it simulates a part of the grid.

    With --targets wide, the targets for learning and for scores may lie beyond the paper's ranges.

    Example: adaptsim pretrain --task scooping --budget small
    """
    from adaptsim_cli.bench.checkpoints import task_of, usual_checkpoint
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.research.working import complete, share_of, simulations
    from sim.adaptation.worth_in_words import worth_in_words
    from sim.research.pretraining.budget import OptionalStages

    if episodes is not None and not methods:
        raise UsageError("--episodes sets how much the adaptation policies learn from: add --methods")
    if judged is not None and not evaluate:
        raise UsageError("--judged sets the number of targets on which the methods are scored: add --evaluate")
    part = share_of(share, screen)
    sizes = pretraining.RequestedSizes(rollouts, denser, episodes, judged)
    request = pretraining.checked(resolved, out, budget, targets, sizes)
    with screen.progress() as progress, simulations(resolved, scheduler, screen) as crew:
        if part is not None:
            if pretraining.pretrain_share(request, part, crew, progress):
                return complete(part, "its part of the rollouts", request.folder)
            first = f"Share {part} of the first part is complete in {request.folder}"
            return Reply(
                text=[first, "Once all shares are complete, the same command simulates this share of the second part."]
            )
        stages = OptionalStages(policies=methods, evaluation=evaluate)
        folder = pretraining.pretrain(request, crew, progress, stages)
    screen.plain(f"Checkpoint: {folder}")
    card = pretraining.checkpoint_card(resolved.config.task, folder)
    for sentence in worth_in_words(card.get("worth")):
        screen.plain(sentence)
    chosen = resolved.config
    usual = not chosen.object and usual_checkpoint(task_of(chosen)) == str(folder)
    setting = "" if usual else f"ADAPTSIM_CHECKPOINT={folder} "
    steps = [
        (f"{setting}adaptsim run-iteration {chosen.same_task}", "a session with it"),
        (f"adaptsim checkpoints verify {folder} {chosen.same_task}", "are the figures on its card right?"),
    ]
    data = {"checkpoint": str(folder), "card": card}
    return Reply(data, next=steps)
