"""From settings to a running session: begin or continue, check that everything is ready, run, report."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import RenderableType

from adaptsim_cli.config import DIRECT, Config, Resolved, is_own
from adaptsim_cli.errors import AnswerRefused, StoppedByOperator, UsageError
from adaptsim_cli.screen import console, views
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.continuing import how_to_continue
from adaptsim_cli.screen.keys import Key, agree
from adaptsim_cli.screen.reply import Reply
from adaptsim_cli.session import folders, terminal_views
from adaptsim_cli.session.advice import after_iteration, answering_flags, go_on_with
from adaptsim_cli.session.beginning import NO_CONSENT, begin
from adaptsim_cli.session.deferred import Deferred, submit
from adaptsim_cli.session.ending import EndRule, after_iterations, asked_at_the_verdict, at_the_verdict
from adaptsim_cli.session.flow import RunningSession, show, stages, update_watchers
from adaptsim_cli.session.history import results_of
from adaptsim_cli.session.operator import Attended, Operator, Unattended
from adaptsim_cli.session.own.trust import require_trusted
from adaptsim_cli.session.readiness import require_ready
from adaptsim_cli.session.records import ROLLOUT, SessionFacts
from adaptsim_cli.session.same_parts import same_parts
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.watching import AllOf, Watcher, logged
from hw.computer import return_pictures, usable_cores
from hw.plugins import did_you_mean
from sim.adaptation.stages import Show
from sim.errors import MomentsMissing
from sim.rollouts.run import Progress

OpenSessionParts = Callable[[Config, Path], AbstractContextManager[SessionParts]]
"""(settings, folder for a solver's policies) -> the connected parts."""

OpenView = Callable[[Screen, SessionStore, SessionParts], AbstractContextManager[Watcher]]
"""(screen, session, parts) -> a watcher besides the terminal."""

Ending = Callable[[SessionStore], RenderableType | None]
"""session -> the last text on the screen; None if there is none."""

_FROZEN = (
    *("task", "hw", "world", "recorded", "held_out", "start_from"),
    *("method", "control", "pairs", "solver", "object", "seed", "particles"),
)

SHOWN_S = 3.0
"""Rollouts that take longer have a progress bar."""


@dataclass(frozen=True)
class SessionRequest:
    """The operator's options on the command line."""

    session: str | None
    flag_keys: frozenset[str]  # settings that came as flags
    iterations: int | None = 1  # None: as many as the task's horizon
    yes: bool = False
    until_done: bool = False  # end where the verdict says stop
    rules: tuple[EndRule, ...] = ()  # further rules for its end


def terminal_alone(screen: Screen, store: SessionStore, parts: SessionParts) -> AbstractContextManager[Watcher]:
    """Adds no watcher besides the terminal."""
    return nullcontext(AllOf())


def run_session(
    resolved: Resolved,
    request: SessionRequest,
    open_parts: OpenSessionParts,
    draw: Callable[[SessionStore], Path],
    screen: Screen | None = None,
    open_view: OpenView = terminal_alone,
    ending: Ending | None = None,
) -> Reply:
    """Run the iterations; after each, `draw` makes the report in the background. JSON is printed as they end.

    It ends by the rules of the request, with a report of everything stored. The reply has the text of `ending` and the
    report.

    The last iteration is done only once its result and report have reached the operator; a run that was killed just
    before shows them after a restart. Raises any error that stops a session or a report, with the command to continue.
    """
    root = resolved.places.sessions
    requested_config = anywhere(resolved.config)
    name = _meant(root, requested_config, request)
    earlier = _session_named(root, name)
    if earlier is None and "task" not in request.flag_keys:
        near = did_you_mean(name, folders.names(root))
        raise UsageError(f"there is no session {name!r} in {root}; to begin one, name its task: add --task{near}")
    if earlier is not None and earlier.facts.method == ROLLOUT:
        raise UsageError(
            f"session {name!r} is a rollout: nothing adapts in it. To begin a session, give --task without --session"
        )
    config = _continued(requested_config, earlier, request) if earlier else requested_config
    if not request.yes:
        console.require_terminal(console.NO_TERMINAL if config.is_simulated else NO_CONSENT)
    screen = screen or Screen()
    _confirm_session(screen, request, resolved, earlier)
    with ExitStack() as stack:
        parts = _opened(open_parts, config, folders.folder_of(root, name), screen, stack, begun=earlier is not None)
        operator = _operator(config, parts, request, screen)
        store = same_parts(earlier, parts, screen) if earlier else begin(root, name, config, parts)
        watcher = stack.enter_context(open_view(screen, store, parts))
        stack.enter_context(store.locked())
        log = stack.enter_context(logged(store, screen, parts.provenance.versions))
        thread = stack.enter_context(ThreadPoolExecutor(max_workers=1, thread_name_prefix="beside"))
        if parts.task.hardware is not None:
            return_pictures()
            thread.submit(_import_for_a_film)
        session = RunningSession(store, parts, operator, screen, AllOf(watcher, log), thread)
        also = (AnswerRefused, MomentsMissing)
        answering = answering_flags(config) if "answer_with" in request.flag_keys else ""
        stack.enter_context(how_to_continue(f"Continue with: {go_on_with(name, answering)}", also=also))
        most = request.iterations or parts.task.adaptation.horizon
        verdict = at_the_verdict if request.until_done else asked_at_the_verdict(most)
        rules = (after_iterations(most), *request.rules, verdict)
        require_ready(session, config, most)
        update_watchers(session)
        report = None
        for stage in stages(session):
            if isinstance(stage, Show):
                summary = show(session, stage)
                report = _drawn_anew(session, draw, store.until(summary.iteration), report)
                screen.data("run-iteration", summary)
            if any(rule(session, stage) for rule in rules):
                break
        if report is None or not isinstance(stage, Show):  # it ends within an iteration
            report = _drawn_anew(session, draw, store, report)
        with screen.busy("Drawing the report", "reporting"):
            path = report.result()
        if isinstance(stage, Show):
            session.mark_shown(stage.iteration)
    words = None if ending is None else ending(store)
    results = results_of(store)
    return Reply(
        text=[*([] if words is None else [words]), views.FileLine("Report", path)],
        next=after_iteration(store.facts, results[-1], answering) if results else (),
    )


def _operator(config: Config, parts: SessionParts, request: SessionRequest, screen: Screen) -> Operator:
    """Who answers. Even with --yes, a person confirms the motions of a real robot. Raises UsageError."""
    if parts.target.needs_consent or not (config.is_simulated or config.is_own):
        console.require_terminal(NO_CONSENT)
        return Attended(screen)
    return Unattended(screen) if request.yes else Attended(screen)


def _import_for_a_film() -> None:
    """Import the slow modules that nothing needs before the first film, so that its track does not wait for them."""
    import scipy.signal  # noqa: F401

    from perception.raycasting import load_open3d

    load_open3d()


def _drawn_anew(
    session: RunningSession, draw: Callable[[SessionStore], Path], store: SessionStore, earlier: Deferred[Path] | None
) -> Deferred[Path]:
    """Draw a report of the iterations in `store`, instead of the `earlier` one; the session may have more by then."""
    if earlier is not None:
        earlier.drop()

    def report() -> Path:
        path = draw(store)
        session.watcher.reported(path)
        return path

    return submit(session.thread, report)


def _meant(root: Path, config: Config, request: SessionRequest) -> str:
    """The name of the session: the given one, else that of the settings with a task, else the newest.

    Raises UsageError if neither a task nor a session is named and there is none, or some other setting is given.
    """
    if request.session:
        return request.session
    if "task" in request.flag_keys:
        return default_name(config)
    if request.flag_keys.intersection(_FROZEN) or not folders.names(root):
        raise UsageError("which session? Name its task to begin or continue one, e.g. --task scooping, or a --session")
    return folders.newest(root, without=ROLLOUT)


def _confirm_session(screen: Screen, request: SessionRequest, resolved: Resolved, earlier: SessionStore | None) -> None:
    """Name the keys that a newer version wrote into an existing session. If a new session's name is like another's, ask
    whether a new one is meant. Ask whether a program that a file of the current folder names may run.

    Raises StoppedByOperator if not, UsageError if nobody can be asked about that program.
    """
    if is_own(resolved.config.hw if earlier is None else earlier.facts.hw):
        require_trusted(resolved, screen, yes=request.yes)
    if earlier is not None and (keys := earlier.additions()):
        screen.note(terminal_views.newer_note(earlier.facts.name, keys).plain)
    if earlier is not None or request.session is None:
        return
    name, root = request.session, resolved.places.sessions
    near = did_you_mean(name, folders.names(root))
    if not near or request.yes:
        return
    begin = agree("to begin it", f"A new session is begun in {root / name}.")
    leave = Key("", "to leave it", "The command ends. No session is begun.", is_way_out=True)
    if screen.choose(f"There is no session {name} yet{near}", begin, leave) != "y":
        raise StoppedByOperator("no session was begun")


def facts_of(resolved: Resolved, request: SessionRequest) -> SessionFacts:
    """The facts of the requested session. Raises UsageError if it does not exist yet."""
    config = anywhere(resolved.config)
    name = _meant(resolved.places.sessions, config, request)
    if (store := _session_named(resolved.places.sessions, name)) is None:
        raise UsageError(f"--own-calibration: there is no session {name!r} yet; a new one takes the calibration in use")
    return store.facts


def _together(config: Config) -> Config:
    """The settings, in which the direct solver and the direct method name each other. Raises UsageError."""
    if DIRECT not in (config.solver, config.method):
        return config
    usual = Config()
    for key, chosen, other in (("solver", config.solver, usual.solver), ("method", config.method, usual.method)):
        if chosen not in (DIRECT, other):
            raise UsageError(
                f"--{key} {chosen}: the direct solver and the direct method need each other. Leave --{key} out, or "
                "leave direct out"
            )
    for key in ("start_from", "recorded"):
        if getattr(config, key):
            raise UsageError(f"--{key.replace('_', '-')} rests on a checkpoint, and the direct solver has none")
    return config.model_copy(update={"solver": DIRECT, "method": DIRECT})


def default_name(config: Config) -> str:
    """The name of a session if none is given: task and world, and method and seed unless they are the defaults."""
    usual = Config()
    method = config.method if config.method != usual.method else ""
    seed = f"seed{config.seed}" if config.seed != usual.seed else ""
    solver = config.solver if config.solver != method else ""
    control = f"control-{config.control}" if config.control else ""
    parts = (config.task, Path(config.object).stem, config.target_name, method, control, solver, seed)
    return re.sub(r"[^A-Za-z0-9._-]", "-", "-".join(part for part in parts if part))


def absolute(named: str) -> str:
    """A file's absolute path, so that a session can be continued from another folder; other names unchanged."""
    is_file = named.endswith(".toml") or "/" in named
    return str(Path(named).expanduser().absolute()) if is_file else named


def anywhere(config: Config) -> Config:
    """The settings with absolute paths, and with a solver and a method that fit. Raises UsageError."""
    recorded = str(Path(config.recorded).expanduser().absolute()) if config.recorded else ""
    update = {"world": absolute(config.world), "object": absolute(config.object), "recorded": recorded}
    return _together(config.model_copy(update=update))


def _session_named(root: Path, name: str) -> SessionStore | None:
    return SessionStore.open(root, name) if folders.folder_of(root, name).is_dir() else None


def _continued(config: Config, store: SessionStore, request: SessionRequest) -> Config:
    """The settings that the session was begun with. Raises UsageError if a flag contradicts them."""
    for key in _FROZEN:
        was, value = getattr(store.facts, key), getattr(config, key)
        if key in request.flag_keys and was != value:
            raise UsageError(
                f"session {store.facts.name!r} was begun with {key} = {was}, not {value}; leave the flag out to "
                "continue it, or give another --session"
            )
    return settings_of(store, config)


def settings_of(store: SessionStore, config: Config) -> Config:
    """The settings that a session was begun with; settings that it does not freeze come from `config`."""
    facts = store.facts
    own = facts.checkpoint_folder if Path(facts.checkpoint_folder).is_dir() else ""
    begun_with = {key: getattr(facts, key) for key in _FROZEN}
    return config.model_copy(update={**begun_with, "checkpoint": config.checkpoint or own})


def _opened(
    open_parts: OpenSessionParts, config: Config, folder: Path, screen: Screen, stack: ExitStack, *, begun: bool
) -> SessionParts:
    """The connected parts of a session. If it was `begun`, its missing policies are trained; if it is new, the quality
    of its checkpoint is shown.
    """

    def opened() -> SessionParts:
        with screen.busy("Loading the task, the policies and the devices", "loading"):
            return stack.enter_context(open_parts(config, folders.solver_folder(folder)))

    parts = opened()
    if parts.rollouts is not None:
        parts.rollouts.progress = partial(
            _rollout_progress, screen, parts.rollouts.seconds, config.workers or usable_cores()
        )
    if not begun:
        for sentence in parts.worth:
            screen.plain(sentence)
    elif parts.train_policies is not None and parts.train_policies(screen):
        parts = opened()
    return parts


@contextmanager
def _rollout_progress(screen: Screen, seconds: float, processes: int, rollouts: int) -> Iterator[Progress]:
    """A bar for rollouts that take a while."""
    if rollouts * seconds / processes < SHOWN_S:
        yield lambda done, total: None
        return
    with screen.progress() as progress:
        yield lambda done, total: progress("rollouts", done, total)
