"""`adaptsim checkpoints list/verify`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from adaptsim_cli.commands import options
from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

if TYPE_CHECKING:
    from adaptsim_cli.config import Resolved
    from adaptsim_cli.screen.console import Screen
    from sim.adaptation.trials_forecast import SessionShare

app = typer.Typer(help="The pretrained policies.", no_args_is_help=True)

_Folder = Annotated[str, typer.Argument(help="Name or folder; default: the shipped one, or the one for --object.")]


@app.command("list")
@command()
def list_checkpoints() -> Reply:
    """List the shipped checkpoints and those of `adaptsim pretrain`.

    Example: adaptsim checkpoints list
    """
    from adaptsim_cli.bench import checkpoints
    from adaptsim_cli.screen import views

    rows = checkpoints.list_checkpoints()
    body = [(c["task"], c["name"], c["created"], c["folder"]) for c in rows]
    table = views.rows(("task", "name", "created", "folder"), body)
    verified = ("adaptsim checkpoints verify FOLDER --task TASK", "are the figures on its card still right?")
    return Reply({"checkpoints": rows}, [table], [verified])


@app.command()
@command("task", "object", "seed", "workers", checkpoint=_Folder)
def verify(
    screen: Screen,
    resolved: Resolved,
    rollouts: Annotated[
        int | None,
        options.advanced("--rollouts", "True rollouts to compare with; 0: only read the files.", min=0),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer rollouts: some ten seconds instead of half a minute.")
    ] = False,
) -> Reply:
    """Check every file of a checkpoint against its card, then the card's figures against fresh rollouts.

    A figure holds unless it is worse than the card's by more than three standard errors of the two together. Exit code
    8 when a figure does not hold, or when the checkpoint is corrupt or foreign.

    Example: adaptsim checkpoints verify --task scooping
    """
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.screen import views
    from sim.errors import CheckpointError

    if quick and rollouts is not None:
        raise UsageError("--quick and --rollouts contradict each other: give one of them")
    count = rollouts if rollouts is not None else pretraining.ROLLOUTS
    with screen.progress() as progress:
        result = pretraining.verify_figures(
            resolved.config,
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
    if result["holds"]:
        session = f"adaptsim run-iteration {resolved.config.same_task}"
        return Reply(result, next=[(session, "a session with it, if the settings name it")])
    worse = ", ".join(f["name"] for f in result["figures"] if not f["holds"])
    failure = CheckpointError(
        f"fresh rollouts are worse than the card of {result['folder']} says: {worse}. The simulation has changed "
        "since the checkpoint was made, or the card is wrong: try another --seed with more --rollouts, then "
        "`adaptsim pretrain` again"
    )
    return Reply(result, failure=failure)


@app.command()
@command("task", "object", "seed", checkpoint=_Folder)
def parameters(screen: Screen, resolved: Resolved) -> Reply:
    """Show which parameters a session can estimate, and which stay unknown. Measured in simulated sessions.

    Example: adaptsim checkpoints parameters --task pushing
    """
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.screen import views

    with screen.progress() as progress:
        result = pretraining.tell_parameters(resolved.config, lambda done, total: progress("sessions", done, total))
    body = [(p["title"], views.number(p["left"]), p["words"]) for p in result["parameters"]]
    table = views.rows(("parameter", "error left", ""), body, right=(1,))
    basis = f"{result['sessions']} simulated targets, {result['trials']} trials each. 1: trials say nothing about it."
    session = f"adaptsim run-iteration {resolved.config.same_task}"
    return Reply(result, [table, basis], [(session, "a session; the report says what its trials settled")])


@app.command()
@command("task", "object", "seed", checkpoint=_Folder)
def trials(
    screen: Screen,
    resolved: Resolved,
    again: Annotated[bool, typer.Option("--again", help="Play the imagined sessions again: some minutes.")] = False,
) -> Reply:
    """How many trials will a session need? It runs whole sessions in imagined worlds, before the first real trial.

    These worlds are drawn from the method's own prior: parameters of the ranges and their margin, and deviations that
    no parameter expresses. A pair is a trial and a control trial of UDR in the same place.

    Example: adaptsim checkpoints trials --task scooping
    """
    from adaptsim_cli.research import pretraining
    from adaptsim_cli.screen import views
    from sim.adaptation.trials_forecast import MOST_PAIRS

    with screen.progress() as progress:
        result = pretraining.tell_trials(
            resolved.config, anew=again, progress=lambda done, total: progress("imagined sessions", done, total)
        )
    forecast = result["forecast"]
    until = [
        ("an iteration has a success", "trial", forecast.trials, forecast.first_success),
        *((f"a gain of {one.difference:g} over UDR is shown", "pair", MOST_PAIRS, one) for one in forecast.shown),
    ]
    body = [(words, _at_most(one.half, unit, n), _at_most(one.four_of_five, unit, n)) for words, unit, n, one in until]
    table = views.rows(("until", "half of the sessions", "four of five"), body)
    basis = f"{forecast.sessions} imagined sessions of {forecast.trials} trials"
    first = (f"adaptsim run-iteration {resolved.config.same_task}", "the first trials")
    return Reply(result, [table, f"{basis}; in brackets, the share that need no more."], [first])


def _at_most(share: SessionShare, unit: str, limit: int) -> str:
    if share.most is None:
        return f"more than {limit} {unit}s ({100 * share.share:.0f} % by then)"
    return f"{share.most} {unit}{'s' * (share.most != 1)} ({100 * share.share:.0f} %)"


def _numbers(figure: dict[str, Any]) -> tuple[float, float, float]:
    return figure["card"], figure["found"], figure["tolerance"]
