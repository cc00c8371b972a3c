"""What several tests of learning share: one small emulator of the toy task, made once."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from toy_task import PARAMETERS, TOY, Unmodelled, simulate

from sim.adaptation.method import Iteration, Particle, ParticleTrials, Trial
from sim.adaptation.reward_table import RewardTable, RewardTableSettings, tabulate_rewards
from sim.research.naf.policy import NafPolicy, naf_training, train_together
from sim.rollouts.dataset import Dataset, build_dataset
from sim.rollouts.executors import serial_executor
from sim.rollouts.run import Requests, Roll, Rollouts, run_many
from sim.solvers.candidates import ScenarioPolicy
from sim.solvers.emulator.network import Emulator
from sim.solvers.emulator.training import EmulatorSettings, train_emulator
from sim.tasks.task import Executable, SolverSettings, Task
from sim.types import EmulatorReport

SETTINGS = EmulatorSettings(hidden=64, layers=2, learning_rate=3e-3, least_steps=600, most_steps=600)


def roll(requests: Requests) -> Rollouts:
    with serial_executor() as executor:
        return run_many(TOY, requests, executor)


@functools.cache
def dataset() -> Dataset:
    with tempfile.TemporaryDirectory() as folder, serial_executor() as executor:
        return build_dataset(TOY, Path(folder), 1500, 0, executor)


@functools.cache
def trained() -> tuple[Emulator, EmulatorReport]:
    return train_emulator(TOY, dataset(), 0, SETTINGS)


@functools.cache
def reward_table() -> RewardTable:
    return tabulate_rewards(trained()[0], 3, RewardTableSettings(64, 512, 4))


TARGET = PARAMETERS.denormalise(np.array([0.85, 0.5, 0.0, 0.15]))


def trial(
    action: np.ndarray,
    effects: Unmodelled | None = None,
    seed: int = 0,
    where: Sequence[float] = (0.62, 0.01),
    reward: float | None = None,
    parameters: np.ndarray = TARGET,
) -> Trial:
    """A real trial of the toy, with the camera's noise of `seed`."""
    context = np.array(where)
    track = simulate(parameters, context, action, np.zeros(1), effects)
    seen = TOY.observation.with_noise(TOY.observation(track), np.random.default_rng(seed))
    return Trial(context, action, seen, TOY.score(track, context) if reward is None else reward, TOY.end_of(track))


def tried(mean: np.ndarray, *trials: Trial) -> Iteration:
    """An iteration of one particle."""
    return (ParticleTrials(Particle(mean[None]), trials),)


def train_one(
    emulator: Emulator,
    samples: np.ndarray,
    rng: np.random.Generator,
    executable: Executable | None = None,
    settings: SolverSettings | None = None,
) -> ScenarioPolicy:
    """The emulator's policy for one distribution, samples (m, p)."""
    return emulator.policies(np.asarray(samples)[None], rng, executable, settings)[0]


def train_naf(
    task: Task, samples: np.ndarray, roll: Roll, budget: int, seed: int, donor: NafPolicy | None = None
) -> NafPolicy:
    """NAF's policy for one distribution, samples (m, p)."""
    return train_together([naf_training(task, samples, budget, seed, donor)], roll)[0]


def iteration(*tried: tuple[np.ndarray, list[float]]) -> Iteration:
    """(mean, rewards) of each particle; contexts and observations without meaning."""
    size = TOY.observation.size
    return tuple(
        ParticleTrials(
            Particle(mean[None]),
            tuple(Trial(TOY.reference_context, TOY.action.low, np.zeros(size), reward, None) for reward in rewards),
        )
        for mean, rewards in tried
    )
