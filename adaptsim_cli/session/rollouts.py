"""A rollout from its settings to its reply: the policy and its contexts, the parts, the trials, the printed result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import RenderableType

from adaptsim_cli.config import DIRECT, Config, Resolved, same_lab
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen import views
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.session import single
from adaptsim_cli.session.best import best_of
from adaptsim_cli.session.folders import solver_folder
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.single import Chosen
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import OpenParts, SessionParts
from adaptsim_cli.session.watching import Watcher
from sim.tasks import get_task

DrawPage = Callable[[SessionStore], Path]
"""session -> the file of its page, drawn."""

OpenRolloutView = Callable[[Screen, SessionParts, str, str, str], AbstractContextManager[Watcher]]
"""(screen, parts, name of the session, its description, hardware) -> a watcher besides the terminal."""


@dataclass(frozen=True)
class RolloutRequest:
    """The request of one command."""

    context: Sequence[str] = ()  # name=value, as the next two
    action: Sequence[str] = ()
    parameters: Sequence[str] = ()
    best_of: str | None = None  # name of a session; its best policy acts
    trials: int = 1  # more than one: at drawn contexts, by the best policy of a session
    out: Path | None = None  # a new folder
    yes: bool = False

    def __post_init__(self) -> None:
        if self.trials > 1 and (self.best_of is None or self.context or self.out):
            raise UsageError("--trials draws the contexts itself: adaptsim rollout --session NAME --best --trials 5")


def run(
    resolved: Resolved,
    request: RolloutRequest,
    open_parts: OpenParts,
    screen: Screen,
    draw: DrawPage,
    open_view: OpenRolloutView | None,
) -> Reply:
    """Run the trials and print them; the reply names the page. Raises the errors of trials."""
    settings, chosen = _policy(resolved, request)
    single.typed(get_task(settings.task), chosen)  # raises before anything is loaded or connected
    folder = request.out or resolved.places.sessions / f"rollout-{settings.task}-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}"
    folder = folder.absolute()
    with TemporaryDirectory() as learnt, ExitStack() as stack:
        place = Path(learnt)
        if settings.is_own:  # questions to an own robot lie beside the session
            place = solver_folder(folder)
        elif settings.solver == DIRECT and request.best_of:  # where the rollouts behind its policy are kept
            place = solver_folder(resolved.places.sessions / request.best_of)
        asking = None if settings.unattended(request.yes) else screen
        with screen.busy("Loading the task, the policies and the devices", "loading"):
            parts = stack.enter_context(open_parts(settings, place, screen=asking))
        screen.show(views.badge(settings.hw, parts.target.title))
        watcher = None
        if open_view is not None:
            about = f"rollout {folder.name}"
            watcher = stack.enter_context(open_view(screen, parts, folder.name, about, settings.hw))
        store = single.rollout(settings, parts, chosen, screen, folder, yes=request.yes, watcher=watcher)
    records = trials_of(store)
    for record in records:
        screen.data("rollout", single.rollout_output(store, record, chosen))
    screen.file("Stored", store.folder)
    with screen.busy("Drawing its page", "reporting"):
        page = draw(store)
    text: list[RenderableType] = [views.FileLine("Report", page)]
    if request.best_of is None:
        lab = same_lab(settings.task, settings.hw, settings.world)
        return Reply(text=text, next=[(f"adaptsim run-iteration {lab}", "adapts in about twenty such trials")])
    steps = [(f"adaptsim run-iteration --session {request.best_of}", "continues this session")]
    if len(records) > 1:
        mean = sum(record.reward for record in records) / len(records)
        best = f"the best policy of {request.best_of}"
        text.append(f"Measured: {len(records)} trials of {best}, mean reward {mean:.2f}")
        steps.insert(0, (f"adaptsim report {request.best_of}", "prediction and measurement side by side"))
    return Reply(text=text, next=steps)


def _policy(resolved: Resolved, request: RolloutRequest) -> tuple[Config, Chosen]:
    """The settings of the rollout, and its choices; a session that gives its best policy gives its settings too."""
    settings, session, changed = resolved.config, request.best_of, resolved.flags
    if session is None:
        return settings, Chosen([request.context], request.action, request.parameters)
    if request.parameters or "task" in changed:
        raise UsageError("--best takes task and parameters from the session: leave out --task and --param")
    best = best_of(SessionStore.open(resolved.places.sessions, session), settings)
    if best.config.recorded:
        raise UsageError(
            f"session {session} ran on recorded trials, and no trial can be added to these: see its report"
        )
    settings = best.config.model_copy(update={key: getattr(settings, key) for key in changed})
    contexts: Sequence[Sequence[str]] = [request.context]
    if request.trials > 1:
        contexts = single.drawn(get_task(settings.task), (settings.seed, len(best.history)), request.trials)
    return settings, Chosen(contexts, request.action, best.as_typed(), session, best.history)
