"""adaptsim from Python: the commands as functions and values.

    from adaptsim_cli import api

    session = api.begin("pendulum", world="wd", name="study")
    session.run_iteration()
    session.posterior().mean

Everything runs in the simulated lab without questions. A real arm needs a confirmation at a terminal, so only `adaptsim
run-iteration` moves it; its sessions can be opened and read here. Stored files and random numbers are those of the
command line, so both may continue the same session.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli import config
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.outputs.trials import BestRecord
from adaptsim_cli.session import exporting, recording, store
from adaptsim_cli.session.exporting import Row
from adaptsim_cli.session.recording import Recording
from adaptsim_cli.session.records import Facts, TrialRecord

if TYPE_CHECKING:
    from adaptsim_cli.wiring.best import TaskPolicy
    from adaptsim_cli.wiring.hindsight import Hindsight
    from hw.types import Array
    from sim.adaptation.posterior import Posterior
    from sim.adaptation.verdict import Verdict

__all__ = [
    "BestRecord",
    "Facts",
    "Iteration",
    "Recording",
    "Row",
    "Session",
    "TrialRecord",
    "begin",
    "open_session",
    "read_recording",
    "sessions",
]


@dataclass(frozen=True)
class Iteration:
    """The result of one iteration."""

    number: int  # from 1
    mean_reward: float  # of its trials
    best: BestRecord  # the best parameters, and their expected reward with its 95 % interval
    verdict: Verdict
    next_parameters: tuple[Mapping[str, float], ...]  # mean of each particle, by name, in units


@dataclass(frozen=True)
class Session:
    """A stored session. Every call reads it from the disk again."""

    name: str
    root: Path  # the folder of all sessions

    @property
    def folder(self) -> Path:
        """The folder of the session."""
        return self._stored.folder

    @property
    def facts(self) -> Facts:
        """The settings that it was begun with. Raises SessionError if the session is gone or corrupt."""
        return self._stored.facts

    @property
    def trials(self) -> tuple[TrialRecord, ...]:
        """Every completed trial that counts, in order. Raises SessionError."""
        return store.trials_of(self._stored)

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        """The complete iterations, in order. Raises SessionError."""
        stored = self._stored
        return tuple(
            _iteration(stored, number) for number in range(stored.iterations()) if stored.result(number) is not None
        )

    def rows(self) -> list[Row]:
        """One flat row per trial, as in `adaptsim sessions export --format csv`. Raises SessionError."""
        return exporting.rows(self._stored)

    def run_iteration(self) -> Iteration:
        """Run the missing steps of the present iteration in the simulated lab and store them.

        Raises UsageError for a session on a real arm, and the errors of `adaptsim run-iteration`. Completed steps stay
        stored, and another call continues.
        """
        from adaptsim_cli.session import running
        from adaptsim_cli.wiring import session as wiring
        from adaptsim_cli.wiring.hindsight import Reports

        stored = self._stored
        if not config.is_simulated(stored.facts.hw):
            raise UsageError(
                f"session {self.name!r} moves a real arm, and its motions are confirmed at a terminal: "
                f"adaptsim run-iteration --session {self.name}"
            )
        request = running.SessionRequest(self.name, frozenset(), yes=True)
        running.run_session(config.load(), request, wiring.open_parts, Reports().draw, screen=_silent())
        return self.iterations[-1]

    def recording(self, trial: int) -> Recording:
        """Frames, joints and camera of a completed trial that counts. Raises SessionError, UsageError."""
        stored = self._stored
        folder = stored.trial_folder(*store.completed(stored, trial).place)
        return recording.read(folder / recording.FILE)

    def hindsight(self) -> Hindsight:
        """The session's checkpoint, ready to evaluate its trajectories. Raises CheckpointError."""
        from adaptsim_cli.wiring.hindsight import Hindsight

        return Hindsight.of(self._stored)

    def posterior(self, iterations: int | None = None) -> Posterior:
        """The probability of each parameter vector after `iterations` iterations; by default after all trials.

        Raises CheckpointError if the session's checkpoint is gone or has no parts for inference, SessionError.
        """
        return self.hindsight().posterior(self._stored, iterations)

    def best_policy(self) -> TaskPolicy:
        """The final task policy of the session if it ended now. Raises CheckpointError, SessionError."""
        from adaptsim_cli.wiring.best import TaskPolicy, policy_of_session
        from adaptsim_cli.wiring.settings import checkpoint_of_session

        checkpoint = checkpoint_of_session(self._stored)
        return TaskPolicy(self.name, checkpoint.solver.task, policy_of_session(self._stored, checkpoint))

    def report(self, out: Path | None = None) -> Path:
        """Write the session's page and return its path. Raises SessionError."""
        from adaptsim_cli.wiring.hindsight import Reports

        return Reports().draw(self._stored, out)

    @property
    def _stored(self) -> store.SessionStore:
        return store.SessionStore.open(self.root, self.name)


def sessions() -> tuple[str, ...]:
    """Names of all stored sessions, damaged ones too, newest last."""
    return store.names(config.load().places.sessions)


def open_session(name: str) -> Session:
    """A stored session. Raises SessionError if it is missing or corrupt, UsageError for an impossible name."""
    root = config.load().places.sessions
    store.SessionStore.open(root, name)
    return Session(name, root)


def begin(
    task: str,
    *,
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
    """Begin a session in the simulated lab, or with the trials `recorded` in a folder; nothing is executed yet.

    `held_out` is the share of recorded trials that only score the final policy. `start_from` names an earlier session;
    this one begins with its posterior. Without a name it gets the default name of `adaptsim run-iteration`. Raises
    UsageError if a session of this name exists, UnknownName, WorldError, CheckpointError, RecordingsRefused.
    """
    from adaptsim_cli.session import running
    from adaptsim_cli.wiring import session as wiring

    flags: dict[str, Any] = {
        "task": task, "world": world, "method": method, "seed": seed, "particles": particles, "checkpoint": checkpoint,
        "recorded": recorded, "held_out": held_out, "start_from": start_from,
        "hw": config.SIMULATED,
    }  # fmt: skip
    resolved = config.load(flags)
    settings = running.anywhere(resolved.config)
    root, chosen = resolved.places.sessions, name or running.default_name(settings)
    if store.folder_of(root, chosen).is_dir():
        raise UsageError(f"session {chosen!r} exists already: api.open_session continues it; or choose another name")
    with wiring.open_parts(settings, store.folder_of(root, chosen) / "naf") as parts:
        running.begin(root, chosen, settings, parts)
    return Session(chosen, root)


def read_recording(path: Path | str) -> Recording:
    """The frames, joints and camera of a `recording.mcap`, of any version. Raises SessionError naming the file."""
    return recording.read(Path(path))


def _iteration(stored: store.SessionStore, number: int) -> Iteration:
    result = stored.result(number)
    if result is None:
        raise SessionError(f"iteration {number + 1} of {stored.facts.name} has no result yet")
    names = [dimension.name for dimension in stored.facts.parameters]
    means: list[Array] = [np.mean(samples, axis=0) for samples in result.next_particles]
    return Iteration(
        number=number + 1,
        mean_reward=float(np.mean([trial.reward for trial in stored.trials(number)])),
        best=result.best,
        verdict=result.verdict,
        next_parameters=tuple(dict(zip(names, map(float, mean), strict=True)) for mean in means),
    )


def _silent() -> Any:
    import io

    from rich.console import Console

    from adaptsim_cli.screen.console import Screen

    return Screen(console=Console(file=io.StringIO()))
