"""Normalised advantage functions: the task policy of the paper, trained on true rollouts only.

Q(c, a) = V(c) - 1/2 (a - mu(c))^T P(c) (a - mu(c)) with P = L L^T and L lower triangular with a positive
diagonal (Gu et al. 2016, eq. 4), so the best action is mu(c), and P is a full positive definite matrix. A trial is one
step: Q is regressed on the reward with the Huber loss.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw.extras import missing
from hw.types import Array, frozen_array
from sim.errors import ExtraMissing
from sim.rollouts.draws import Disturbances, cover
from sim.rollouts.run import Requests, Roll, Rollouts
from sim.solvers.candidates import first_executable
from sim.solvers.threads import one_thread
from sim.storage.files import Tensors
from sim.tasks.task import Executable, Task

try:
    import torch
    from torch import Tensor, nn
    from torch.nn.functional import huber_loss, softplus
except ImportError as error:
    raise ExtraMissing(missing("NAF", "torch", "learn")) from error

CANDIDATES = 256
"""Number of actions to search for an executable one, if the best one is not."""


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
        """(B, c) -> value (B,), mean action (B, a) and factor (B, a, a)."""
        features = self.trunk(context)
        rows, columns = torch.tril_indices(self.actions, self.actions)
        factor = torch.zeros(len(context), self.actions, self.actions)
        factor[:, rows, columns] = self.factor(features)
        diagonal = torch.diagonal(factor, dim1=1, dim2=2)
        factor = factor - torch.diag_embed(diagonal) + torch.diag_embed(softplus(diagonal) + 1e-3)
        return self.value(features)[:, 0], torch.tanh(self.mean(features)), factor

    @property
    def tensors(self) -> dict[str, NDArray[Any]]:
        """The arrays to store; `restore_policy` reads them."""
        return {name: t.numpy() for name, t in self.state_dict().items()}

    def q(self, context: Tensor, action: Tensor) -> Tensor:
        """(B, c), (B, a) normalised to [-1, 1] -> (B,)."""
        value, mean, factor = self(context)
        along = torch.einsum("bij,bi->bj", factor, action - mean)
        result: Tensor = value - 0.5 * (along**2).sum(dim=-1)
        return result


@dataclass(frozen=True)
class NafSettings:
    """The settings of a NAF policy's exploration and learning."""

    round: int = 50  # rollouts between two bouts of learning
    updates: int = 60  # gradient steps per bout
    batch: int = 64
    learning_rate: float = 1e-3
    noise_first: float = 0.8  # standard deviation of exploration, normalised to [-1, 1]
    noise_again: float = 0.4  # the same for a policy that starts from a donor
    noise_last: float = 0.1
    checked: float = 1 / 8  # share of the budget, at most one round, that measures the error of the value


