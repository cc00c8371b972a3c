"""`adaptsim checkpoints list/verify`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli import options

if TYPE_CHECKING:
    from sim.adaptation.trials_forecast import SessionShare

app = typer.Typer(help="The pretrained policies.", no_args_is_help=True)


@app.command("list")
def list_checkpoints(as_json: options.Json = False) -> None:
    """List the shipped checkpoints and those of `adaptsim pretrain`.

    Example: adaptsim checkpoints list
    """
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.wiring import settings as wiring

    rows = wiring.list_checkpoints()
    screen = console.Screen(as_json=as_json)
    if not screen.data("checkpoints list", {"checkpoints": rows}):
        body = [(c["task"], c["name"], c["created"], c["folder"]) for c in rows]
        screen.show(views.rows(("task", "name", "created", "folder"), body))
        screen.next(("adaptsim checkpoints verify FOLDER", "are the figures on its card still right?"))


@app.command()
def verify(
    checkpoint: Annotated[str, typer.Argument(help="Folder; default: the shipped one, or the one for --object.")] = "",
    task: options.Task = None,
    own: options.Object = None,
    rollouts: Annotated[
        int | None,
        typer.Option(
            "--rollouts",
            rich_help_panel=options.ADVANCED,
            min=0,
            help="True rollouts to compare with; 0: only read the files.",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer rollouts: some ten seconds instead of half a minute.")
    ] = False,
    seed: options.Seed = None,
    workers: options.Workers = None,
    as_json: options.Json = False,
) -> None:
    """Check every file of a checkpoint against its card, then the card's figures against fresh rollouts.

    A figure holds unless it is worse than the card's by more than three standard errors of the two together. Exit code
    8 when a figure does not hold, or when the checkpoint is corrupt or foreign.

    Example: adaptsim checkpoints verify --task scooping
    """
    from adaptsim_cli import config
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.screen import console, views
    from sim.errors import CheckpointError

    if quick and rollouts is not None:
        raise UsageError("--quick and --rollouts contradict each other: give one of them")
    flags = {"task": task, "checkpoint": checkpoint or None, "object": own, "seed": seed, "workers": workers}
    settings = config.load(flags).config
    count = rollouts if rollouts is not None else pretraining.ROLLOUTS
    screen = console.Screen(as_json=as_json)
    with screen.progress() as progress:
        result = pretraining.verify_figures(
            settings,
            pretraining.QUICK if quick else count,
            lambda done, total: progress("rollouts", done, total),
        )
    screen.plain(f"{result['folder']} is intact: task {result['task']}, sha256 {result['sha256'][:12]}")
    if result["figures"]:
        columns = ("", "figure", "card", "now", "may be worse by")
        body = [
            ("\N{CHECK MARK}" if f["holds"] else "\N{BALLOT X}", f["name"], *map(views.number, _numbers(f)))
            for f in result["figures"]
        ]
        screen.show(views.rows(columns, body))
    elif count:
        screen.note("Every session trains its own task policies, so the card has no figures to compare with rollouts.")
    screen.data("checkpoints verify", result)
    if result["holds"]:
        screen.next((f"adaptsim run-iteration --task {result['task']}", "a session with it, if the settings name it"))
    else:
        worse = ", ".join(f["name"] for f in result["figures"] if not f["holds"])
        raise CheckpointError(
            f"fresh rollouts are worse than the card of {result['folder']} says: {worse}. The simulation has changed "
            "since the checkpoint was made, or the card is wrong: try another --seed with more --rollouts, then "
            "`adaptsim pretrain` again"
        )


@app.command()
def parameters(
    checkpoint: Annotated[str, typer.Argument(help="Name or folder; default: the shipped one.")] = "",
    task: options.Task = None,
    own: options.Object = None,
    seed: options.Seed = None,
    as_json: options.Json = False,
) -> None:
    """Show which parameters a session can estimate, and which stay unknown. Measured in simulated sessions.

    Example: adaptsim checkpoints parameters --task pushing
    """
    from adaptsim_cli import config
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.screen import console, views

    settings = config.load({"task": task, "checkpoint": checkpoint or None, "object": own, "seed": seed}).config
    screen = console.Screen(as_json=as_json)
    with screen.progress() as progress:
        result = pretraining.tell_parameters(settings, lambda done, total: progress("sessions", done, total))
    if screen.data("checkpoints parameters", result):
        return
    body = [(p["title"], views.number(p["left"]), p["words"]) for p in result["parameters"]]
    screen.show(views.rows(("parameter", "error left", ""), body, right=(1,)))
    screen.plain(
        f"{result['sessions']} simulated targets, {result['trials']} trials each. 1: trials say nothing about it."
    )
    screen.next(
        (f"adaptsim run-iteration --task {settings.task}", "a session; the report says what its trials settled")
    )


@app.command()
def trials(
    checkpoint: Annotated[str, typer.Argument(help="Name or folder; default: the shipped one.")] = "",
    task: options.Task = None,
    own: options.Object = None,
    again: Annotated[bool, typer.Option("--again", help="Play the imagined sessions again: some minutes.")] = False,
    seed: options.Seed = None,
    as_json: options.Json = False,
) -> None:
    """How many trials will a session need? Whole sessions are played in imagined worlds, before the first real trial.

    The method itself holds an imagined world possible: parameters of the ranges and their margin, and deviations
    that no parameter expresses. A pair is a trial and a control trial of UDR in the same place.

    Example: adaptsim checkpoints trials --task scooping
    """
    from adaptsim_cli import config
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.screen import console, views
    from sim.adaptation.trials_forecast import MOST_PAIRS

    settings = config.load({"task": task, "checkpoint": checkpoint or None, "object": own, "seed": seed}).config
    screen = console.Screen(as_json=as_json)
    with screen.progress() as progress:
        result = pretraining.tell_trials(
            settings, anew=again, progress=lambda done, total: progress("imagined sessions", done, total)
        )
    if screen.data("checkpoints trials", result):
        return
    forecast = result["forecast"]
    until = [
        ("an iteration has a success", "trial", forecast.trials, forecast.first_success),
        ("the verdict says stop", "trial", forecast.trials, forecast.stop),
        *((f"a gain of {one.difference:g} over UDR is shown", "pair", MOST_PAIRS, one) for one in forecast.shown),
    ]
    body = [(words, _at_most(one.half, unit, n), _at_most(one.four_of_five, unit, n)) for words, unit, n, one in until]
    screen.show(views.rows(("until", "half of the sessions", "four of five"), body))
    screen.plain(
        f"{forecast.sessions} imagined sessions of {forecast.trials} trials; in brackets, the share that need no more."
    )
    screen.next((f"adaptsim run-iteration --task {settings.task}", "the first trials"))


def _at_most(share: SessionShare, unit: str, limit: int) -> str:
    if share.most is None:
        return f"more than {limit} {unit}s ({100 * share.share:.0f} % by then)"
    return f"{share.most} {unit}{'s' * (share.most != 1)} ({100 * share.share:.0f} %)"


def _numbers(figure: dict[str, Any]) -> tuple[float, float, float]:
    return figure["card"], figure["found"], figure["tolerance"]
