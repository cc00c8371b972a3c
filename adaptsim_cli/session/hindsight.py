"""Evaluates the trajectories of a stored session again, with the checkpoint that it was begun with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.config import DIRECT
from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.outputs.sessions import ParameterBelief
from adaptsim_cli.session.checkpoint import checkpoint_of_session, recordings_of
from adaptsim_cli.session.history import history_of, particles_of, results_of, trials_of
from adaptsim_cli.session.judgement import HeldOutScore, Judgement, Prediction, end_error, mean_of
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore
from sim.adaptation.method import Simulating
from sim.errors import CollapsedPosterior, SimError

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.method import ExpectedTrajectories, Iteration, Method
    from sim.adaptation.posterior import Posterior
    from sim.adaptation.trajectory_likelihood import TrajectoryLikelihood
    from sim.tasks.task import SolvedPolicy, Task
    from sim.types import Estimate

JUDGED = 64
"""Contexts in which a final policy chooses among the trials held out."""

LIKELY = 24
"""Number of trajectories drawn from the posterior for each trial."""

BELIEVED = (0.05, 0.5, 0.95)
"""Lower end, median and upper end of a session's posterior of a parameter."""


@dataclass(frozen=True, eq=False)
class Hindsight:
    """A checkpoint that evaluates the trajectories of its sessions. It caches the results of each trial."""

    checkpoint: Checkpoint
    likelihood: TrajectoryLikelihood | Simulating
    _methods: dict[str, Method] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, store: SessionStore) -> Hindsight:
        """Raises CheckpointError if the session's checkpoint is gone, or has no parts for inference."""
        from sim.adaptation.methods import make_method
        from sim.adaptation.posterior import likelihood_of

        checkpoint = checkpoint_of_session(store)
        if store.facts.solver == DIRECT:
            method = make_method(DIRECT, checkpoint.solver.task, checkpoint)
            assert isinstance(method, Simulating)
            return cls(checkpoint, method)
        return cls(checkpoint, likelihood_of(checkpoint))

    @cached_property
    def _udr_policies(self) -> tuple[SolvedPolicy, ...]:
        return _udr_policies(self.checkpoint)

    def posterior(self, store: SessionStore, iterations: int | None = None) -> Posterior:
        """The posterior after `iterations` iterations; by default after all trials. Raises SessionError."""
        from sim.adaptation.posterior import posterior

        begun = store.iterations() if iterations is None else min(iterations, store.iterations())
        if isinstance(self.likelihood, Simulating):
            begun = min(begun, len(results_of(store)))
        return posterior(self.likelihood, history_of(self.checkpoint.solver.task, store, begun - 1))

    def evaluate(self, store: SessionStore) -> Judgement:
        """The judgement that a report shows. Raises SessionError without trials."""
        from sim.adaptation.posterior import expected_reward, posterior_after_each
        from sim.solvers.solver import policy_for

        checkpoint, trials = self.checkpoint, trials_of(store)
        if not trials:
            raise SessionError(f"session {store.facts.name} has no completed trial yet")
        results = results_of(store)
        history = history_of(checkpoint.solver.task, store, trials[-1].iteration - 1)
        if is_direct := isinstance(self.likelihood, Simulating):
            history = history[: len(results)]  # what the session has not simulated yet stays unknown
        posteriors = posterior_after_each(self.likelihood, history)
        posterior = posteriors[-1]

        def expected(policies: Sequence[SolvedPolicy]) -> Estimate:
            rng = np.random.default_rng(0)  # the same targets for all
            return expected_reward(checkpoint, posterior, policies, rng)

        return Judgement(
            posteriors=posteriors,
            predictions=self._predictions(trials, posterior, history),
            first=None
            if is_direct
            else expected([policy_for(checkpoint.solver, one.samples) for one in particles_of(store, 0)]),
            adapted=expected([self._final(store, history[: results[-1].iteration])])
            if results and not is_direct
            else None,
            udr=None if is_direct else expected(self._udr_policies),
            unit=_unit(checkpoint.solver.task),
            held_out=self._held_out(store, posteriors) if results and store.facts.held_out else None,
        )

    def _final(self, store: SessionStore, history: Sequence[Iteration]) -> SolvedPolicy:
        """The final policy after `history`. The method is kept, with its predictions of earlier trials."""
        from sim.adaptation.judging import final_policy
        from sim.adaptation.methods import make_method

        checkpoint, name = self.checkpoint, store.facts.method
        if name not in self._methods:
            self._methods[name] = make_method(name, checkpoint.solver.task, checkpoint)
        return final_policy(self._methods[name], checkpoint.solver, checkpoint.solver.task, history)

    def _held_out(self, store: SessionStore, posteriors: Sequence[Posterior]) -> HeldOutScore:
        """The scores by the recordings that the session never saw. Raises RecordingsRefused."""
        from sim.adaptation.judging import final_policy
        from sim.adaptation.methods import make_method
        from sim.adaptation.posterior import predicted

        facts, recordings = store.facts, recordings_of(self.checkpoint, store.facts)
        held, checkpoint = recordings.held_out, recordings.of_held_out
        task, solver = checkpoint.solver.task, checkpoint.solver
        contexts = task.context.sample(np.random.default_rng(facts.seed), JUDGED)
        history = history_of(task, store, store.iterations() - 1)
        final = final_policy(make_method(facts.method, task, checkpoint), solver, task, history)

        def earned(policies: Sequence[SolvedPolicy]) -> tuple[float, float, float]:
            rewards = [held.rewards(held.at(actions), contexts) for p in policies for actions in [p.actions(contexts)]]
            of_all = mean_of(list(np.mean(rewards, axis=0)), 0.0)
            return of_all.mean, of_all.low, of_all.high

        every = range(len(held))
        best = [held.rewards(every, np.tile(context, (len(held), 1))).max() for context in contexts]

        def error(posterior: Posterior) -> float:
            drawn, errors = posterior.draw(LIKELY, np.random.default_rng(0)), []
            for row, track in enumerate(held.tracks):
                context = held.context_of(row, np.asarray(task.reference_context))
                ends = predicted(solver, drawn, context, held.actions[row])[:, -1]
                end = track.at(task.observation.times_s[-1:])[0, list(task.observation.columns)]
                errors.append(end_error(end, ends, _unit(task)))
            return float(np.median(errors))

        return HeldOutScore(
            trials=len(held),
            contexts=JUDGED,
            final=earned([final]),
            udr=earned(_udr_policies(checkpoint)),
            best=float(np.mean(best)),
            before=error(posteriors[0]),
            after=error(posteriors[-1]),
        )

    def _predictions(
        self, trials: Sequence[TrialRecord], posterior: Posterior, history: Sequence[Iteration]
    ) -> dict[int, Prediction]:
        """The prediction of each trial, by its number: for the parameters of its policy, and for likely ones."""
        from sim.adaptation.posterior import predicted

        each = 1 + LIKELY
        solver: ExpectedTrajectories = self.checkpoint.solver
        if isinstance(self.likelihood, Simulating):
            if not history:
                return {}
            trials = [trial for trial in trials if trial.iteration <= len(history)]
            solver = self.likelihood.near_fit(history)
        parameters = [
            np.vstack([list(trial.parameters.values()), posterior.draw(LIKELY, np.random.default_rng(trial.trial))])
            for trial in trials
        ]
        contexts = np.repeat([trial.context_array for trial in trials], each, axis=0)
        actions = np.repeat([trial.action_array for trial in trials], each, axis=0)
        states = predicted(solver, np.concatenate(parameters), contexts, actions)
        observation, states = solver.task.observation, states.reshape(len(trials), each, *states.shape[1:])
        return {
            trial.trial: Prediction(observation.times_s, observation.columns, expected[0], expected[1:])
            for trial, expected in zip(trials, states, strict=True)
        }