@dataclass(frozen=True, eq=False)
class NafPolicy:
    """A `sim.solvers.solver.SolvedPolicy`: the mean action of a trained network."""

    task: Task
    network: NafNetwork
    value_error: float  # error of the value head's mean, two standard errors; 1: unknown
    executable: Executable | None = None
    attempts: int = 64

    def __call__(self, context: Array) -> Array:
        """(c,) in units -> (a,) in units. Raises NotExecutable if none of the best actions can be executed."""
        best = self.actions(context[None])[0]
        if self.executable is None or self.executable(context, best):
            return frozen_array(best)
        others = cover(self.task.action, CANDIDATES, np.random.default_rng(0))
        actions, worth = np.vstack([best, others]), np.append(np.inf, self._q(context, others))
        return first_executable(actions, worth, context, self.executable, self.task, self.attempts)

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a), without the executability check."""
        with one_thread(), torch.no_grad():
            mean = self.network(_signed(self.task.context.normalise(contexts)))[1].double().numpy()
        return self.task.action.denormalise(0.5 * (mean + 1.0))

    def predict(self, context: Array) -> tuple[float, float, float]:
        """Q at `context` for the chosen action, clipped to the possible rewards: mean, low, high.

        Low and high come from held-out rollouts of the finished policy. They hold for the mean over contexts, not for
        this context alone.
        """
        q = float(np.clip(self._q(context, self(context)[None])[0], 0.0, 1.0))
        return q, max(0.0, q - self.value_error), min(1.0, q + self.value_error)

    def _q(self, context: Array, actions: Array) -> Array:
        """(c,), (A, a) in units -> (A,)"""
        contexts = self.task.context.normalise(np.broadcast_to(context, (len(actions), len(context))))
        with one_thread(), torch.no_grad():
            return self.network.q(_signed(contexts), _signed(self.task.action.normalise(actions))).double().numpy()


Training = Generator[Requests, Rollouts, NafPolicy]
"""A generator that requests rollouts until the policy is trained."""


def train_together(trainings: Sequence[Training], roll: Roll) -> tuple[NafPolicy, ...]:
    """Run several trainings at once, to keep many workers busy; the results do not depend on it."""
    policies: dict[int, NafPolicy] = {}
    requests: dict[int, Requests] = {}

    def go_on(i: int, answer: Rollouts | None) -> None:
        try:
            requests[i] = trainings[i].send(answer) if answer is not None else next(trainings[i])
        except StopIteration as finished:
            policies[i] = finished.value

    for i in range(len(trainings)):
        go_on(i, None)
    while requests:
        now = dict(sorted(requests.items()))
        requests.clear()
        parts = [[getattr(requests, f.name) for requests in now.values()] for f in fields(Requests)]
        results = roll(Requests(*map(np.concatenate, parts)))
        ends = np.cumsum([len(requests) for requests in now.values()])
        for i, end in zip(now, ends, strict=True):
            go_on(i, results[end - len(now[i]) : end])
    return tuple(policies[i] for i in range(len(trainings)))


def naf_training(
    task: Task,
    samples: Array,
    budget: int,
    seed: int,
    donor: NafPolicy | None = None,
    settings: NafSettings | None = None,
) -> Training:
    """Train on `budget` rollouts for the distribution `samples` (m, p) in units, from the weights of `donor` if there
    is one.

    The last rollouts only measure the error of the value. The same seed gives the same policy.
    """
    settings = settings or NafSettings()
    rng = np.random.default_rng(seed)
    network = _new_network(task, int(rng.integers(2**31)))
    first = settings.noise_first if donor is None else settings.noise_again
    if donor is not None:
        network.load_state_dict(donor.network.state_dict())
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
    contexts, actions, rewards = torch.zeros(0, len(task.context)), torch.zeros(0, len(task.action)), torch.zeros(0)
    checks = min(settings.round, int(settings.checked * budget))
    while (done := len(rewards)) < budget - checks:
        n = min(settings.round, budget - checks - done)
        noise = first + (settings.noise_last - first) * done / budget
        context = task.context.sample(rng, n)
        action = _explore(network, task, context, noise, rng, blind=donor is None and done == 0)
        reward = (yield _requests(task, samples, context, action, rng)).rewards(task, context)
        contexts = torch.cat([contexts, _signed(task.context.normalise(context))])
        actions = torch.cat([actions, torch.from_numpy(action).float()])
        rewards = torch.cat([rewards, torch.from_numpy(reward).float()])
        with one_thread():
            for _ in range(settings.updates):
                rows = torch.from_numpy(rng.integers(len(rewards), size=settings.batch))
                loss = huber_loss(network.q(contexts[rows], actions[rows]), rewards[rows])
                optimiser.zero_grad()
                torch.autograd.backward(loss)
                nn.utils.clip_grad_norm_(network.parameters(), 1.0)
                optimiser.step()
    if checks < 2:
        return NafPolicy(task, network, donor.value_error if donor is not None else 1.0)
    context = task.context.sample(rng, checks)
    with one_thread(), torch.no_grad():
        value, mean, _ = network(_signed(task.context.normalise(context)))
    reward = (yield _requests(task, samples, context, mean.double().numpy(), rng)).rewards(task, context)
    gap = reward - value.double().numpy()
    return NafPolicy(task, network, 2.0 * float(np.hypot(gap.mean(), gap.std(ddof=1) / checks**0.5)))


def restore_policy(task: Task, tensors: Tensors, value_error: float) -> NafPolicy:
    """A stored policy. Raises RuntimeError if the tensors are not those of a network of this task."""
    network = _new_network(task, 0)
    network.load_state_dict({name: torch.from_numpy(t) for name, t in tensors.items()})
    return NafPolicy(task, network, value_error)


def _new_network(task: Task, seed: int) -> NafNetwork:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return NafNetwork(len(task.context), len(task.action))


def _signed(unit: Array) -> Tensor:
    return torch.from_numpy(2.0 * unit - 1.0).float()


def _explore(
    network: NafNetwork, task: Task, context: Array, noise: float, rng: np.random.Generator, blind: bool
) -> Array:
    """(n, a) in [-1, 1]: around the mean, or anywhere before the first learning."""
    if blind:
        return np.asarray(rng.uniform(-1.0, 1.0, (len(context), len(task.action))))
    with one_thread(), torch.no_grad():
        mean = network(_signed(task.context.normalise(context)))[1].double().numpy()
    return np.asarray(np.clip(mean + noise * rng.standard_normal(mean.shape), -1.0, 1.0))


def _requests(task: Task, samples: Array, context: Array, action: Array, rng: np.random.Generator) -> Requests:
    """Requests for rollouts of actions (n, a) in [-1, 1] at contexts (n, c) in units, with action error."""
    drawn = Disturbances.at_random(task, len(context), rng)
    parameters = np.asarray(samples)[rng.integers(len(samples), size=len(context))]
    commanded = task.action.denormalise(0.5 * (action + 1.0))
    return Requests(parameters, context, commanded + drawn.error, drawn.nuisance)
