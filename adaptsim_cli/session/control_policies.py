"""The policies of a session's control trials: the first ones of a method, or the best one of another session."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli import config as settings
from adaptsim_cli.config import Config
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session.control import ControlPolicies, ControlPolicy
from adaptsim_cli.session.history import history_of, results_of
from adaptsim_cli.session.store import SessionStore
from sim.errors import UnknownName

if TYPE_CHECKING:
    from sim.adaptation.checkpoint import Checkpoint
    from sim.tasks.task import Executable, Policies


def control_of(
    config: Config, checkpoint: Checkpoint, policies: Policies, executable: Executable | None
) -> tuple[ControlPolicies | None, str]:
    """The control of the settings, and the SHA-256 of its session's record, "" for a method; none without a control.

    Raises UsageError for an unknown name or an unfit session, SessionError.
    """
    from sim.adaptation.methods import make_method

    if not config.control:
        return None, ""
    try:
        method = make_method(config.control, checkpoint.solver.task, checkpoint)
    except UnknownName as error:
        return _of_session(config, checkpoint, policies, executable, str(error))

    def train() -> tuple[ControlPolicy, ...]:
        """Policies that have learnt nothing from trials. There are as many as for the stated reward of UDR."""
        from sim.adaptation.method import OwnPolicies
        from sim.adaptation.methods.udr import DRAWS
        from sim.solvers.solver import policy_for

        particles = method.start(DRAWS, np.random.default_rng(0))
        return tuple(
            ControlPolicy(
                method.policy(particle, (), executable)
                if isinstance(method, OwnPolicies)
                else policy_for(policies, particle.samples, executable, seed=k),
                particle.mean,
            )
            for k, particle in enumerate(particles)
        )

    return train, ""


def _of_session(
    config: Config, checkpoint: Checkpoint, policies: Policies, executable: Executable | None, unknown: str
) -> tuple[ControlPolicies, str]:
    """The best policy of a stored session. `unknown`: why the name is not that of a method."""
    from sim.adaptation.judging import assess, final_policy
    from sim.adaptation.methods import make_method

    try:
        store = SessionStore.open(settings.places().sessions, config.control)
    except SessionError as error:
        raise UsageError(f"--control {config.control}: {error}; and {unknown}") from error
    facts, results, task = store.facts, results_of(store), checkpoint.solver.task
    if facts.checkpoint_sha256 != checkpoint.sha256:
        raise UsageError(
            f"--control {config.control}: that session has the checkpoint {facts.checkpoint} "
            f"({facts.checkpoint_sha256[:12]}), and this one {checkpoint.path.name} ({checkpoint.sha256[:12]})"
        )
    if not results:
        raise UsageError(f"--control {config.control}: that session has no complete iteration, so no best policy")
    history = history_of(task, store, results[-1].iteration - 1)

    def train() -> tuple[ControlPolicy, ...]:
        method = make_method(facts.method, task, checkpoint)
        best, _ = assess(method, task, history)
        return (ControlPolicy(final_policy(method, policies, task, history, executable), best.particle.mean),)

    return train, hashlib.sha256(results[-1].summary_sha256.encode()).hexdigest()
