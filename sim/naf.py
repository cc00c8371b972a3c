"""Normalised advantage functions: the task policy of the paper, trained on true rollouts alone.

Q(c, a) = V(c) - 1/2 (a - mu(c))^T P(c) (a - mu(c)) with P = L L^T and L lower triangular with a positive
diagonal (Gu et al. 2016, eq. 4), so that the best action is mu(c) and P is a full positive definite matrix. A trial is
one step: Q is regressed on the reward with the Huber loss.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import huber_loss, softplus

from hw.types import Array, frozen_array
from sim.emulator import one_thread
from sim.rollouts.run import Requests, Rollouts
from sim.sampling import spread
from sim.tasks.task import Task


class NafNetwork(nn.Module):
    """Context (B, c), normalised to [-1, 1] -> value (B,), mean action (B, a) in [-1, 1], factor L (B, a, a)."""

    def __init__(self, contexts: int, actions: int, hidden: int = 128) -> None:
        super().__init__()
        self.actions = actions
        self.trunk = nn.Sequential(nn.Linear(contexts, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU())
        self.value = nn.Linear(hidden, 1)
        self.mean = nn.Linear(hidden, actions)
        self.factor = nn.Linear(hidden, actions * (actions + 1) // 2)

    def forward(self, context: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        features = self.trunk(context)
        rows, columns = torch.tril_indices(self.actions, self.actions)
        factor = torch.zeros(len(context), self.actions, self.actions)
        factor[:, rows, columns] = self.factor(features)
        diagonal = torch.diagonal(factor, dim1=1, dim2=2)
        factor = factor - torch.diag_embed(diagonal) + torch.diag_embed(softplus(diagonal) + 1e-3)
        return self.value(features)[:, 0], torch.tanh(self.mean(features)), factor

    def q(self, context: Tensor, action: Tensor) -> Tensor:
        """(B, c), (B, a) normalised to [-1, 1] -> (B,)."""
        value, mean, factor = self(context)
        along = torch.einsum("bij,bi->bj", factor, action - mean)
        result: Tensor = value - 0.5 * (along**2).sum(dim=-1)
        return result


@dataclass(frozen=True)
class NafSettings:
    """How a NAF policy explores and learns."""

    round: int = 50  # rollouts between two bouts of learning
    updates: int = 60  # gradient steps a bout
    batch: int = 64
    learning_rate: float = 1e-3
    noise_first: float = 0.8  # standard deviation of exploration, normalised to [-1, 1]
    noise_last: float = 0.1


@dataclass(frozen=True, eq=False)
class NafPolicy:
    """A `TaskPolicy`: the mean action of a trained network."""

    task: Task
    network: NafNetwork

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units."""
        with one_thread(), torch.no_grad():
            mean = self.network(_signed(self.task.context.normalise(context[None])))[1][0].double().numpy()
        return frozen_array(self.task.action.denormalise(0.5 * (mean + 1.0)))


def train_naf(
    task: Task,
    samples: Array,
    roll: Callable[[Requests], Rollouts],
    budget: int,
    seed: int,
    donor: NafPolicy | None = None,
    settings: NafSettings | None = None,
) -> NafPolicy:
    """Train on `budget` true rollouts for the distribution `samples` (m, p).

    Starts from the weights of `donor` if there is one. `roll` is `run_many` on some executor. The same seed gives
    the same policy.
    """
    settings = settings or NafSettings()
    rng = np.random.default_rng(seed)
    network = _new_network(task, int(rng.integers(2**31)))
    if donor is not None:
        network.load_state_dict(donor.network.state_dict())
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
    contexts, actions, rewards = torch.zeros(0, len(task.context)), torch.zeros(0, len(task.action)), torch.zeros(0)
    done = 0
    while done < budget:
        n = min(settings.round, budget - done)
        noise = settings.noise_first + (settings.noise_last - settings.noise_first) * done / budget
        context = task.context.sample(rng, n)
        action = _explore(network, task, context, noise, rng, blind=donor is None and done == 0)
        reward = _try(task, samples, roll, context, action, rng)
        contexts = torch.cat([contexts, _signed(task.context.normalise(context))])
        actions = torch.cat([actions, torch.from_numpy(action).float()])
        rewards = torch.cat([rewards, torch.from_numpy(reward).float()])
        done += n
        with one_thread():
            for _ in range(settings.updates):
                rows = torch.from_numpy(rng.integers(len(rewards), size=settings.batch))
                loss = huber_loss(network.q(contexts[rows], actions[rows]), rewards[rows])
                optimiser.zero_grad()
                torch.autograd.backward(loss)
                nn.utils.clip_grad_norm_(network.parameters(), 1.0)
                optimiser.step()
    return NafPolicy(task, network)


def _new_network(task: Task, seed: int) -> NafNetwork:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return NafNetwork(len(task.context), len(task.action))


def _signed(unit: Array) -> Tensor:
    return torch.from_numpy(2.0 * unit - 1.0).float()


def _explore(
    network: NafNetwork, task: Task, context: Array, noise: float, rng: np.random.Generator, blind: bool
) -> Array:
    """(n, a) in [-1, 1]: around the mean, or anywhere while nothing has been learnt."""
    if blind:
        return np.asarray(rng.uniform(-1.0, 1.0, (len(context), len(task.action))))
    with one_thread(), torch.no_grad():
        mean = network(_signed(task.context.normalise(context)))[1].double().numpy()
    return np.asarray(np.clip(mean + noise * rng.standard_normal(mean.shape), -1.0, 1.0))


def _try(
    task: Task,
    samples: Array,
    roll: Callable[[Requests], Rollouts],
    context: Array,
    action: Array,
    rng: np.random.Generator,
) -> Array:
    """(n,) rewards of actions in [-1, 1], executed with their error."""
    n = len(context)
    commanded = task.action.denormalise(0.5 * (action + 1.0))
    executed = commanded + rng.uniform(-1.0, 1.0, commanded.shape) * task.action_noise
    nuisance = spread(task.nuisance, rng.random((n, len(task.nuisance))))
    parameters = np.asarray(samples)[rng.integers(len(samples), size=n)]
    return roll(Requests(parameters, context, executed, nuisance)).rewards(task, context)
