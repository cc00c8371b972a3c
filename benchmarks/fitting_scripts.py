"""Scripts that adapt a task as a student would write them: infer the parameters from all trajectories, then take the
best of 64 simulated actions. They differ in the inference:

* `scipy`: the parameters that fit best, by `scipy.optimize.least_squares`;
* `mujoco-sysid`: the same by `mujoco.sysid.optimize`, which needs `pip install "mujoco[sysid]"`;
* `sbi`: the posterior of sbi's NPE with its usual network, learnt from rollouts of the executed actions;
* `dropo`: the normal distribution of parameters under which the trajectories are likeliest, as in DROPO (Tiboni, Arndt
  and Kyrki 2023), but over whole trajectories, because a task of one file cannot begin in the middle of one.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize

from hw.types import Array
from sim.adaptation.method import Iteration, Particle, trials_in
from sim.rollouts.draws import cover
from sim.rollouts.executors import serial_executor
from sim.rollouts.kept import KeptRollouts
from sim.rollouts.run import Requests, Rollouts
from sim.tasks.task import Executable, SolvedPolicy, Task

Simulate = Callable[[Array], Array]
"""Parameters (n, p), normalised by their ranges -> the observations (n, r) of all executed trials."""

Inference = Callable[[Simulate, Array, int], Array]
"""Simulation, what was observed (r,), and p -> equally likely parameters (m, p), normalised."""

STEP, EVALUATIONS = 0.02, 20
"""Step of a difference quotient, and most steps of a fit."""

SIMULATED, DRAWN = 256, 8
"""Draws from the prior for sbi, and draws from a posterior for its policy."""

PARTICLES, LIKELIHOODS, WIDTH, TOLERANCE = 8, 60, 0.3, 0.005
"""DROPO's parameters per likelihood, most likelihoods, first standard deviation, and tolerated deviation."""

ACTIONS = 64


def scipy_fit(simulate: Simulate, observed: Array, p: int) -> Array:
    """The best parameters by scipy."""

    def residuals(unit: Array) -> Array:
        return np.asarray(simulate(unit[None])[0] - observed)

    fit = least_squares(residuals, np.full(p, 0.5), bounds=(0, 1), diff_step=STEP, max_nfev=EVALUATIONS)
    return np.asarray(fit.x[None])


def mujoco_fit(simulate: Simulate, observed: Array, p: int) -> Array:
    """The best parameters by MuJoCo's toolbox for system identification."""
    from mujoco import sysid  # noqa: PLC0415 - only this way needs it

    def residual(unit: Array, parameters: Any) -> tuple[list[Array], None, None]:
        rows = simulate(np.atleast_2d(unit.T)) - observed
        return [rows.T if unit.ndim == 2 else rows[0]], None, None

    unit = sysid.Parameter("unit", np.full(p, 0.5), np.zeros(p), np.ones(p))
    fit, _ = sysid.optimize(
        sysid.ParameterDict({"unit": unit}), residual, verbose=False, max_iters=EVALUATIONS, eps=STEP
    )
    return np.asarray(fit.as_vector()[None])


def sbi_posterior(simulate: Simulate, observed: Array, p: int) -> Array:
    """Draws from the posterior of neural posterior estimation; those outside of the ranges are moved to their edge."""
    import torch  # noqa: PLC0415 - only this way needs it
    from sbi.inference import NPE  # noqa: PLC0415
    from sbi.utils import BoxUniform  # noqa: PLC0415

    from sim.research.methods.search import calculating  # noqa: PLC0415
    from sim.research.methods.sysid import silent_tracker  # noqa: PLC0415

    unit = np.random.default_rng(0).random((SIMULATED, p))
    pairs = [torch.tensor(array, dtype=torch.float32) for array in (unit, simulate(unit))]
    with calculating(0):
        training = NPE(BoxUniform(torch.zeros(p), torch.ones(p)), tracker=silent_tracker(), show_progress_bars=False)
        network = training.append_simulations(*pairs).train()
        with torch.no_grad():
            drawn = network.sample((DRAWN,), torch.tensor(observed[None], dtype=torch.float32))
    return np.asarray(np.clip(drawn.reshape(DRAWN, p).double().numpy(), 0.0, 1.0))


