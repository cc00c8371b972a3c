"""`adaptsim benchmark`: methods compared in worlds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen


@command("task", "object", "recorded", "held_out", "workers")
def benchmark(
    screen: Screen,
    resolved: Resolved,
    targets: Annotated[
        str,
        typer.Option(
            "--targets",
            help="Worlds: names, files, or the sets develop, drawn, named and sealed.",
            show_default="wd and ood-1 to ood-4, or all worlds of a task without these",
        ),
    ] = "",
    methods: Annotated[
        str, typer.Option("--methods", help="Names of methods and baselines, or all; NAME@omega, NAME@margin.")
    ] = "all",
    budget: Annotated[int, typer.Option("--budget", min=1, help="Real trials of a session.")] = 20,
    fresh: Annotated[
        int, typer.Option("--fresh", min=0, help="Simulate trials, and score by N rollouts; 0: look them up in tables.")
    ] = 0,
    lab: Annotated[
        bool, typer.Option("--lab", help="Run every trial through the whole simulated lab: arm, camera and tracking.")
    ] = False,
    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds", min=1, help="Sessions of each method in each world.", show_default="10; 1 if no method draws"
        ),
    ] = None,
    checkpoints: Annotated[
        str, typer.Option("--checkpoints", help="One per training seed, by name or folder; used in turn.")
    ] = "",
    scheduler: options.Scheduler = "",
    share: options.ShareOfWork = "",
    out: options.WorkingFolder = None,
) -> Reply:
    """Compare methods: the same worlds, contexts, noise and budget of real trials for all, scored by fresh rollouts.

    Stop it at any time: the same command continues. Further methods or worlds are added to the results.

    The worlds of a contact task need tables of true rollouts: adaptsim world-tables makes them. The set drawn is for
    results that are reported; develop with develop. oracle (the best E) and best-action are limits, not methods.

    sealed are worlds of a fresh seed, opened by one version of the code; sealed-20 are the first twenty.

    With --recorded, each seed takes one part of recorded trials and scores by the other; permuted, a control with
    shuffled outcomes, must earn what permuted-udr earns.

    With --object, methods use the checkpoint of your object; the worlds stay the same.

    Example: adaptsim benchmark --task pendulum --targets wd --budget 6 --seeds 2
    """
    from adaptsim_cli.research import benchmark_page as page
    from adaptsim_cli.research import benchmarking
    from adaptsim_cli.research.working import complete, share_of, simulations

    request = benchmarking.request_of(resolved, targets, methods, budget, fresh, seeds, checkpoints, out, in_lab=lab)
    for name, why in request.left_out:
        screen.note(f"{name} is left out: {why}")
    part = share_of(share, screen)
    with screen.progress() as progress, simulations(resolved, scheduler, screen) as crew:
        result = benchmarking.benchmark(request, crew, progress, part)
    if part is not None:
        return complete(part, f"{len(result.rows)} sessions", request.folder)
    document = page.write(result)
    screen.print([*page.tables(result.summaries), *page.strata_tables(result.strata)])
    screen.file("Report", document)
    more = (f"xdg-open {document}", "the page, in the browser; the same command with more methods adds to it")
    return Reply(result.as_json(), next=[more])


@command("task", "workers")
def world_tables(
    screen: Screen,
    resolved: Resolved,
    targets: Annotated[
        str, typer.Option("--targets", help="Worlds: names, files, or the sets develop, drawn, named and sealed.")
    ] = "develop,drawn,named",
    rollouts: Annotated[int, options.advanced("--rollouts", "True rollouts of each world.", min=8)] = 320,
    scheduler: options.Scheduler = "",
    share: options.ShareOfWork = "",
) -> Reply:
    """Simulate the tables in which a benchmark looks up its trials: about a minute of one core a world.

    Stop it at any time: the same command continues. Damaged files of a table are made again.

    Example: adaptsim world-tables --task pushing --targets wd
    """
    from adaptsim_cli.research.working import complete, share_of, simulations
    from adaptsim_cli.research.world_tables import make_tables, make_tables_share, tables_folder

    part, task = share_of(share, screen), resolved.config.task
    with screen.progress() as progress, simulations(resolved, scheduler, screen) as crew:
        if part is not None:
            files = make_tables_share(resolved, targets, rollouts, part, crew, progress)
            return complete(part, f"{files} files of tables", tables_folder(resolved))
        tables = make_tables(resolved, targets, rollouts, crew, progress)
    screen.plain(f"Tables of {task} for {len(tables)} world{'s' * (len(tables) != 1)}: {tables_folder(resolved)}")
    step = (f"adaptsim benchmark --task {task} --targets {targets}", "compares methods in these worlds")
    return Reply({"task": task, "tables": tables}, next=[step])
