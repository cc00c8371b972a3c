"""adaptsim from Python: the commands as functions and values.

    from adaptsim_cli import api

    session = api.begin("pendulum", world="wd", name="study")
    session.run_iteration()
    session.posterior().mean

A robot of your own (`hw="own"`) is asked and told:

    session = api.begin("pushing", hw="own")
    for _ in range(20):
        trial = session.ask()
        session.tell(trial, times_s, states, "upright")

Everything else runs in the simulated lab without questions. A real arm needs a confirmation at a terminal, so only
`adaptsim run-iteration` moves it; its sessions can be opened and read here. Stored files and random numbers are those
of the command line, so both may continue the same session.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from adaptsim_cli import config
from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.outputs.trials import BestRecord
from adaptsim_cli.session import folders, recording, store
from adaptsim_cli.session.exporting import Row
from adaptsim_cli.session.records import SessionFacts, TrialRecord
from adaptsim_cli.stored_session import Iteration, Session
from sim.adaptation import methods

if TYPE_CHECKING:
    from hw.types import Array

__all__ = [
    "BestRecord",
    "Iteration",
    "Policy",
    "Question",
    "Recording",
    "Row",
    "Session",
    "SessionFacts",
    "TrialRecord",
    "begin",
    "benchmark",
    "methods",
    "open_session",
    "read_recording",
    "rollout",
    "sessions",
]


Policy = Callable[["Array"], "Array | Sequence[float] | Mapping[str, float]"] | Sequence[float] | Mapping[str, float]
"""A function context (c,) -> action in units, or one action for every context; an action as numbers or by name."""


def sessions() -> tuple[str, ...]:
    """Names of all stored sessions, damaged ones too, newest last."""
    return folders.names(config.load().places.sessions)


def open_session(name: str) -> Session:
    """A stored session. Raises SessionError if it is missing or corrupt, UsageError for an impossible name."""
    root = config.load().places.sessions
    store.SessionStore.open(root, name)
    return Session(name, root)


def begin(
    task: str,
    *,
    hw: str = config.SIMULATED,
    world: str = "wd",
    method: str = "adaptsim",
    seed: int = 0,
    particles: int = 2,
    name: str | None = None,
    checkpoint: str = "",
    recorded: str = "",
    held_out: float = 0.5,
    start_from: str = "",
) -> Session:
    """Begin a session of a task (its name, or the file that declares it). Nothing is executed yet.

    It runs in the simulated lab, with a robot of your own (`hw="own"`), or with the trials `recorded` in a folder.

    `held_out` is the share of recorded trials that only score the final policy. `start_from` names an earlier session;
    this one begins with its posterior. Without a name it gets the default name of `adaptsim run-iteration`. Raises
    UsageError if a session of this name exists, UnknownName, WorldError, CheckpointError, RecordingsRefused.
    """
    from adaptsim_cli.bench.checkpoints import resolve
    from adaptsim_cli.session import opening, running
    from adaptsim_cli.session.own.mailbox import Mailbox

    flags: dict[str, Any] = {
        "task": task, "world": world, "method": method, "seed": seed, "particles": particles, "checkpoint": checkpoint,
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
        raise UsageError(f"session {chosen!r} exists already: api.open_session continues it; or choose another name")
    answerer = Mailbox() if settings.is_own else None
    with opening.open_parts(settings, folders.folder_of(root, chosen) / folders.SOLVER, answerer=answerer) as parts:
        running.begin(root, chosen, settings, parts)
    return Session(chosen, root)


def rollout(
    task: str,
    policy: Policy,
    *,
    world: str = "wd",
    n: int = 20,
    seed: int = 0,
    through: Literal["direct", "lab"] = "direct",
) -> list[Row]:
    """Try an own policy `n` times in a simulated world, at contexts drawn from `seed`: a row each, for a data frame.

    `policy` is a function of the context (c,) in units, or one action: numbers in the task's order, or by name. Trials
    run without arm or camera, or through the whole `lab`: arm, camera and tracking. Nothing is stored.
    Raises UnknownName, WorldError, UsageError, OutOfRange for an action beyond its range, RolloutError.
    """
    from adaptsim_cli.research import from_python

    return from_python.rollout(task, policy, world=world, n=n, seed=seed, through=through)


def benchmark(
    task: str,
    *,
    worlds: str = "wd",
    methods: str = "udr,adaptsim",
    budget: int = 20,
    seeds: int | None = None,
    fresh: int = 0,
    out: Path | None = None,
) -> list[Row]:
    """Compare methods as `adaptsim benchmark` does, in this process: a row for each world, method, seed and number of
    trials, for a data frame.

    Results are kept and a repeated call continues. A contact task needs tables (`adaptsim world-tables`), or `fresh`
    rollouts. Raises the errors of `adaptsim benchmark`.
    """
    from adaptsim_cli.research import from_python

    return from_python.benchmark(task, worlds=worlds, methods=methods, budget=budget, seeds=seeds, fresh=fresh, out=out)


def __dir__() -> list[str]:
    return sorted(__all__)


def read_recording(path: Path | str) -> Recording:
    """The frames, joints and camera of a `recording.mcap`, of any version. Raises SessionError naming the file."""
    return recording.read(Path(path))
