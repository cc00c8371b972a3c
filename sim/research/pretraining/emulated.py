"""Rollouts of the emulator instead of the simulator, for episodes by the hundred thousand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from perception.types import Outcome
from sim.rollouts.run import OUTCOMES, Requests, Rollouts
from sim.solvers.emulator.network import Emulator


@dataclass(frozen=True, eq=False)
class EmulatedRolls:
    """A `Roll`: one member of the ensemble answers each request, with its known residual error."""

    emulator: Emulator
    rng: np.random.Generator

    def __call__(self, requests: Requests) -> Rollouts:
        """One possible outcome of each request, without the camera's noise."""
        task = self.emulator.task
        drawn = self.emulator.draw(requests.parameters, requests.action, requests.nuisance, self.rng)
        at_context = task.relocate(drawn.observation, requests.context)
        succeeded = drawn.success > 0.5
        return Rollouts(
            observation=at_context,
            end_state=np.where(succeeded[:, None], drawn.end_state, np.nan),
            succeeded=succeeded,
            outcome=np.full(len(requests), OUTCOMES.index(Outcome.SETTLED), dtype=np.int8),  # not used
        )
