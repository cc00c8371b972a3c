"""`adaptsim rollout` and `adaptsim preview`: single trials, of which nothing is learnt."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from adaptsim_cli import options

if TYPE_CHECKING:
    from adaptsim_cli.screen.console import Screen
    from adaptsim_cli.session.single import Chosen
    from adaptsim_cli.session.store import SessionStore


def rollout(
    task: options.Task = None,
    context: options.Context = None,
    action: options.Action = None,
    param: Annotated[
        list[str] | None,
        typer.Option("--param", help="Parameter to train the policy for, as name=value, repeatable."),
    ] = None,
    world: options.World = None,
    seed: options.Seed = None,
    hw: options.Hw = None,
    answer_with: options.AnswerWith = None,
    answer_moves: options.AnswerMoves = None,
    session: Annotated[
        str | None,
        typer.Option(
            "--session",
            autocompletion=options.session_names,
            help="With --best: the session that gives policy, task and world.",
        ),
    ] = None,
    best: Annotated[bool, typer.Option("--best", help="The best policy of --session.")] = False,
    trials: Annotated[int, typer.Option("--trials", min=1, help="With --best: that many, at drawn contexts.")] = 1,
    out: Annotated[
        Path | None, typer.Option("--out", help="New folder for it; by default beside the sessions.")
    ] = None,
    realtime: options.Realtime = False,
    pace: options.Pace = None,
    operator: options.Operator = None,
    view: options.View = False,
    view_port: options.ViewPort = None,
    yes: options.Yes = False,
    as_json: options.Json = False,
) -> None:
    """Execute one trial with a chosen action, or with the action of a policy. Nothing is adapted.

    It is stored as a session without a learner, which `sessions` lists, shows and exports. The policy chooses the
    actions that are not given. `--session NAME --best` takes task, world and the best policy of a session. With
    `--trials 5` its reward is measured at five drawn contexts, and the session's report says so.

    Example: adaptsim rollout --task scooping --action pitch_rate=0.1 --world wd --yes
    """
    from contextlib import ExitStack
    from datetime import UTC, datetime
    from tempfile import TemporaryDirectory

    from adaptsim_cli.config import same_lab
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import console, views
    from adaptsim_cli.session import single
    from adaptsim_cli.session.store import SessionStore
    from adaptsim_cli.view.live import live_view
    from adaptsim_cli.wiring import session as wiring
    from adaptsim_cli.wiring.best import best_of
    from adaptsim_cli.wiring.settings import load
    from sim.adaptation.method import Iteration
    from sim.tasks import get_task

    named = {"world": world, "seed": seed, "hw": hw, "pace": pace, "operator": operator}
    answers = {"answer_with": answer_with, "answer_moves": answer_moves}
    resolved = load({"task": task, "realtime": realtime or None, **named, **answers})
    screen = console.Screen(as_json=as_json)
    settings, history = resolved.config, tuple[Iteration, ...]()
    _require_together(best == (session is not None), trials == 1 or not (session is None or context or out))
    if session is not None:
        if param or task:
            raise UsageError("--best takes task and parameters from the session: leave out --task and --param")
        policy = best_of(SessionStore.open(resolved.places.sessions, session), settings)
        if policy.config.recorded:
            raise UsageError(f"session {session} ran on recorded trials, to which none is added: see its report")
        param, settings, history = policy.as_typed(), policy.config, policy.history
        changed = {key: getattr(resolved.config, key) for key in named if named[key] is not None}
        settings = settings.model_copy(update=changed)
    task_meant = get_task(settings.task)
    contexts = [context or []] if trials == 1 else single.drawn(task_meant, (settings.seed, len(history)), trials)
    chosen = single.Chosen(contexts, action or [], param or [], session, history)
    single.typed(task_meant, chosen)  # raises before anything is loaded or connected
    folder = out or resolved.places.sessions / f"rollout-{settings.task}-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
    with TemporaryDirectory() as learnt, ExitStack() as stack:
        with screen.busy("Loading the task, the policies and the devices", "loading"):
            parts = stack.enter_context(
                wiring.open_parts(
                    settings,
                    folder.absolute() / "naf"
                    if settings.is_own
                    else Path(learnt),  # a session's questions lie beside it
                    screen=None if settings.unattended(yes) else screen,
                )
            )
        screen.show(views.badge(settings.hw, parts.target.title))
        watcher = None
        if view or view_port is not None:
            what = f"rollout {folder.name}"
            watcher = stack.enter_context(live_view(screen, parts, folder.name, what, settings.hw, view_port))
        store = single.rollout(settings, parts, chosen, screen, folder.absolute(), yes=yes, watcher=watcher)
    rewards = _print(screen, store, chosen)
    lab = same_lab(settings.task, settings.hw, settings.world)
    if session is None:
        screen.next((f"adaptsim run-iteration {lab}", "adapts in about twenty such trials"))
    else:
        _measured(screen, session, rewards)


def _require_together(best_of_session: bool, trials_alone: bool) -> None:
    from adaptsim_cli.errors import UsageError

    if not best_of_session:
        raise UsageError("--session and --best go together: adaptsim rollout --session NAME --best")
    if not trials_alone:
        raise UsageError("--trials draws the contexts itself: adaptsim rollout --session NAME --best --trials 5")


def _print(screen: Screen, store: SessionStore, chosen: Chosen) -> list[float]:
    """Print the trials of a rollout, and draw its page; returns their rewards."""
    from adaptsim_cli.report.page import write
    from adaptsim_cli.session import single
    from adaptsim_cli.session.history import trials_of

    records = trials_of(store)
    for record in records:
        screen.data("rollout", single.shown(store, record, chosen))
    screen.plain(f"Stored: {store.folder}")
    with screen.busy("Drawing its page", "reporting"):
        page = write(store)
    screen.plain(f"Report: {page}")
    return [record.reward for record in records]


def _measured(screen: Screen, session: str, rewards: list[float]) -> None:
    """Print what the best policy of a session has earned, and what comes next."""
    page: tuple[tuple[str, str], ...] = ()
    if len(rewards) > 1:
        mean = sum(rewards) / len(rewards)
        screen.plain(f"Measured: {len(rewards)} trials of the best policy of {session}, mean reward {mean:.2f}")
        page = ((f"adaptsim report {session}", "prediction and measurement side by side"),)
    screen.next(*page, (f"adaptsim run-iteration --session {session}", "continues this session"))


def preview(
    task: options.Task = None,
    arm: Annotated[str | None, typer.Option("--arm", help="Arm with its factory limits: panda or fr3.")] = None,
    hw: Annotated[str | None, typer.Option("--hw", help="Plan for the lab of the rig file: panda or fr3.")] = None,
    context: options.Context = None,
    action: options.Action = None,
    html: Annotated[
        Path | None, typer.Option("--html", help="Write the page to this file instead of serving it.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The limit table on stdout; no page is served.")] = False,
) -> None:
    """Plan one motion, show how close it comes to each limit, and play it in the browser. Nothing moves.

    A value that is not given is the middle of its range. With --hw, tool, table and boxes come from the rig file.

    Example: adaptsim preview --task scooping --action pitch_rate=0.1 --context y=0.02
    """
    from adaptsim_cli import config
    from adaptsim_cli.config import SIMULATED
    from adaptsim_cli.screen import console, keys, views
    from adaptsim_cli.wiring import motion

    resolved = config.load({"task": task, "hw": hw})
    screen = console.Screen(as_json=as_json)
    with screen.busy("Planning the motion"):
        planned = motion.planned(motion.mounted_for(resolved, arm), context or [], action or [])
    if not screen.data("preview", planned.as_json()):
        screen.show(views.badge(SIMULATED, "a preview"))
        screen.show(planned.table())
    if html is not None:
        from adaptsim_cli.storage import durable

        durable.replace_file(html, planned.page().html().encode())
        screen.plain(f"Written: {html}")
        screen.next(planned.next_step(resolved.config))
    elif not as_json:
        page = planned.page()
        screen.plain(f"The motion plays at {page.url}")
        close = keys.enter("to close the page", "The page ends, and so does the command."), keys.stop("The same.")
        screen.choose("Look at it in a browser.", *close)
        screen.next(planned.next_step(resolved.config))
