"""Strong baselines of the sealed benchmark: simple methods that make good use of the simulator.

`best-of-first` tries a few actions that are fixed before any trial, and keeps the one that earned most. `least-squares`
fits the parameters of an exact simulator to all trajectories. `simopt` is SimOpt (Chebotar et al. 2019) with the task
policies of this program: a Gaussian of parameters whose simulated trajectories come closer to the real ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from hw.types import Array
from sim.adaptation.checkpoint import Checkpoint, reward_table_of
from sim.adaptation.descent import descend
from sim.adaptation.exact_fit import is_exact
from sim.adaptation.method import Iteration, Particle, Trial, policy_of, require_whole, trials_in
from sim.adaptation.methods.adaptsim import AdaptSim
from sim.adaptation.simulators import Simulators
from sim.errors import CheckpointError
from sim.rollouts.draws import cover
from sim.solvers.solver import policy_for
from sim.tasks.task import Executable, SolvedPolicy, Solver, Task

RULES = 4
"""Number of fixed rules that `best-of-first` tries."""

SCREENED, STARTS = 256, 8
"""Points that fill the ranges, and the best ones of them, from which a search by least squares starts."""

SIMULATED, SAMPLES = 1024, 64
"""Number of draws of SimOpt's Gaussian for an update, and of draws for which its task policy is trained, as many as for
UDR."""

FIRST_STD, LEAST_STD = 0.25, 0.01
"""Standard deviation of SimOpt's first Gaussian, and the smallest one, in fractions of the ranges."""

BOUND = 1.0
"""Largest Kullback-Leibler divergence of an update from the Gaussian before it."""

ABSOLUTE, SQUARED = 0.5, 1.0
"""Weights of the absolute and of the squared distances between trajectories."""


def create_best_of_first(task: Task, checkpoint: Checkpoint | None) -> BestOfFirst:
    """The best of `adaptsim`'s actions before any trial. Raises CheckpointError if the checkpoint cannot predict."""
    reward_table = reward_table_of("best-of-first", task, checkpoint)
    assert checkpoint is not None  # it holds the reward table
    return BestOfFirst(AdaptSim(Simulators(checkpoint.solver, reward_table)))


@dataclass(frozen=True, eq=False)
class BestOfFirst:
    """A `Method` with `OwnPolicies`, which tries `RULES` fixed policies in turn."""

    before: AdaptSim

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The first rules."""
        return self._turn(0, n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The next rules in turn."""
        return self._turn(len(history), len(history[-1]))

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The particle's rule, which was fixed before any trial."""
        return policy_of(self.before, self.before.simulators.solver, particle, (), executable)

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The rule with the highest mean reward; the earliest of equal ones."""
        earned: dict[bytes, list[float]] = {}
        particles: dict[bytes, Particle] = {}
        for tried in (tried for iteration in history for tried in iteration):
            key = tried.particle.samples.tobytes()
            particles[key] = tried.particle
            earned.setdefault(key, []).extend(trial.reward for trial in tried.trials)
        best = max(earned, key=lambda key: float(np.mean(earned[key])) if earned[key] else -1.0)
        return self.policy(particles[best], history, executable)

    def _turn(self, iteration: int, n: int) -> tuple[Particle, ...]:
        rules = self.before.start(max(RULES, n), np.random.default_rng(0))
        return tuple(rules[(iteration * n + k) % len(rules)] for k in range(n))


def create_least_squares(task: Task, checkpoint: Checkpoint | None) -> LeastSquares:
    """Raises CheckpointError unless trials of the task repeat exactly what its solver predicts."""
    if checkpoint is None or not is_exact(checkpoint.solver):
        raise CheckpointError(f"least-squares needs an exact simulator of trials that repeat, and {task.name} has none")
    return LeastSquares(checkpoint.solver)


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """A `Method` with `OwnPolicies`: the parameters of the margin that repeat the trajectories best."""

    solver: Solver

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The middle of Omega."""
        return (Particle(self.solver.task.parameters.middle[None]),) * n

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The best fit to all trajectories."""
        return (Particle(self.fit(history)[None]),) * len(history[-1])

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The solver's policy for the particle."""
        return policy_for(self.solver, particle.samples, executable)

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The solver's policy for the best fit."""
        return policy_for(self.solver, self.fit(history)[None], executable)

    def fit(self, history: Sequence[Iteration]) -> Array:
        """(p,) in units."""
        trials, space = trials_in(history), self.solver.task.margin

        def residuals(points: Array) -> Array:
            return _residuals(self.solver, trials, space.denormalise(points))

        even = space.normalise(cover(space, SCREENED, np.random.default_rng(0)))
        starts = even[np.argsort((residuals(even) ** 2).sum(axis=1), kind="stable")[:STARTS]]
        points, left = descend(residuals, starts, (np.zeros(len(space)), np.ones(len(space))))
        return np.asarray(space.denormalise(points[int(left.argmin())]))


