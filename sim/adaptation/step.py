"""One step of adaptation: what the trials showed -> where the parameters go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hw.types import Array, frozen_array
from sim.adaptation.q_network import QNetwork
from sim.tasks.task import Task


def state_size(task: Task) -> int:
    """Inputs of the adaptation policy: the mean of E and the observations of one iteration."""
    return len(task.parameters) + task.adaptation.trials_per_iteration * task.observation.size


def encode_state(task: Task, means: Array, observations: Array) -> Array:
    """(B, p) in units, (B, T * size) normalised -> (B, inputs)."""
    return np.concatenate([task.parameters.normalise(means), observations], axis=-1)


def adapt(network: QNetwork, task: Task, mean: Array, observations: Sequence[Array]) -> Array:
    """The next mean (p,) in units, from the mean (p,) and this iteration's observations, each (size,).

    The adaptation policy takes `trials_per_iteration` observations: of more, the last; fewer are repeated.
    Raises ValueError without any.
    """
    if len(observations) == 0:
        raise ValueError("adaptation needs at least one trial of this iteration")
    wanted = task.adaptation.trials_per_iteration
    taken = [observations[-wanted:][i % min(wanted, len(observations))] for i in range(wanted)]
    state = encode_state(task, np.asarray(mean)[None], np.concatenate(taken)[None])
    return frozen_array(task.parameters.step(mean, network.directions(state)[0], task.adaptation.delta))
