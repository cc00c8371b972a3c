"""AdaptSim, the default: what the simulator knows and what the trials show, joined; policies are E plus a correction.

`sim.adaptation.reality` holds what may be true. The first particle acts by it: its action has the highest expected
reward, whether or not any E proposes it. The other particles act where the reward may be higher still, and less so
with every iteration: the last ones confirm. The E of a particle is what a person sees: the one whose policy is expected
to earn most. By how much the actions differ from that policy's is the correction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Best, Iteration, Particle
from sim.adaptation.outlook import Outlook, outlook
from sim.adaptation.reality import Reality, RealityPolicy, Simulators
from sim.errors import CheckpointError
from sim.solvers.solver import Executable, SolvedPolicy, policy_for
from sim.tasks.task import Task

OPTIMISM, FADES_OVER = 1.0, 4
"""Standard deviations that count for particles that explore in the first iteration; none after so many iterations."""

CAUTION = 0.5
"""Standard deviations by which the first particle, and what a session goes with, keep away from the unknown."""

APART = 0.15
"""The E of an iteration lie at least so far apart, in fractions of their ranges."""


def create(task: Task, checkpoint: Checkpoint | None) -> AdaptSim:
    """The method's entry in `METHODS`. Raises CheckpointError where there is nothing to predict with."""
    if checkpoint is None or checkpoint.prospects is None or checkpoint.naf:
        why = "there is none" if checkpoint is None else f"{checkpoint.path} holds no emulator with prospects"
        raise CheckpointError(
            f"adaptsim needs a checkpoint of the emulator or of an exact task, and {why}: make one with "
            f"`adaptsim pretrain --task {task.name}`"
        )
    return AdaptSim(Simulators(checkpoint.solver, checkpoint.prospects))


@dataclass(frozen=True, eq=False)
class AdaptSim:
    """A `Method` with its own policies (`sim.adaptation.method.OwnPolicies`); nothing in it is random."""

    simulators: Simulators
    _known: dict[bytes, Reality] = field(default_factory=dict, repr=False)  # by trials

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The E that earns most over all the truths there may be, and others that may earn more."""
        return self._particles([], n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """Deterministic; where the particles were before does not matter."""
        return self._particles(history, len(history[-1]))

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """That of the first particle is the best there is; the others explore."""
        leads = np.array_equal(particle.samples, self._particles(history, 1)[0].samples)
        optimism = -CAUTION if leads else OPTIMISM * max(0.0, 1.0 - len(history) / FADES_OVER)
        return RealityPolicy(self.reality(history), optimism, executable)

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """What it would go with."""
        return RealityPolicy(self.reality(history), -CAUTION, executable)

    def assess(self, history: Sequence[Iteration]) -> tuple[Best, Outlook]:
        """What it would go with, and what another iteration may gain. Raises ValueError without a trial."""
        reality, leading = self.reality(history), self._particles(history, 1)[0]
        if not reality.trials:
            raise ValueError("no trial has been run yet, so there is no best")
        found = outlook(reality, policy_for(self.simulators.solver, leading.samples))
        return Best(leading, found.reward, found.ci95, len(reality.trials)), found

    def reality(self, history: Sequence[Iteration]) -> Reality:
        """What the trials of `history` say; the same object for the same trials."""
        trials = tuple(t for iteration in history for tried in iteration for t in tried.trials)
        key = b"".join(part.tobytes() for t in trials for part in (t.context, t.action, t.observation))
        if key not in self._known:
            self._known.clear()
            self._known[key] = Reality(self.simulators, trials)
        return self._known[key]

    def _particles(self, history: Sequence[Iteration], n: int) -> tuple[Particle, ...]:
        prospects, weights = self.simulators.prospects, self.reality(history).weights
        earned = prospects.rewards[:, : len(weights)]
        mean = earned @ weights
        std = np.sqrt(np.maximum((earned - mean[:, None]) ** 2 @ weights, 0.0))
        unit = self.simulators.task.parameters.normalise(prospects.candidates)
        chosen = [int(np.argmax(mean))]
        while len(chosen) < n:
            gaps = np.linalg.norm(unit[:, None] - unit[chosen][None], axis=-1).min(axis=1)
            chosen.append(int(np.argmax(np.where(gaps < APART, -np.inf, mean + OPTIMISM * std))))
        return tuple(Particle(prospects.candidates[i][None]) for i in chosen)