def dropo_distribution(simulate: Simulate, observed: Array, p: int) -> Array:
    """Draws from the likeliest normal distribution."""
    noise = np.random.default_rng(0).standard_normal((PARTICLES, p))

    def draws(mean_and_width: Array) -> Array:
        return np.clip(mean_and_width[:p] + np.exp(mean_and_width[p:]) * noise, 0.0, 1.0)

    def unlikeliness(mean_and_width: Array) -> float:
        paths = simulate(draws(mean_and_width))
        variance = paths.var(axis=0) + TOLERANCE**2
        return float(((observed - paths.mean(axis=0)) ** 2 / variance + np.log(variance)).mean())

    start = np.repeat([0.5, np.log(WIDTH)], p)
    bounds = [(0.0, 1.0)] * p + [(np.log(1e-3), 0.0)] * p
    best = minimize(unlikeliness, start, method="Nelder-Mead", bounds=bounds, options={"maxfev": LIKELIHOODS})
    return draws(best.x)


INFERENCES: dict[str, Inference] = {
    "scipy": scipy_fit,
    "mujoco-sysid": mujoco_fit,
    "sbi": sbi_posterior,
    "dropo": dropo_distribution,
}


@dataclass(frozen=True, eq=False)
class ListedPolicy:
    """The simulated action that earns most in a context, on average over parameters."""

    script: FittingScript
    parameters: Array  # (m, p)
    listed: Array  # (A, a)

    def actions(self, contexts: Array) -> Array:
        """(G, c) -> (G, a)"""
        return self.listed[[int(self._rewards(context).argmax()) for context in contexts]]

    def __call__(self, context: Array) -> Array:
        """(c,) -> (a,)"""
        return np.asarray(self.actions(context[None])[0])

    def predict(self, context: Array) -> tuple[float, float, float]:
        """The reward of the best action."""
        best = float(self._rewards(context).max())
        return best, best, best

    def _rewards(self, context: Array) -> Array:
        m, listed = len(self.parameters), len(self.listed)
        contexts = np.tile(context, (m * listed, 1))
        parameters, actions = np.repeat(self.parameters, listed, axis=0), np.tile(self.listed, (m, 1))
        rollouts = self.script.simulated(parameters, contexts, actions)
        return np.asarray(rollouts.rewards(self.script.task, contexts).reshape(m, listed).mean(axis=0))


class FittingScript:
    """A student's script: infer the parameters from all trajectories, then take the best of the simulated actions."""

    def __init__(self, task: Task, infer: Inference) -> None:
        self.task, self.infer, self.roll = task, infer, KeptRollouts(task, serial_executor())
        self._inferred: dict[bytes, Array] = {}  # by trials

    def start(self, n: int, rng: np.random.Generator) -> tuple[Particle, ...]:
        """The middle of the ranges."""
        return (Particle(self.task.parameters.middle[None]),) * n

    def next(self, history: Sequence[Iteration], rng: np.random.Generator) -> tuple[Particle, ...]:
        """The parameters inferred from all trajectories."""
        trials = trials_in(history)
        contexts = np.stack([trial.context for trial in trials])
        actions = np.stack([trial.action for trial in trials])
        observed = np.concatenate([trial.observation for trial in trials])

        def simulate(unit: Array) -> Array:
            n, parameters = len(unit), self.task.parameters.denormalise(unit)
            each = np.repeat(parameters, len(trials), axis=0)
            rollouts = self.simulated(each, np.tile(contexts, (n, 1)), np.tile(actions, (n, 1)))
            return np.asarray(rollouts.observation.reshape(n, -1))

        key = b"".join(trial.key for trial in trials)
        if key not in self._inferred:
            self._inferred[key] = self.infer(simulate, observed, len(self.task.parameters))
        return (Particle(self.task.parameters.denormalise(self._inferred[key])),) * len(history[-1])

    def policy(
        self, particle: Particle, history: Sequence[Iteration], executable: Executable | None = None
    ) -> SolvedPolicy:
        """The best of the actions at these parameters."""
        return ListedPolicy(self, particle.samples, cover(self.task.action, ACTIONS, np.random.default_rng(0)))

    def final(self, history: Sequence[Iteration], executable: Executable | None = None) -> SolvedPolicy:
        """The policy of the last inference."""
        return self.policy(self.next(history, np.random.default_rng(0))[0], history)

    def simulated(self, parameters: Array, contexts: Array, actions: Array) -> Rollouts:
        """Rollouts of actions (N, a) at contexts (N, c) and parameters (p,) or (N, p). A context moves things only if
        the simulation takes it.
        """
        task, n = self.task, len(actions)
        reference = np.tile(np.asarray(task.reference_context), (n, 1))
        where = contexts if task.relocate is None else reference
        each = np.broadcast_to(parameters, (n, len(task.parameters)))
        return self.roll(Requests(each, where, actions, np.tile(task.nuisance.middle, (n, 1))))


def lines_of(way: str) -> int:
    """Lines of the script, its inference included."""
    return sum(len(inspect.getsource(part).splitlines()) for part in (FittingScript, ListedPolicy, INFERENCES[way]))
