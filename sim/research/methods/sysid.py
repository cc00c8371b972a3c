"""System identification: finds the parameters that explain the trajectories, regardless of rewards (BayesSim, as in the
paper).

Each iteration simulates its own trials again, with the executed commands and with parameters drawn from the present
belief. From these, a mixture density network learns to infer parameters from trajectories. Applied to the observed
trajectories, it gives the posterior. This is truncated to the ranges and becomes the prior of the next iteration. The
task policy is trained for draws from the posterior, or for its mean.

All particles of a session are the same distribution, so each iteration adds all of its trials.
Sources: Ramos, Possas & Fox 2019 (BayesSim); Papamakarios & Murray 2016 (the network); paper, A3 (what is observed).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hw.extras import missing
from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint
from sim.adaptation.method import Iteration, Particle, Trial, require_whole
from sim.errors import CheckpointError, ExtraMissing
from sim.research.methods.search import calculating, require
from sim.rollouts.draws import sobol
from sim.solvers.misfit import LEAST_STD
from sim.tasks.task import Solver, Task

try:
    import torch
except ImportError as error:
    raise ExtraMissing(missing("sysid", "torch", "sbi")) from error

SIMULATED = 1024
"""Draws of parameters per iteration, each with a simulation of every trial."""

SAMPLES = 64
"""Parameters drawn from a posterior to train its task policy, as many as for UDR."""

COMPONENTS, HIDDEN = 8, 50
"""Components of the mixture, and units of each hidden layer."""

BATCH, RATE, PATIENCE, EPOCHS = 128, 3e-3, 8, 60
"""Batch, step size, epochs without progress before training ends, and the most epochs."""

JITTER = 2e-3
"""Noise added to draws, in fractions of the ranges, so that the next network never sees the same parameters twice."""

DRAWN = 4096
"""Draws from the network; those within the ranges are kept."""


def create_bayes(task: Task, checkpoint: Checkpoint | None) -> SysId:
    """SysID-Bayes of the paper: the posterior from full trajectories. Raises CheckpointError, ExtraMissing."""
    return _create("sysid-bayes", task, checkpoint, ends_only=False, point=False)


def create_state(task: Task, checkpoint: Checkpoint | None) -> SysId:
    """SysID-Bayes-State: the posterior from the ends of trials. Raises CheckpointError, ExtraMissing."""
    return _create("sysid-bayes-state", task, checkpoint, ends_only=True, point=False)


def create_point(task: Task, checkpoint: Checkpoint | None) -> SysId:
    """SysID-Bayes-Point: only the mean of that posterior. Raises CheckpointError, ExtraMissing."""
    return _create("sysid-bayes-point", task, checkpoint, ends_only=True, point=True)


def _create(name: str, task: Task, checkpoint: Checkpoint | None, *, ends_only: bool, point: bool) -> SysId:
    if checkpoint is None:
        raise CheckpointError(f"{name} needs a checkpoint: make one with `adaptsim pretrain --task {task.name}`")
    require(name, "sbi", "sbi")
    return SysId(checkpoint.solver, ends_only, point)


@dataclass(frozen=True, eq=False)
class SysId:
    """A `Method`. The same trials always give the same posterior, in any process."""

    solver: Solver
    ends_only: bool
    point: bool
    _posteriors: dict[bytes, Array] = field(default_factory=dict, repr=False)  # posteriors, by history

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The prior: all of Omega, or its middle."""
        return self._particles(sobol(SIMULATED, len(self.solver.task.parameters), rng), n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The posterior after all iterations; `rng` is not used."""
        return self._particles(self.posterior(history), len(history[-1]))

    def posterior(self, history: Sequence[Iteration]) -> Array:
        """(SIMULATED, p) draws in [0, 1) of each range, for `sim.types.Space.spread`."""
        believed = sobol(SIMULATED, len(self.solver.task.parameters), np.random.default_rng(0))
        digest = hashlib.sha256()
        for iteration in history:
            trials = [trial for tried in iteration for trial in tried.trials]
            if not trials:
                continue
            for trial in trials:
                digest.update(trial.key)
            key = digest.digest()
            if key not in self._posteriors:
                self._posteriors[key] = self._updated(believed, trials, int.from_bytes(key[:4], "big"))
            believed = self._posteriors[key]
        return believed

    def _particles(self, unit: Array, n: int) -> tuple[Particle, ...]:
        chosen = unit.mean(axis=0)[None] if self.point else unit[:SAMPLES]
        return (Particle(self.solver.task.parameters.spread(chosen)),) * n

    def _updated(self, believed: Array, trials: Sequence[Trial], seed: int) -> Array:
        """Update draws of the belief, `believed` (SIMULATED, p), by these trials."""
        require_whole("sysid-bayes", trials)
        rng = np.random.default_rng(seed)
        simulated = np.concatenate([self._simulated(believed, trial, rng) for trial in trials], axis=1)
        observed = np.concatenate([self._seen(trial.observation) for trial in trials])
        inside = _within(_infer(believed, simulated, observed, seed))
        if len(inside) == 0:  # training diverged: these trials give no information
            return believed
        chosen = inside[rng.integers(len(inside), size=SIMULATED)]
        return np.clip(chosen + JITTER * rng.standard_normal(chosen.shape), 0.0, 1.0 - 1e-9)

    def _simulated(self, unit: Array, trial: Trial, rng: np.random.Generator) -> Array:
        """(N, seen) simulated observations of the trial for the parameters at `unit` (N, p)."""
        task, n = self.solver.task, len(unit)
        executed = trial.action + rng.uniform(-1.0, 1.0, (n, len(trial.action))) * task.action_noise
        nuisance = task.nuisance.spread(rng.random((n, len(task.nuisance))))
        contexts = np.tile(trial.context, (n, 1))
        paths = self.solver.trajectories(task.parameters.spread(unit), executed, nuisance, contexts)
        std = np.sqrt(self.solver.residual_std**2 + LEAST_STD**2)
        shown = task.observation.with_noise(paths + std * rng.standard_normal(paths.shape), rng)
        return self._seen(shown)

    def _seen(self, observation: Array) -> Array:
        task = self.solver.task
        size = task.adaptation.end_moments * len(task.observation.columns) if self.ends_only else task.observation.size
        return observation[..., -size:]


def _within(drawn: Array) -> Array:
    """The rows of `drawn` (n, p) inside the ranges; if there are none, all rows, moved to the nearest edge."""
    drawn = drawn[np.isfinite(drawn).all(axis=1)]
    inside = drawn[((drawn >= 0.0) & (drawn < 1.0)).all(axis=1)]
    return inside if len(inside) else np.clip(drawn, 0.0, 1.0 - 1e-9)


def _infer(parameters: Array, simulated: Array, observed: Array, seed: int) -> Array:
    """(DRAWN, p) draws of a network trained on pairs (N, p), (N, k), given `observed` (k,)."""
    with calculating(seed):
        from sbi.inference import NPE  # noqa: PLC0415 - an extra that takes seconds to load
        from sbi.neural_nets import posterior_nn  # noqa: PLC0415
        from sbi.utils import BoxUniform  # noqa: PLC0415

        p = parameters.shape[1]
        network = posterior_nn("mdn", num_components=COMPONENTS, hidden_features=HIDDEN)
        training = NPE(
            BoxUniform(torch.zeros(p), torch.ones(p)), network, tracker=silent_tracker(), show_progress_bars=False
        )
        training.append_simulations(torch.from_numpy(parameters).float(), torch.from_numpy(simulated).float())
        learnt = training.train(
            training_batch_size=BATCH, learning_rate=RATE, stop_after_epochs=PATIENCE, max_num_epochs=EPOCHS
        )
        with torch.no_grad():
            drawn = learnt.sample((DRAWN,), torch.from_numpy(observed).float()[None])
    return np.asarray(drawn.reshape(DRAWN, p).double().numpy())


def silent_tracker() -> Any:
    """A tracker for sbi that stores nothing; sbi's own writes into the current folder."""
    return _Silent()


class _Silent:
    log_dir = None

    def log_metric(self, name: str, value: float, step: int | None = None) -> None:
        pass

    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        pass

    def log_params(self, params: dict[str, object]) -> None:
        pass

    def add_figure(self, name: str, figure: object, step: int | None = None) -> None:
        pass

    def flush(self) -> None:
        pass
