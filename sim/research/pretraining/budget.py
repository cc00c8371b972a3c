"""The stages of a pretraining that are wanted, and their sizes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import get_args

from sim.adaptation.card import Targets
from sim.adaptation.methods.udr import DRAWS as UDR_POLICIES
from sim.adaptation.reward_table import RewardTableSettings
from sim.research.methods.q_policy import MemoryName
from sim.research.pretraining.evaluation import PROPOSED, SCREENING, EvaluationSettings
from sim.research.pretraining.meta_training import MetaSettings, gate_distributions
from sim.solvers.emulator.training import EmulatorSettings
from sim.tasks.task import Task

MEMORIES: tuple[MemoryName, ...] = get_args(MemoryName)
"""The memories of the adaptation policies; the first is the paper's."""

NETWORKS: dict[MemoryName, str] = {"iteration": "adaptsim-iteration", "history": "adaptsim-history"}
COMPARED = len(NETWORKS) + 2


@dataclass(frozen=True)
class OptionalStages:
    """The optional stages. They can be added to a folder later."""

    policies: bool = True  # the paper's adaptation policy and its variants; NAF's checkpoints always have them
    evaluation: bool = True  # sessions of the available methods, on unseen targets


EVERYTHING = OptionalStages()


@dataclass(frozen=True)
class PretrainBudget:
    """The size of each stage: `full` strength, or `small` for a first look."""

    rollouts: int = 10_240  # of the dataset, spread evenly over the space
    denser: int = 6_144  # further ones where the outcome is uncertain
    naf_scale: float = 1.0  # factor on the paper's rollout budgets, with the solver naf
    emulator: EmulatorSettings = field(default_factory=EmulatorSettings)
    meta: MetaSettings = field(default_factory=MetaSettings)
    prospects: RewardTableSettings = field(default_factory=RewardTableSettings)
    evaluation: EvaluationSettings = field(default_factory=EvaluationSettings)

    @classmethod
    def full(cls, task: Task) -> PretrainBudget:
        """The default: about a quarter of an hour of two quiet cores for a contact task.

        If the mirror image of a rollout counts too, three quarters as many rollouts are simulated.
        """
        whole = cls()
        if task.mirror is None:
            return whole
        return replace(whole, rollouts=whole.rollouts * 3 // 4, denser=whole.denser * 3 // 4)

    @classmethod
    def small(cls, task: Task) -> PretrainBudget:
        """The budget of a first look: a third of the dataset."""
        full = cls.full(task)
        return cls(
            rollouts=full.rollouts // 3,
            denser=full.denser // 3,
            meta=MetaSettings(episodes=1000),
            evaluation=EvaluationSettings(targets=12),
        )

    def on_targets(self, kind: Targets) -> PretrainBudget:
        """The same budget, trained and judged on this kind of targets."""
        return replace(self, meta=replace(self.meta, targets=kind), evaluation=replace(self.evaluation, kind=kind))

    def uncached(self, task: Task, stages: OptionalStages = EVERYTHING) -> int:
        """Number of rollouts of training and evaluation that no counter counts. For the evaluation it is an upper
        bound, because policies repeat.
        """
        trials = task.adaptation.trials_per_iteration
        session = self.evaluation.particles * self.evaluation.iterations * trials
        judged = self.evaluation.rollouts * (UDR_POLICIES + 1 + COMPARED * self.evaluation.iterations)
        evaluated = self.evaluation.targets * (COMPARED * session + PROPOSED * SCREENING + judged)
        trained = len(MEMORIES) * (self.meta.distributions(task) + gate_distributions(task)) * trials
        return stages.policies * trained + stages.evaluation * evaluated
