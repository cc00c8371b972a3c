"""`adaptsim benchmark`: methods compared in worlds."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli import options


def benchmark(
    task: options.Task = None,
    targets: Annotated[
        str, typer.Option("--targets", help="Worlds: names, files, or the sets develop, drawn and named.")
    ] = "wd,ood-1,ood-2,ood-3,ood-4",
    recorded: options.Recorded = None,
    held_out: options.HeldOut = None,
    methods: Annotated[str, typer.Option("--methods", help="Names of methods, or all.")] = "all",
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
    workers: options.Workers = None,
    scheduler: options.Scheduler = "",
    share: options.ShareOfWork = "",
    out: options.WorkingFolder = None,
    as_json: options.Json = False,
) -> None:
    """Compare methods: the same worlds, contexts, noise and budget of real trials for all, scored by fresh rollouts.

    Stop it at any time: the same command continues. Further methods or worlds are added to the results.

    The worlds of a contact task need tables of true rollouts: adaptsim world-tables makes them. The set drawn is for
    results that are reported; develop with develop. oracle (the best E) and best-action are limits, not methods.

    With --recorded, each seed takes one part of recorded trials and scores by the other; permuted, a control with
    shuffled outcomes, must earn what permuted-udr earns.

    Example: adaptsim benchmark --task pendulum --targets wd --budget 6 --seeds 2
    """
    from adaptsim_cli import config
    from adaptsim_cli.research import benchmark_page as page
    from adaptsim_cli.research import benchmarking as wiring
    from adaptsim_cli.research.working import share_of, show_share, simulations
    from adaptsim_cli.screen import console

    resolved = config.load({"task": task, "workers": workers, "recorded": recorded, "held_out": held_out})
    screen = console.Screen(as_json=as_json)
    request = wiring.request_of(resolved, targets, methods, budget, fresh, seeds, checkpoints, out, in_lab=lab)
    for name, why in request.left_out:
        screen.note(f"{name} is left out: {why}")
    part = share_of(share, as_json=as_json)
    with screen.progress() as progress, simulations(resolved.config, workers, scheduler) as crew:
        result = wiring.benchmark(request, crew, progress, part)
    if part is not None:
        show_share(screen, part, f"{len(result.rows)} sessions", request.folder)
        return
    document = page.write(result)
    for table in page.tables(result.summaries):
        screen.show(table)
    screen.plain(f"Report: {document}")
    screen.next((f"xdg-open {document}", "the page, in the browser; the same command with more methods adds to it"))
    screen.data("benchmark", result.as_json())


def world_tables(
    task: options.Task = None,
    targets: Annotated[
        str, typer.Option("--targets", help="Worlds: names, files, or the sets develop, drawn and named.")
    ] = "develop,drawn,named",
    rollouts: Annotated[
        int, typer.Option("--rollouts", rich_help_panel=options.ADVANCED, min=8, help="True rollouts of each world.")
    ] = 320,
    workers: options.Workers = None,
    scheduler: options.Scheduler = "",
    share: options.ShareOfWork = "",
    as_json: options.Json = False,
) -> None:
    """Simulate the tables in which a benchmark looks up its trials: about a minute of one core a world.

    Stop it at any time: the same command continues. Damaged files of a table are made again.

    Example: adaptsim world-tables --task pushing --targets wd
    """
    from adaptsim_cli import config
    from adaptsim_cli.research.working import share_of, show_share, simulations
    from adaptsim_cli.research.world_tables import make_tables, make_tables_share, tables_folder
    from adaptsim_cli.screen import console

    resolved = config.load({"task": task, "workers": workers})
    screen = console.Screen(as_json=as_json)
    part = share_of(share, as_json=as_json)
    if part is not None:
        with screen.progress() as progress, simulations(resolved.config, workers, scheduler) as crew:
            files = make_tables_share(resolved, targets, rollouts, part, crew, progress)
        show_share(screen, part, f"{files} files of tables", tables_folder(resolved))
        return
    with screen.progress() as progress, simulations(resolved.config, workers, scheduler) as crew:
        tables = make_tables(resolved, targets, rollouts, crew, progress)
    screen.plain(f"{len(tables)} tables of {resolved.config.task}: {tables_folder(resolved)}")
    command = f"adaptsim benchmark --task {resolved.config.task} --targets {targets}"
    screen.next((command, "compares methods in these worlds"))
    screen.data("world-tables", {"task": resolved.config.task, "tables": tables})
