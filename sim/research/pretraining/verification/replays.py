"""Replays training episodes in the simulator: are their rewards and decisions true?

Every visited distribution gets a task policy of its own, which runs in the episode's target by true rollouts; the
emulator answers the same requests.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from hw.types import Array
from sim.research.methods.q_network import QNetwork
from sim.research.methods.q_policy import MemoryName
from sim.research.pretraining.episodes import LIBRARY, EmulatedRolls, Episodes, sparse
from sim.research.pretraining.verification.statistics import clustered
from sim.rollouts.draws import trial_requests
from sim.rollouts.run import Requests, Roll, Rollouts
from sim.solvers.emulator.network import Emulator
from sim.solvers.solver import Solver
from sim.tasks.task import Task
from sim.types import Estimate

AT_ONCE = 64
"""Number of distributions with task policies in memory at a time."""


@dataclass(frozen=True)
class Return:
    """Discounted return of an episode of one particle, in training and by true rollouts."""

    what: str
    episodes: int
    paid: float
    true: float
    difference: Estimate  # in training - true, bootstrap over targets


@dataclass(frozen=True)
class Agreement:
    """Agreement of one adaptation policy's greedy directions: on true trajectories and on others of the same states."""

    memory: MemoryName
    decisions: int
    emulated: Estimate  # share of parameters moved in the same way on emulated trajectories of the same trials
    repeated: Estimate  # the same on true trajectories of other trials: the level of chance
    opposite: float  # share of parameters moved the other way on emulated trajectories
    opposite_repeated: float  # the same on true trajectories of other trials


@dataclass(frozen=True)
class Replays:
    """The results of the replays."""

    episodes: int  # number of episodes of one particle
    returns: tuple[Return, ...]
    agreements: tuple[Agreement, ...]  # empty for an exact task, which has no emulated trajectories


def select_episodes(episodes: Episodes, count: int) -> Episodes:
    """About `count` episodes of one particle, spread evenly over the training; particles of a target stay together."""
    targets, particles = episodes.rewards.shape[:2]
    wanted = min(targets, -(-count // particles))
    rows = np.unique(np.linspace(0, targets - 1, wanted).round().astype(int))
    return Episodes(*(getattr(episodes, f.name)[rows] for f in fields(Episodes)))


def replay(
    solver: Solver,
    emulator: Emulator | None,
    networks: Mapping[MemoryName, QNetwork],
    episodes: Episodes,
    count: int,
    roll: Roll,
    rng: np.random.Generator,
) -> Replays:
    """Replay about `count` of the `episodes` by true rollouts: every visit, with its number of trials."""
    task, some = solver.task, select_episodes(episodes, count)
    requests = _requests(solver, some, rng)
    noise = int(rng.integers(2**31))
    true = _seen(task, some, requests, roll(requests), noise)
    returns = _returns(task, some, true, rng)
    if emulator is None:
        earned = episodes.trial_rewards.mean(axis=-1)
        everything = "every reward, all episodes, by the trials of training"
        returns.append(_return(task, everything, episodes.rewards, earned, rng))
    agreements: list[Agreement] = []
    if emulator is not None:
        others = _requests(solver, some, rng)
        again = _seen(task, some, others, roll(others), int(rng.integers(2**31)))
        emulated = _seen(task, some, requests, EmulatedRolls(emulator, rng)(requests), noise)
        paid, earned = (sparse(task, e.trial_rewards.mean(axis=-1)) for e in (emulated, true))
        returns.append(_return(task, "sparse, by the trials of a visit on both sides", paid, earned, rng))
        agreements = [_agreement(task, m, network, again, true, emulated, rng) for m, network in networks.items()]
    return Replays(int(np.prod(some.rewards.shape[:2])), tuple(returns), tuple(agreements))


def _requests(solver: Solver, episodes: Episodes, rng: np.random.Generator) -> Requests:
    """The trials of every visit (E * P * (H + 1) * T rows), with fresh contexts, action errors and nuisance."""
    task, (count, particles, visits) = solver.task, episodes.rewards.shape
    trials = task.adaptation.trials_per_iteration
    means = episodes.means.reshape(-1, episodes.means.shape[-1])
    contexts = task.context.sample(rng, len(means) * trials).reshape(len(means), trials, -1)
    seed, actions = int(rng.integers(2**31)), []
    for start in range(0, len(means), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        same = np.random.default_rng(seed)
        policies = solver.policies(means[part, None, :], same, settings=LIBRARY)
        actions += [policy.actions(c) for policy, c in zip(policies, contexts[part], strict=True)]
    targets = np.repeat(episodes.targets, particles * visits * trials, axis=0)
    assert len(targets) == count * particles * visits * trials
    return trial_requests(task, targets, contexts.reshape(len(targets), -1), np.concatenate(actions), rng)


def _seen(task: Task, episodes: Episodes, requests: Requests, rollouts: Rollouts, noise: int) -> Episodes:
    """The episodes with other trials; equal `noise` gives the same camera noise."""
    seen = task.observation.with_noise(rollouts.observation, np.random.default_rng(noise))
    return replace(
        episodes,
        contexts=task.context.normalise(requests.context).reshape(episodes.contexts.shape),
        observations=seen.reshape(episodes.observations.shape),
        trial_rewards=rollouts.rewards(task, requests.context).reshape(episodes.trial_rewards.shape),
    )


def _returns(task: Task, some: Episodes, true: Episodes, rng: np.random.Generator) -> list[Return]:
    earned, paid = true.trial_rewards.mean(axis=-1), sparse(task, some.rewards)
    counted = some.rewards >= task.adaptation.threshold
    return [
        _return(task, "every reward", some.rewards, earned, rng),
        _return(task, "sparse: the visits that training paid", paid, np.where(counted, earned, 0.0), rng),
    ]


def _return(task: Task, what: str, paid: Array, true: Array, rng: np.random.Generator) -> Return:
    """The return from rewards (E, P, H + 1) of every visit; the first belongs to no step and does not count."""
    discount = task.adaptation.discount ** np.arange(paid.shape[2] - 1)
    totals = [(rewards[:, :, 1:] * discount).sum(axis=-1) for rewards in (paid, true)]
    difference = clustered((totals[0] - totals[1]).mean(axis=1), rng)
    return Return(what, totals[0].size, float(totals[0].mean()), float(totals[1].mean()), difference)


def _agreement(
    task: Task,
    memory: MemoryName,
    network: QNetwork,
    again: Episodes,
    true: Episodes,
    emulated: Episodes,
    rng: np.random.Generator,
) -> Agreement:
    def directions(episodes: Episodes) -> Array:
        """(E, decisions, p) of the greedy policy in every state of the episodes."""
        states = [episodes.state(task, memory, t) for t in range(episodes.directions.shape[2])]
        greedy = network.directions(np.concatenate(states))  # rows: H, E, P
        by_target = np.moveaxis(greedy.reshape(-1, *again.rewards.shape[:2], greedy.shape[-1]), 1, 0)
        return by_target.reshape(len(by_target), -1, greedy.shape[-1]).astype(np.float64)

    reference, others = directions(true), (directions(emulated), directions(again))
    alike = [clustered((reference == other).mean(axis=(1, 2)), rng) for other in others]
    opposite = [float((reference * other < 0).mean()) for other in others]
    return Agreement(memory, reference[..., 0].size, alike[0], alike[1], opposite[0], opposite[1])
