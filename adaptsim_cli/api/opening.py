"""Tasks, worlds and sessions by name; rollouts and benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from adaptsim_cli import config
from adaptsim_cli.api.sessions import Session
from adaptsim_cli.api.tables import Rows
from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.errors import UsageError
from adaptsim_cli.session import folders, recording, store

if TYPE_CHECKING:
    from adaptsim_cli.api.curves import SessionComparison
    from hw.types import Array

Policy = Callable[["Array"], "Array | Sequence[float] | Mapping[str, float]"] | Sequence[float] | Mapping[str, float]
"""A function of the context (c,) that returns an action in units, or one action for all contexts. An action is given as
numbers or by name."""


def tasks() -> Rows:
    """A row for each task: its name, one line, and its parameters, contexts and actions with their units.

    The list has our tasks, those of installed packages, and those of files that were named once. A task that cannot be
    loaded is left out, and `adaptsim doctor` names it.
    """
    from sim.tasks import known_task, task_names

    every = (known_task(name) for name in task_names())
    return Rows(
        {
            "task": task.name,
            "title": task.title,
            "parameters": ", ".join(d.label for d in task.parameters.dimensions),
            "context": ", ".join(d.label for d in task.context.dimensions),
            "action": ", ".join(d.label for d in task.action.dimensions),
        }
        for task in every
        if task is not None
    )


def worlds(task: str) -> Rows:
    """A row for each world of a task: its name, its physics and one line. Raises UnknownName, TaskError, WorldError."""
    from adaptsim_cli.bench.checkpoints import resolve, task_of
    from sim.lab.physics import physics_name
    from sim.lab.world import list_worlds, load_world

    named = task_of(resolve({"task": task}).config)
    every = (load_world(name, named) for name in list_worlds(named))
    return Rows(
        {"world": one.name, "physics": physics_name(named, one.physics), "description": one.description}
        for one in every
    )


def sessions() -> tuple[str, ...]:
    """Names of all stored sessions, damaged ones too, newest last."""
    return folders.names(config.load().places.sessions)


def open_session(name: str) -> Session:
    """A stored session. Raises SessionError if it is missing or corrupt, UsageError for an impossible name."""
    root = config.load().places.sessions
    store.SessionStore.open(root, name)
    return Session(name, root)


def compare(first: Session | str, second: Session | str, *more: Session | str) -> SessionComparison:
    """Two sessions or more of one task beside each other, each a session or its name.

    Raises UsageError for sessions of different tasks or without a trial, SessionError.
    """
    from adaptsim_cli.api.curves import SessionComparison
    from adaptsim_cli.session.hindsight import believed
    from adaptsim_cli.show.comparison import compared

    named = (one if isinstance(one, Session) else open_session(one) for one in (first, second, *more))
    stores = [store.SessionStore.open(one.root, one.name) for one in named]
    return SessionComparison(compared(stores), believed(stores))


def begin(
    task: str,
    *,
    hw: str = config.SIMULATED,
    world: str | None = None,
    method: str = "adaptsim",
    seed: int = 0,
    particles: int = 2,
    name: str | None = None,
    checkpoint: str = "",
    solver: str = "",
    recorded: str = "",
    held_out: float = 0.5,
    start_from: str = "",
    resume: bool = False,
) -> Session:
    """Begin a session of a task (its name, or the file that declares it). Nothing is executed yet.

    Without a `world`, the simulated lab uses "wd", or the first world of the task's file.

    With `solver="direct"`, the session needs no pretraining, because it simulates while it runs
    (docs/guide/own-simulator.md).

    The session runs in the simulated lab, with a robot of your own (`hw="own"`), or with the trials `recorded` in a
    folder.

    `held_out` is the share of recorded trials that only score the final policy. `start_from` names an earlier session;
    this one begins with its posterior. Without a name it gets the default name of `adaptsim run-iteration`. Raises
    UsageError if a session of this name exists; with `resume` it is continued instead, if it was begun with the same
    task, method, world, hardware and seed. Raises UnknownName, WorldError, CheckpointError, RecordingsRefused.
    """
    from adaptsim_cli.bench.checkpoints import resolve
    from adaptsim_cli.session import beginning, opening, running
    from adaptsim_cli.session.own.mailbox import Mailbox

    flags: dict[str, Any] = {
        "task": task, "world": world, "method": method, "seed": seed, "particles": particles, "checkpoint": checkpoint,
        "solver": solver,
        "recorded": recorded, "held_out": held_out, "start_from": start_from,
        "hw": hw, "answer_with": "", "answer_moves": "robot",
    }  # fmt: skip
    if hw not in (config.SIMULATED, config.OWN):
        raise UsageError(
            f"hw = {hw}: Python begins sessions in the simulated lab, or with hw = own; an arm needs a terminal"
        )
    resolved = resolve(flags)
    settings = running.anywhere(resolved.config)
    root, chosen = resolved.places.sessions, name or running.default_name(settings)
    if folders.folder_of(root, chosen).is_dir():
        if resume:
            return _resumed(root, chosen, settings)
        raise UsageError(
            f"session {chosen!r} exists already: adaptsim.open_session({chosen!r}) or resume=True continues it; "
            "or choose another name"
        )
    answerer = Mailbox() if settings.is_own else None
    solver_folder = folders.solver_folder(folders.folder_of(root, chosen))
    with opening.open_parts(settings, solver_folder, answerer=answerer) as parts:
        beginning.begin(root, chosen, settings, parts)
    return Session(chosen, root)


def _resumed(root: Path, name: str, settings: config.Config) -> Session:
    """The existing session. Raises UsageError if it was begun with other settings, SessionError."""
    facts = store.SessionStore.open(root, name).facts
    for key, value in {
        "task": settings.task, "method": settings.method, "world": settings.lab_world, "hw": settings.hw,
        "seed": settings.seed, "particles": settings.particles,
    }.items():  # fmt: skip
        if (before := getattr(facts, key)) != value:
            raise UsageError(
                f"session {name!r} was begun with {key} = {before}, not {value}: leave it so, or choose another name"
            )
    return Session(name, root)


def rollout(
    task: str,
    policy: Policy,
    *,
    world: str = "wd",
    n: int = 20,
    seed: int = 0,
    through: Literal["direct", "lab"] = "direct",
) -> Rows:
    """Try your own policy `n` times in a simulated world, at contexts drawn from `seed`. Returns a row for each trial.

    `policy` is a function of the context (c,) in units, or one action: numbers in the task's order, or by name. With
    `lab`, trials run through the whole lab, with arm, camera and tracking; else without these. Nothing is stored.
    Raises UnknownName, WorldError, UsageError, OutOfRange for an action beyond its range, RolloutError.
    """
    from adaptsim_cli.research import from_python

    return Rows(from_python.rollout(task, policy, world=world, n=n, seed=seed, through=through))


def benchmark(
    task: str,
    *,
    worlds: str = "wd",
    methods: str = "udr,adaptsim",
    budget: int = 20,
    seeds: int | None = None,
    fresh: int = 0,
    out: Path | None = None,
) -> Rows:
    """Compare methods in this process, as `adaptsim benchmark` does.

    Returns a row for each world, method, seed and number of trials. Results are kept, and a repeated call continues. A
    contact task needs tables (`adaptsim world-tables`), or `fresh` rollouts. Raises the errors of `adaptsim benchmark`.
    """
    from adaptsim_cli.research import from_python

    rows = from_python.benchmark(task, worlds=worlds, methods=methods, budget=budget, seeds=seeds, fresh=fresh, out=out)
    return Rows(rows)


def read_recording(path: Path | str) -> Recording:
    """The frames, joints and camera of a `recording.mcap`, of any version. Raises SessionError naming the file."""
    return recording.read(Path(path))
