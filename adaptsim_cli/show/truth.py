"""The truth behind a simulated session, beside its belief: shown to people after it, never read by learning."""

from __future__ import annotations

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
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.records import ROLLOUT
from adaptsim_cli.session.store import SessionStore
from sim.errors import CollapsedPosterior, SimError

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.adaptation.posterior import Posterior
    from sim.lab.world import World

BELIEVED = (0.05, 0.5, 0.95)
"""Lower end, median and upper end of a session's posterior of a parameter."""

CONTEXTS = 4
"""Contexts in which each policy of UDR is tried."""


def revealed(store: SessionStore, checkpoint: Checkpoint, posterior: Callable[[], Posterior]) -> Revealed | None:
    """Truth, range and belief of each parameter; None if simulate is no truth, no trial, or no posterior to show.

    `posterior` makes that of the session. Raises SessionError on damage.
    """
    from sim.lab.world import load_world

    facts = store.facts
    if not is_simulated(facts.hw) or facts.recorded or not (trials := trials_of(store)):
        return None
    try:
        task, world = checkpoint.solver.task, load_world(facts.world, checkpoint.solver.task)
        believed = _levels(posterior())
        udr = _udr_rewards(checkpoint, world)
    except SimError:
        return None
    last = [trial.reward for trial in trials if trial.iteration == trials[-1].iteration]
    first = [trial.reward for trial in trials if trial.iteration == 1]
    return Revealed(
        session=facts.name,
        method=facts.method,
        world=world.name,
        parameters=[
            RevealedParameter(
                name=d.name, plain_name=d.plain_name, unit=d.unit, meaning=d.meaning, scale=d.scale,
                truth=float(truth), low=d.low, high=d.high, believed=ends,
            )
            for d, truth, ends in zip(task.parameters.dimensions, world.parameters, believed, strict=True)
        ],
        iterations=trials[-1].iteration,
        trials=len(trials),
        first_reward=float(np.mean(first)),
        last_reward=float(np.mean(last)),
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


def _levels(posterior: Posterior) -> Sequence[tuple[float, float, float] | None]:
    """Lower end, median and upper end of each parameter; None where the posterior offers no interval."""
    try:
        return [(low, middle, high) for low, middle, high in posterior.quantiles(BELIEVED).T.tolist()]
    except CollapsedPosterior:
        return [None] * len(posterior.space)


@lru_cache(maxsize=8)
def _udr_rewards(checkpoint: Checkpoint, world: World) -> tuple[float, ...]:
    """The rewards of the policies of UDR in a world, without arm or camera, in a few even contexts."""
    from sim.adaptation.methods.udr import udr_policies
    from sim.lab.world import rollouts_in
    from sim.rollouts.draws import cover

    task, simulate = checkpoint.solver.task, rollouts_in(world)
    contexts = cover(task.context, CONTEXTS if len(task.context) else 1, np.random.default_rng(0))
    middle = task.nuisance.denormalise(np.full(len(task.nuisance), 0.5))
    return tuple(
        task.score(simulate(world.parameters, context, action, middle), context)
        for policy in udr_policies(checkpoint.solver, np.random.default_rng(0))
        for context, action in zip(contexts, policy.actions(contexts), strict=True)
    )