def _udr_policies(checkpoint: Checkpoint) -> tuple[SolvedPolicy, ...]:
    """Policies for all of Omega; always the same."""
    from sim.adaptation.methods.udr import udr_policies

    return udr_policies(checkpoint.solver, np.random.default_rng(0))


def believed(stores: Sequence[SessionStore]) -> tuple[ParameterBelief, ...]:
    """The belief of each session about each parameter, except sessions without a posterior. Raises SessionError."""
    beliefs = list[ParameterBelief]()
    for store in stores:
        try:
            posterior = Hindsight.of(store).posterior(store)
        except SimError:
            continue
        try:
            levels = posterior.quantiles(BELIEVED).T.tolist()
        except CollapsedPosterior:
            levels = [(None, None, None)] * len(store.facts.parameters)
        for index, (d, (low, median, high)) in enumerate(zip(posterior.space.dimensions, levels, strict=True)):
            named = {"session": store.facts.name, "parameter": d.name, "unit": d.unit}
            chances = posterior.chances(index)
            by_word = None if chances is None else dict(zip(d.kinds, chances, strict=True))
            beliefs.append(ParameterBelief(**named, low=low, median=median, high=high, chances=by_word))
    return tuple(beliefs)


def _unit(task: Task) -> str:
    """The unit of an error of a predicted end: mm if the first two observed columns are a place on the table, else that
    of all curves; empty if they differ.
    """
    if task.goal_m is not None or not task.observation.curves:
        return "mm"
    units = {curve.partition("[")[2].rstrip("]") for curve in task.observation.curves}
    return units.pop() if len(units) == 1 else ""
