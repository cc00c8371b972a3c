"""The truth behind a simulated session, beside its belief: shown to people after it, never read by learning."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.config import is_simulated
from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen.outputs.learning import Revealed, RevealedParameter
from adaptsim_cli.session.folders import names
from adaptsim_cli.session.history import results_of, trials_of
from adaptsim_cli.session.records import ROLLOUT
from adaptsim_cli.session.store import SessionStore
from sim.errors import CollapsedPosterior, SimError
from sim.storage.places import data_folder

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.posterior import Posterior
    from sim.lab.world import World
    from sim.tasks.task import Task

BELIEVED = (0.05, 0.5, 0.95)
"""Lower end, median and upper end of a session's posterior of a parameter."""

CONTEXTS = 4
"""Contexts in which each policy of UDR is tried."""

_NO_EFFECTS = ("colour", "contact", "dt_s")
"""Entries of a world that only decide how it is computed or looks."""

PARALLEL_FROM_S = 5.0
"""Rollouts that take longer together are spread over processes, whose start takes seconds."""


def revealed(store: SessionStore, checkpoint: Checkpoint, posterior: Callable[[], Posterior]) -> Revealed | None:
    """Truth, range and belief of each parameter; None without a simulated truth, a trial, or a posterior to show.

    `posterior` makes that of the session. Raises SessionError on damage.
    """
    from sim.lab.world import load_world

    facts = store.facts
    if not is_simulated(facts.hw) or facts.recorded or not (trials := trials_of(store)):
        return None
    try:
        task, world = checkpoint.solver.task, load_world(facts.world, checkpoint.solver.task)
        final = posterior()
        believed = _levels(final)
        udr = _udr_rewards(checkpoint, world)
    except SimError:
        return None
    results = results_of(store)
    best = results[-1].best if results else None
    return Revealed(
        session=facts.name,
        method=facts.method,
        world=world.name,
        parameters=[
            RevealedParameter(
                name=d.name, plain_name=d.plain_name, unit=d.unit, meaning=d.meaning, scale=d.scale,
                truth=float(truth), low=d.low, high=d.high, believed=ends, kinds=[*d.kinds],
                chances=None if (chances := final.chances(index)) is None else [*chances],
            )
            for index, (d, truth, ends) in enumerate(
                zip(task.parameters.dimensions, world.parameters, believed, strict=True)
            )
        ],
        unmodelled=_unmodelled(task, world),
        trials=len(trials),
        rewards=[
            float(np.mean([trial.reward for trial in trials if trial.iteration == number]))
            for number in range(1, max(len(results), 1) + 1)
        ],
        chosen_after=best.chosen_after if best is not None and best.tried else None,
        udr_reward=float(np.mean(udr)),
        udr_trials=len(udr),
    )  # fmt: skip


def newest_in(root: Path, task: str, world: str) -> SessionStore | None:
    """The newest session that adapted in a simulated world; unreadable ones are skipped."""
    for name in reversed(names(root)):
        with suppress(SessionError):
            store = SessionStore.open(root, name)
            facts = store.facts
            is_here = (facts.task, facts.world, facts.recorded) == (task, world, "") and is_simulated(facts.hw)
            if is_here and facts.method != ROLLOUT and trials_of(store):
                return store
    return None


def _unmodelled(task: Task, world: World) -> list[str]:
    """The effects in which a world differs from training, or from the scene of an own object, by name; pictures and
    time steps are not effects.
    """
    trained = vars(task.unmodelled() if task.scene is None else task.scene)
    return [
        name for name, value in vars(world.unmodelled).items() if name not in _NO_EFFECTS and value != trained[name]
    ]


def _levels(posterior: Posterior) -> Sequence[tuple[float, float, float] | None]:
    """Lower end, median and upper end of each parameter; None where the posterior offers no interval."""
    try:
        return [(low, middle, high) for low, middle, high in posterior.quantiles(BELIEVED).T.tolist()]
    except CollapsedPosterior:
        return [None] * len(posterior.space)


@lru_cache(maxsize=8)
def _udr_rewards(checkpoint: Checkpoint, world: World) -> tuple[float, ...]:
    """The rewards of the policies of UDR in a world, without arm or camera, in a few even contexts.

    They are simulated once, in parallel where they are slow, and kept in the data folder by the hash of checkpoint and
    world.
    """
    from sim.adaptation.methods.udr import DRAWS, udr_policies
    from sim.lab.rollout import task_in
    from sim.rollouts.draws import cover
    from sim.rollouts.executors import process_pool, serial_executor
    from sim.rollouts.run import Requests, concatenate, run_many
    from sim.rollouts.shards import read_rollouts, write_rollouts

    task = checkpoint.solver.task
    contexts = cover(task.context, CONTEXTS if len(task.context) else 1, np.random.default_rng(0))
    middle = task.nuisance.denormalise(np.full(len(task.nuisance), 0.5))
    of_udr = DRAWS if checkpoint.reward_table is not None else 1  # else each one costs hundreds of rollouts
    policies = udr_policies(checkpoint.solver, np.random.default_rng(0), of_udr)
    count = len(policies) * len(contexts)
    requests = Requests(
        np.tile(world.parameters, (count, 1)),
        np.tile(contexts, (len(policies), 1)),
        np.concatenate([policy.actions(contexts) for policy in policies]),
        np.tile(middle, (count, 1)),
    )
    identity = repr(
        (checkpoint.sha256, world.parameters.tolist(), world.nuisance.tolist(), world.unmodelled, world.physics)
    )
    path = data_folder() / "truth" / f"{hashlib.sha256(identity.encode()).hexdigest()[:24]}.npz"
    rollouts = read_rollouts(path, requests)
    if rollouts is None:
        in_world = task_in(world, task)
        began = time.monotonic()
        with serial_executor() as crew:
            first = run_many(in_world, requests[:1], crew)
        slow = (time.monotonic() - began) * (count - 1) > PARALLEL_FROM_S
        with process_pool() if slow else serial_executor() as crew:
            rollouts = concatenate([first, run_many(in_world, requests[1:], crew)]) if count > 1 else first
        with suppress(OSError):  # a folder that cannot be written only costs time
            path.parent.mkdir(parents=True, exist_ok=True)
            write_rollouts(path, requests, rollouts)
    return tuple(float(reward) for reward in rollouts.rewards(task, requests.context))
