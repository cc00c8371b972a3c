"""The paper's solver: NAF task policies, trained only on true rollouts, with the budgets and reuse rules of A2.2.

It has only the simulator, so every expectation needs rollouts (`sim.solvers.simulated`). A policy's own prediction is
its value head.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hw.types import Array
from sim.errors import UnknownName
from sim.research.naf.memory import NafMemory, TrainingPlan, features, plan_training, policy_key
from sim.research.naf.policy import NafPolicy, NafSettings, Training, naf_training, train_together
from sim.rollouts.draws import physical_contexts, trial_requests
from sim.rollouts.executors import process_pool, serial_executor
from sim.rollouts.run import Roll, run_many
from sim.rollouts.shards import CachedRollouts
from sim.solvers.misfit import misfit
from sim.solvers.simulated import FromSimulator
from sim.tasks.task import Executable, ReuseRules, SolverSettings, Task

MISFIT_TRIALS = 32
"""Number of simulated trials, each of which measures its distance to the nearest of `sim.solvers.misfit.DRAWS`
others."""


@dataclass(frozen=True, eq=False)
class NafSolver(FromSimulator):
    """A `sim.solvers.solver.Solver`. Its policies depend on those trained before (paper, remark 1)."""

    task: Task
    roll: Roll
    rules: ReuseRules
    memory: NafMemory
    misfit_limit: float = math.inf
    settings: NafSettings = field(default_factory=NafSettings)

    def policies(
        self,
        samples: Array,
        rng: np.random.Generator,
        executable: Executable | None = None,
        settings: SolverSettings | None = None,
    ) -> tuple[NafPolicy, ...]:
        """One policy for each of B distributions, samples (B, m, p), in order, because a later policy may start from
        the weights of an earlier one.
        """
        seeds = [int(s) for s in rng.integers(2**31, size=len(samples))]
        keys = [policy_key(s, seed) for s, seed in zip(samples, seeds, strict=True)]
        by_key = {key: policy for key in keys if (policy := self.memory.find(key)) is not None}
        new = [i for i, key in enumerate(keys) if key not in by_key]
        by_key |= self._train([(keys[i], samples[i], seeds[i]) for i in new])
        attempts = (settings or SolverSettings()).attempts
        return tuple(replace(by_key[key], executable=executable, attempts=attempts) for key in keys)

    def _train(self, jobs: list[tuple[str, Array, int]]) -> dict[str, NafPolicy]:
        """(key, samples, seed) of each distribution -> its policy.

        It plans all trainings first. Then each round trains the policies whose donor is ready.
        """
        plans: list[TrainingPlan] = []
        record = self.memory.record
        first = len(record)
        for _, samples, _ in jobs:
            plans.append(plan_training(record, features(self.task.parameters.normalise(samples)), self.rules))
            record = plans[-1].record
        policies: dict[int, NafPolicy] = {}
        while len(policies) < len(jobs):
            ready = [i for i, p in enumerate(plans) if i not in policies and _has_donor(p, first, policies)]
            trained = train_together([self._training(jobs[i], plans[i], first, policies) for i in ready], self.roll)
            policies |= dict(zip(ready, trained, strict=True))
        for i, (key, _, _) in enumerate(jobs):
            self.memory.add(plans[i].record, key, policies[i])
        return {key: policies[i] for i, (key, _, _) in enumerate(jobs)}

    def _training(
        self, job: tuple[str, Array, int], plan: TrainingPlan, first: int, policies: dict[int, NafPolicy]
    ) -> Training:
        donor = None
        if plan.donor is not None:
            donor = policies[plan.donor - first] if plan.donor >= first else self.memory.policy(plan.donor)
        return naf_training(self.task, job[1], plan.budget, job[2], donor, self.settings)


def _has_donor(plan: TrainingPlan, first: int, policies: dict[int, NafPolicy]) -> bool:
    return plan.donor is None or plan.donor < first or plan.donor - first in policies


def rules_of(task: Task, scale: float = 1.0) -> ReuseRules:
    """The reuse rules of the task, with all budgets times `scale`. Raises UnknownName for a task without rules."""
    if task.reuse is None:
        why = "its task policies are exact" if task.exact else "it does not define how NAF's policies are reused"
        raise UnknownName(f"{task.name} has no solver naf: {why}. Leave --solver out")
    return task.reuse.scaled(scale)


def naf_facts(solver: NafSolver) -> dict[str, Any]:
    """The facts about the solver for a checkpoint's card, read by `restore` and `in_session`."""
    return {"solver": "naf", "naf": {**asdict(solver.rules), "misfit_limit": solver.misfit_limit}}


def restore(task: Task, facts: Mapping[str, Any]) -> NafSolver:
    """The solver of a checkpoint whose card has the table `facts`; it stores nothing, and runs rollouts one by one.

    Raises KeyError, TypeError or ValueError if the table is damaged.
    """
    return _restored(task, facts, partial(run_many, task, executor=serial_executor()), None)


@contextmanager
def in_session(task: Task, facts: Mapping[str, Any] | None, workers: int, folder: Path) -> Iterator[NafSolver]:
    """The solver of a session, on `workers` processes (0: one per core); it stores rollouts and policies in `folder`.

    `facts` is the table of the checkpoint's card; None: the task's own settings. Raises UnknownName for a task without
    them, CheckpointError if `folder` holds other data.
    """
    with process_pool(workers or None) as crew:
        roll, policy_folder = CachedRollouts(task, folder / "rollouts", crew), folder / "policies"
        if facts is None:
            yield NafSolver(task, roll, rules_of(task), NafMemory(task, policy_folder))
        else:
            yield _restored(task, facts, roll, policy_folder)


def _restored(task: Task, facts: Mapping[str, Any], roll: Roll, folder: Path | None) -> NafSolver:
    rules = ReuseRules(**{name: value for name, value in facts.items() if name != "misfit_limit"})
    return NafSolver(task, roll, rules, NafMemory(task, folder), float(facts["misfit_limit"]))


def measure_misfit_limit(solver: NafSolver, rng: np.random.Generator, trials: int = MISFIT_TRIALS) -> float:
    """The misfit that 95 % of simulated trials inside the ranges do not exceed. Needs about `trials` x 500 rollouts."""
    task = solver.task
    parameters, actions = task.parameters.sample(rng, trials), task.action.sample(rng, trials)
    contexts = physical_contexts(task, rng.random((trials, len(task.physical_context))))
    requests = trial_requests(task, parameters, contexts, actions, rng)
    observations = task.observation.with_noise(solver.roll(requests).observation, rng)
    values = [misfit(solver, c, a, o) for c, a, o in zip(contexts, actions, observations, strict=True)]
    return float(np.quantile(values, 0.95))