def create_simopt(task: Task, checkpoint: Checkpoint | None) -> SimOpt:
    """Raises CheckpointError without a checkpoint, whose solver simulates trials and trains policies."""
    if checkpoint is None:
        raise CheckpointError(f"simopt needs a checkpoint: make one with `adaptsim pretrain --task {task.name}`")
    return SimOpt(checkpoint.solver)


@dataclass(frozen=True, eq=False)
class SimOpt:
    """A `Method` with `OwnPolicies`: Algorithm 1 of Chebotar et al. 2019, with relative entropy policy search.

    All particles are the same Gaussian over the ranges, so every iteration updates it by all of its trials. A solver
    trains the task policies, and observations have few moments, so they are not smoothed over time.
    """

    solver: Solver

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """A wide Gaussian in the middle of Omega."""
        return self._particles((), n)

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The Gaussian after all iterations."""
        return self._particles(history, len(history[-1]))

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The solver's policy for draws from the Gaussian."""
        return policy_for(self.solver, particle.samples, executable)

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The solver's policy for draws from the Gaussian after all iterations."""
        return policy_for(self.solver, self._particles(history, 1)[0].samples, executable)

    def gaussian(self, history: Sequence[Iteration]) -> tuple[Array, Array]:
        """Mean (p,) and covariance (p, p) after the iterations, in fractions of the ranges."""
        p = len(self.solver.task.parameters)
        mean, covariance = np.full(p, 0.5), FIRST_STD**2 * np.eye(p)
        for number, iteration in enumerate(history):
            if trials := trials_in((iteration,)):
                mean, covariance = self._updated(mean, covariance, trials, np.random.default_rng(number))
        return mean, covariance

    def _particles(self, history: Sequence[Iteration], n: int) -> tuple[Particle, ...]:
        points = _drawn(*self.gaussian(history), SAMPLES, np.random.default_rng(0))
        return (Particle(self.solver.task.parameters.spread(points)),) * n

    def _updated(
        self, mean: Array, covariance: Array, trials: Sequence[Trial], rng: np.random.Generator
    ) -> tuple[Array, Array]:
        require_whole("simopt", trials)
        space = self.solver.task.parameters
        points = _drawn(mean, covariance, SIMULATED, rng)
        off = _residuals(self.solver, trials, space.spread(points))
        cost = ABSOLUTE * np.abs(off).sum(axis=1) + SQUARED * (off**2).sum(axis=1)
        weights = _bounded_weights(cost)
        middle = weights @ points
        apart = points - middle
        return middle, (weights[:, None] * apart).T @ apart + LEAST_STD**2 * np.eye(len(middle))


def _bounded_weights(cost: Array) -> Array:
    """(N,) weights of samples. They lower the mean of `cost` (N,) as far as the bound on the divergence allows (Peters
    et al. 2010).

    The temperature minimises the dual function.
    """
    scaled = (cost - cost.min()) / max(float(cost.std()), 1e-12)

    def dual(log_temperature: float) -> float:
        temperature = float(np.exp(log_temperature))
        return temperature * BOUND + temperature * float(np.log(np.mean(np.exp(-scaled / temperature))))

    temperature = float(np.exp(minimize_scalar(dual, bounds=(-8.0, 6.0), method="bounded").x))
    likely = np.exp(-scaled / temperature)
    return np.asarray(likely / likely.sum())


def _drawn(mean: Array, covariance: Array, n: int, rng: np.random.Generator) -> Array:
    """(n, p) draws of the Gaussian in [0, 1); those outside are moved to the nearest edge."""
    return np.clip(rng.multivariate_normal(mean, covariance, n), 0.0, 1.0 - 1e-9)


def _residuals(solver: Solver, trials: Sequence[Trial], parameters: Array) -> Array:
    """(N, p) -> (N, observed) simulated minus observed trajectories, the nuisance in the middle of its range."""
    n, task = len(parameters), solver.task
    parts = []
    for trial in trials:
        nuisance = np.tile(task.nuisance.middle, (n, 1))
        paths = solver.trajectories(parameters, np.tile(trial.action, (n, 1)), nuisance, np.tile(trial.context, (n, 1)))
        parts.append(paths - trial.observation)
    return np.concatenate(parts, axis=1)
