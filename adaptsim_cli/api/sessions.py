"""A stored session for Python programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli import config
from adaptsim_cli.api.tables import Rows
from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.screen.outputs.trials import BestRecord
from adaptsim_cli.session import exporting, history, recording, store
from adaptsim_cli.session.advice import check_first, in_words
from adaptsim_cli.session.records import SessionFacts, TrialRecord
from sim.adaptation.stages import Role

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from adaptsim_cli.api.beliefs import SessionPosterior
    from adaptsim_cli.api.curves import LearningCurve
    from adaptsim_cli.session.best import TaskPolicy
    from adaptsim_cli.session.hindsight import Hindsight
    from hw.types import Array
    from sim.adaptation.verdict import Verdict


@dataclass(frozen=True)
class Iteration:
    """The result of one iteration."""

    number: int  # from 1
    mean_reward: float  # of its trials
    best: BestRecord  # the best parameters, and the predicted reward of their policy with its 95 % interval
    verdict: Verdict
    next_parameters: tuple[Mapping[str, float], ...]  # mean of each particle, by name, in units


@dataclass(frozen=True)
class BestAction:
    """The best action of a session in one context."""

    context: Mapping[str, float]  # by name, in units
    action: Mapping[str, float]  # by name, in units
    reward: float  # predicted for the best policy, over all contexts
    interval: tuple[float, float]  # of that reward, 95 %
    parameters: Mapping[str, float]  # the best parameters of the simulator, by name, in units
    units: Mapping[str, str]  # of all of them

    def __str__(self) -> str:
        low, high = self.interval
        named = (f"{name} = {value:.3g} {self.units[name]}".rstrip() for name, value in self.action.items())
        return f"{', '.join(named)}: predicted reward {self.reward:.2f} (95 % {low:.2f} to {high:.2f})"

    def _repr_html_(self) -> str:
        from adaptsim_cli.api.tables import html_table

        kinds = {"context": self.context, "action": self.action, "best parameters": self.parameters}
        body = [[kind, name, value, self.units[name]] for kind, named in kinds.items() for name, value in named.items()]
        low, high = self.interval
        reward = f"<p>Predicted reward {self.reward:.2f} (95 % {low:.2f} to {high:.2f})</p>"
        return reward + html_table(["", "name", "value", "unit"], body)


Robot = Callable[[Question], Mapping[str, Any]]
"""A function that plays a trial and returns the arguments of `Session.tell` by name, e.g. `{"end": [0.7, 0.1, 0.03],
"outcome": "upright"}`."""


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

    @property
    def verdict(self) -> str:
        """The verdict after the last complete iteration, in whole sentences. Raises SessionError."""
        facts, results = self.facts, history.results_of(self._stored)
        if not results:
            return "No iteration is complete yet."
        first = check_first(facts.task, facts.hw, facts.calibration)
        return in_words(results[-1].verdict, facts.object_name, facts.recorded, first)

    def learning_curve(self) -> LearningCurve:
        """A row for each iteration: number of trials so far, mean reward of its trials, 95 % interval. Raises
        SessionError.
        """
        from adaptsim_cli.api.curves import curve_of

        return curve_of(self._stored)

    def rows(self) -> Rows:
        """One flat row per trial, as in `adaptsim sessions export --format csv`. Raises SessionError."""
        return Rows(exporting.rows(self._stored))

    def to_pandas(self) -> Any:
        """`rows` as a data frame of pandas. Raises ExtraMissing without pandas, SessionError."""
        return self.rows().to_pandas()

    def run_iteration(self) -> Iteration:
        """Run the missing steps of the present iteration in the simulated lab and store them.

        Raises UsageError for a session on a real arm, and the errors of `adaptsim run-iteration`. Completed steps stay
        stored, and another call continues.
        """
        self._run(1, until_done=False)
        return self.iterations[-1]

    def run(self, iterations: int | None = None, robot: Robot | None = None, loggers: Sequence[str] = ()) -> Session:
        """Run iterations until the verdict says stop, at most `iterations` further ones, and return the session.

        By default there are at most as many as the task's horizon. `robot` makes the trials of a session with
        `hw="own"`, one after another. `loggers` are kept up to date: "tensorboard", "wandb", "mlflow". Raises the
        errors of `run_iteration`, `ask` and `tell`; UsageError for an unknown logger, ExtraMissing for one without its
        package.
        """
        if iterations is not None and iterations < 1:
            raise UsageError(f"iterations = {iterations}: at least one")
        if robot is None:
            self._run(iterations, until_done=True, loggers=loggers)
            return self
        first = len(self.iterations)
        while True:
            trial = self.ask()
            self.tell(trial, **robot(trial))
            new = self.iterations[first:]
            for name in loggers:
                self.log_to(name)
            if new and (new[-1].verdict.stops or len(new) >= (iterations or self._horizon)):
                return self

    def _run(self, iterations: int | None, *, until_done: bool, loggers: Sequence[str] = ()) -> None:
        from adaptsim_cli.api.progress import silent, with_bar
        from adaptsim_cli.session import opening, running
        from adaptsim_cli.show.reports import Reports

        hw = self.facts.hw
        if config.is_own(hw):
            raise UsageError(
                f"session {self.name!r} asks your robot: use ask and tell, or run(robot=FUNCTION); they adapt after "
                "the last trial"
            )
        if not config.is_simulated(hw):
            raise UsageError(
                f"session {self.name!r} moves a real arm, and its motions are confirmed at a terminal: "
                f"adaptsim run-iteration --session {self.name}"
            )
        request = running.SessionRequest(self.name, frozenset(), iterations, yes=True, until_done=until_done)
        view = with_bar(iterations or self._horizon)
        resolved = config.load()
        if loggers:
            from adaptsim_cli.show.loggers.feed import with_loggers

            view = with_loggers(loggers, resolved.places.logs, view)
        running.run_session(resolved, request, opening.open_parts, Reports().draw, silent(), view)

    def ask(self) -> Question:
        """The next trial that your robot has to make; the same one until it is reported.

        Raises UsageError for a session in the simulated lab or on an arm of ours, and the errors of a session.
        """
        return self.asks()[0]

    def asks(self) -> tuple[Question, ...]:
        """All trials that may be made now, by several robots at once; report them in any order."""
        from adaptsim_cli.api.answers import open_trials

        return open_trials(self._stored)

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
        """Report how a trial went: by its trajectory, with times (N,) in s and states (N, d) in the units of
        `trial.state`; by its `end` (d,) alone; or by the reason why it was `rejected` or is `impossible`. A question
        with `ask = "place"` asks for the measured `context`; the next question asks for the same trial with its action.

        The session adapts once its iteration is complete. Raises AnswerRefused, and nothing is kept, for an answer that
        cannot count; UsageError if the trial is not open.
        """
        from adaptsim_cli.api.answers import keep_answer, numbers

        answer = {
            "t_s": numbers(times_s), "state": numbers(states), "outcome": outcome, "end": numbers(end),
            "rest_s": rest_s, "end_in_tool_m": numbers(end_in_tool_m), "note": note, "rejected": rejected,
            "impossible": impossible, "context": None if context is None else {k: float(v) for k, v in context.items()},
        }  # fmt: skip
        keep_answer(self._stored, trial, answer)

    def recording(self, trial: int) -> Recording:
        """Frames, joints and camera of a completed trial that counts. Raises SessionError, UsageError."""
        stored = self._stored
        record = history.completed(stored, trial)
        return recording.read(recording.file_of(stored, record))

    def hindsight(self) -> Hindsight:
        """The session's checkpoint, ready to evaluate its trajectories. Raises CheckpointError."""
        from adaptsim_cli.session.hindsight import Hindsight

        return Hindsight.of(self._stored)

    def posterior(self, iterations: int | None = None) -> SessionPosterior:
        """The probability of each parameter vector after `iterations` iterations; by default after all trials.

        Raises CheckpointError if the session's checkpoint is gone or has no parts for inference, SessionError.
        """
        from adaptsim_cli.api.beliefs import posterior_of

        return posterior_of(self._stored, self.hindsight(), iterations)

    def best_policy(self) -> TaskPolicy:
        """The final task policy of the session if it ended now. Raises CheckpointError, SessionError."""
        from adaptsim_cli.session.best import TaskPolicy, policy_of_session
        from adaptsim_cli.session.checkpoint import checkpoint_of_session

        checkpoint = checkpoint_of_session(self._stored)
        return TaskPolicy(self.name, checkpoint.solver.task, policy_of_session(self._stored, checkpoint))

    def best(self, context: ArrayLike | Mapping[str, float] | None = None) -> BestAction:
        """The best action in a context (c,), by default in the task's reference context, with its expected reward.

        Raises CheckpointError, SessionError before the first complete iteration, OutOfRange, UsageError.
        """
        policy = self.best_policy()
        task, record = policy.task, self.iterations[-1].best
        if isinstance(context, Mapping):
            if set(context) != set(task.context.names):
                raise UsageError(
                    f"a context of {task.name} has {', '.join(task.context.names) or 'nothing'}; "
                    f"this one has {', '.join(context)}"
                )
            context = [context[name] for name in task.context.names]
        point = task.reference_context if context is None else np.asarray(context, dtype=np.float64)
        return BestAction(
            context=_named(task.context.names, point),
            action=_named(task.action.names, policy(point)),
            reward=record.mean_reward,
            interval=record.ci95,
            parameters=record.params,
            units=self.facts.units,
        )

    def log_to(self, logger: str) -> Path:
        """Keep the whole session in a logger ("tensorboard", "wandb", "mlflow") and return the folder of its log.

        An earlier log of this session there is replaced. Raises UsageError for an unknown logger, ExtraMissing for one
        without its package, SessionError.
        """
        from adaptsim_cli.show.loggers.feed import logged_again

        return logged_again(logger, config.load().places.logs, self._stored)

    def report(self, out: Path | None = None) -> Path:
        """Write the session's page and return its path. Raises SessionError."""
        from adaptsim_cli.show.reports import Reports

        return Reports().draw(self._stored, out)

    def __repr__(self) -> str:
        try:
            facts, trials = self.facts, self.trials
        except SessionError as error:
            return f"Session({self.name!r}: {error})"
        where = facts.recorded or facts.world or facts.hw
        parts = [f"{_count(len(trials), 'trial')}, {_count(len(self.iterations), 'iteration')}"]
        if trials:
            newest = [t.reward for t in trials if t.iteration == trials[-1].iteration]
            parts.append(f"reward {np.mean(newest):.2f} in the newest")
        return f"Session({self.name!r}: {facts.task} in {where}, {facts.method}, seed {facts.seed}; {', '.join(parts)})"

    def _repr_html_(self) -> str:
        from adaptsim_cli.api.in_notebooks import session_in_html

        try:
            return session_in_html(self._stored, repr(self), self.verdict)
        except SessionError as error:
            return f"<p>{escape(str(error))}</p>"

    @property
    def _horizon(self) -> int:
        from sim.tasks import get_task

        return get_task(self.facts.task).adaptation.horizon

    @property
    def _stored(self) -> store.SessionStore:
        return store.SessionStore.open(self.root, self.name)


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"


def _named(names: Sequence[str], values: Array) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


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
