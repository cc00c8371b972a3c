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
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from adaptsim_cli import config
from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.errors import AnswerAwaited, SessionError, UsageError
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.outputs.trials import BestRecord
from adaptsim_cli.screen.views import between
from adaptsim_cli.session import exporting, folders, history, recording, store
from adaptsim_cli.session.exporting import Row
from adaptsim_cli.session.judgement import mean_of, trial_std
from adaptsim_cli.session.records import SessionFacts, TrialRecord
from sim.adaptation import methods
from sim.adaptation.stages import Role

if TYPE_CHECKING:
    from adaptsim_cli.session.best import TaskPolicy
    from adaptsim_cli.session.hindsight import Hindsight
    from hw.types import Array
    from sim.adaptation.posterior import Posterior
    from sim.adaptation.verdict import Verdict

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


@dataclass(frozen=True)
class Iteration:
    """The result of one iteration."""

    number: int  # from 1
    mean_reward: float  # of its trials
    best: BestRecord  # the best parameters, and the predicted reward of their policy with its 95 % interval
    verdict: Verdict
    next_parameters: tuple[Mapping[str, float], ...]  # mean of each particle, by name, in units


@dataclass(frozen=True, repr=False)
class Session:
    """A stored session. Every call reads it from the disk again."""

    name: str
    root: Path  # the folder of all sessions

    @property
    def folder(self) -> Path:
        """The folder of the session."""
        return self._stored.folder

    @property
    def facts(self) -> SessionFacts:
        """The settings that it was begun with. Raises SessionError if the session is gone or corrupt."""
        return self._stored.facts

    @property
    def trials(self) -> tuple[TrialRecord, ...]:
        """Every completed trial that counts, in order; without control trials. Raises SessionError."""
        return history.trials_of(self._stored)

    @property
    def controls(self) -> tuple[TrialRecord, ...]:
        """Every completed control trial that counts, in order. Raises SessionError."""
        return tuple(trial for trial in history.played_of(self._stored) if trial.role is Role.CONTROL)

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        """The complete iterations, in order. Raises SessionError."""
        stored = self._stored
        return tuple(
            _iteration(stored, number) for number in range(stored.iterations()) if stored.result(number) is not None
        )

    def __repr__(self) -> str:
        try:
            facts, trials = self.facts, self.trials
        except SessionError as error:
            return f"Session({self.name!r}: {error})"
        where = facts.recorded or facts.world or facts.hw
        done = [f"{_count(len(trials), 'trial')}, {_count(len(self.iterations), 'iteration')}"]
        if trials:
            newest = [t.reward for t in trials if t.iteration == trials[-1].iteration]
            done.append(f"reward {np.mean(newest):.2f} in the newest")
        return f"Session({self.name!r}: {facts.task} in {where}, {facts.method}, seed {facts.seed}; {', '.join(done)})"

    def _repr_html_(self) -> str:
        try:
            curve = self.learning_curve()
        except SessionError as error:
            return f"<p>{escape(str(error))}</p>"
        head = "".join(f"<th>{name}</th>" for name in ("iteration", "trials", "mean reward", "95 %"))
        body = "".join(
            f"<tr><td>{row['iteration']}</td><td>{row['trials']}</td><td>{row['mean_reward']:.2f}</td>"
            f"<td>{between(float(row['low']), float(row['high']))}</td></tr>"
            for row in curve
        )
        return f"<p>{escape(repr(self))}</p><table><tr>{head}</tr>{body}</table>"

    def learning_curve(self) -> list[Row]:
        """A row for each iteration: trials so far, mean reward of its own ones, 95 % interval. Raises SessionError."""
        trials, std = self.trials, trial_std(self.facts.task)
        rows = list[Row]()
        for number in sorted({trial.iteration for trial in trials}):
            mean = mean_of([trial.reward for trial in trials if trial.iteration == number], std)
            so_far = sum(trial.iteration <= number for trial in trials)
            rows.append(
                {"iteration": number, "trials": so_far, "mean_reward": mean.mean, "low": mean.low, "high": mean.high}
            )
        return rows

    def rows(self) -> list[Row]:
        """One flat row per trial, as in `adaptsim sessions export --format csv`. Raises SessionError."""
        return exporting.rows(self._stored)

    def run_iteration(self) -> Iteration:
        """Run the missing steps of the present iteration in the simulated lab and store them.

        Raises UsageError for a session on a real arm, and the errors of `adaptsim run-iteration`. Completed steps stay
        stored, and another call continues.
        """
        from adaptsim_cli.session import opening, running
        from adaptsim_cli.show.reports import Reports

        stored = self._stored
        if config.is_own(stored.facts.hw):
            raise UsageError(
                f"session {self.name!r} asks your robot: use ask and tell; they adapt after the last trial"
            )
        if not config.is_simulated(stored.facts.hw):
            raise UsageError(
                f"session {self.name!r} moves a real arm, and its motions are confirmed at a terminal: "
                f"adaptsim run-iteration --session {self.name}"
            )
        request = running.SessionRequest(self.name, frozenset(), yes=True)
        running.run_session(config.load(), request, opening.open_parts, Reports().draw, screen=_silent())
        return self.iterations[-1]

    def ask(self) -> Question:
        """The next trial that your robot is to make; the same one until it is told.

        Raises UsageError for a session in the simulated lab or on an arm of ours, and the errors of a session.
        """
        return self.asks()[0]

    def asks(self) -> tuple[Question, ...]:
        """All trials that may be made now, by several robots at once; they are told in any order."""
        self._require_own()
        if not (open_ones := self._open()):
            self._go_on()
            open_ones = self._open()
        if not open_ones:  # the last answers completed an iteration
            self._go_on()
            open_ones = self._open()
        return open_ones

    def tell(
        self,
        trial: Question,
        times_s: Sequence[float] | Array | None = None,
        states: Sequence[Sequence[float]] | Array | None = None,
        outcome: str | None = None,
        *,
        context: Mapping[str, float] | None = None,
        end: Sequence[float] | Array | None = None,
        rest_s: float | None = None,
        end_in_tool_m: Sequence[float] | Array | None = None,
        note: str = "",
        rejected: str | None = None,
        impossible: str | None = None,
    ) -> None:
        """Tell how a trial went: its trajectory, times (N,) in s and states (N, d) in the units of `trial.state`; or
        only its `end` (d,); or why it was `rejected` or is `impossible`. A question with `ask = "place"` wants the
        measured `context`; then the same trial is asked with its action.

        The session adapts once its iteration is complete. Raises AnswerRefused, and nothing is kept, for an answer that
        cannot count; UsageError if the trial is not open.
        """
        from adaptsim_cli.session.own.telling import keep

        self._require_own()
        if not any(
            (one.trial, one.attempt, one.ask) == (trial.trial, trial.attempt, trial.ask) for one in self._open()
        ):
            raise UsageError(f"trial {trial.trial} is not open: it was told already, or another session asked for it")
        rows = None if states is None else np.asarray(states, dtype=np.float64).tolist()
        table = {
            "trial": trial.trial, "t_s": _row(times_s), "state": rows, "outcome": outcome, "end": _row(end),
            "rest_s": rest_s, "end_in_tool_m": _row(end_in_tool_m), "note": note, "rejected": rejected,
            "impossible": impossible, "context": None if context is None else {k: float(v) for k, v in context.items()},
        }  # fmt: skip
        keep(self._stored, trial, {key: value for key, value in table.items() if value is not None})
        self._go_on()

    def _require_own(self) -> None:
        if not config.is_own(self.facts.hw):
            raise UsageError(
                f"session {self.name!r} has hw = {self.facts.hw}: only a session with hw = own asks and is told"
            )

    def _open(self) -> tuple[Question, ...]:
        from adaptsim_cli.session.own.telling import open_questions

        return open_questions(self._stored)

    def _go_on(self) -> None:
        """Take what was told, and go on until the next answers are awaited or an iteration is complete."""
        from functools import partial

        from adaptsim_cli.session import opening, running
        from adaptsim_cli.session.own.mailbox import Mailbox
        from adaptsim_cli.show.first_look import with_first_look
        from adaptsim_cli.show.reports import Reports

        request = running.SessionRequest(self.name, frozenset(), yes=True)
        opener = partial(opening.open_parts, answerer=Mailbox())
        settings = config.load({"answer_with": "", "answer_moves": "robot"})
        view = with_first_look(running.terminal_alone)
        with suppress(AnswerAwaited):
            running.run_session(settings, request, opener, Reports().draw, _silent(), view)

    def recording(self, trial: int) -> Recording:
        """Frames, joints and camera of a completed trial that counts. Raises SessionError, UsageError."""
        stored = self._stored
        record = history.completed(stored, trial)
        if stored.facts.curves:
            raise UsageError(
                f"trial {trial} of session {self.name!r} has no recording: nothing films the "
                f"{stored.facts.object_name}. Its curves are in session.trials[{trial - 1}].track"
            )
        folder = stored.trial_folder(*record.position)
        return recording.read(folder / recording.FILE)

    def hindsight(self) -> Hindsight:
        """The session's checkpoint, ready to evaluate its trajectories. Raises CheckpointError."""
        from adaptsim_cli.session.hindsight import Hindsight

        return Hindsight.of(self._stored)

    def posterior(self, iterations: int | None = None) -> Posterior:
        """The probability of each parameter vector after `iterations` iterations; by default after all trials.

        Raises CheckpointError if the session's checkpoint is gone or has no parts for inference, SessionError.
        """
        return self.hindsight().posterior(self._stored, iterations)

    def best_policy(self) -> TaskPolicy:
        """The final task policy of the session if it ended now. Raises CheckpointError, SessionError."""
        from adaptsim_cli.session.best import TaskPolicy, policy_of_session
        from adaptsim_cli.session.checkpoint import checkpoint_of_session

        checkpoint = checkpoint_of_session(self._stored)
        return TaskPolicy(self.name, checkpoint.solver.task, policy_of_session(self._stored, checkpoint))

    def report(self, out: Path | None = None) -> Path:
        """Write the session's page and return its path. Raises SessionError."""
        from adaptsim_cli.show.reports import Reports

        return Reports().draw(self._stored, out)

    @property
    def _stored(self) -> store.SessionStore:
        return store.SessionStore.open(self.root, self.name)


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


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"


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


def _row(values: Sequence[float] | Array | None) -> list[float] | None:
    if values is None:
        return None
    row: list[float] = np.asarray(values, dtype=np.float64).tolist()
    return row


def _silent() -> Any:
    import io

    from rich.console import Console

    from adaptsim_cli.screen.console import Screen

    return Screen(console=Console(file=io.StringIO()))
