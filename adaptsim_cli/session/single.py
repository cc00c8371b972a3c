"""A rollout: a session without adaptation. Its actions are chosen by hand or by a policy, and nothing is adapted."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from adaptsim_cli.config import Config
from adaptsim_cli.errors import PreflightFailed, UsageError
from adaptsim_cli.screen import console, quantities
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.outputs.trials import PlayedTrial, Rollout
from adaptsim_cli.screen.views import failures
from adaptsim_cli.session.beginning import NO_CONSENT, facts_for
from adaptsim_cli.session.ending import before_adapting
from adaptsim_cli.session.flow import RunningSession, stages
from adaptsim_cli.session.folders import folder_of
from adaptsim_cli.session.operator import Attended, Unattended
from adaptsim_cli.session.records import ROLLOUT, SessionStart, TrialRecord
from adaptsim_cli.session.results import rows_of
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.watching import AllOf, Watcher, logged
from hw.errors import MotionRefused
from hw.types import Array
from sim.adaptation.method import Iteration, Particle
from sim.adaptation.stages import RunTrial
from sim.errors import NotExecutable
from sim.tasks.task import SolvedPolicy, Task


@dataclass(frozen=True)
class Chosen:
    """The operator's choices for a rollout, each as name=value."""

    contexts: Sequence[Sequence[str]] = field(default_factory=lambda: ((),))  # of each trial
    action: Sequence[str] = ()  # missing ones come from the policy
    parameters: Sequence[str] = ()  # the policy is trained for them; missing ones: the middle of Omega
    session: str | None = None  # if given: use its final policy instead, after `history`
    history: tuple[Iteration, ...] = ()


def typed(task: Task, chosen: Chosen) -> tuple[Array, Array]:
    """The typed contexts (n, c) and parameters (p,); those not typed are the middle of their range. The action is
    checked too.

    Raises UsageError for a wrong name or value.
    """
    contexts = [quantities.point(task.context, named, task.reference_context, "--context") for named in chosen.contexts]
    mean = quantities.point(task.parameters, chosen.parameters, task.parameters.middle, "--param")
    quantities.point(task.action, chosen.action, task.action.low, "--action")
    return np.array(contexts), mean


def drawn(task: Task, seed: tuple[int, int], count: int) -> list[list[str]]:
    """Random contexts as name=value; the same seed draws the same ones."""
    rows = task.context.sample(np.random.default_rng(seed), count)
    return [[f"{name}={float(v)!r}" for name, v in zip(task.context.names, row, strict=True)] for row in rows]


@dataclass(frozen=True, eq=False)
class ChosenActions:
    """A `SolvedPolicy` whose action is chosen by hand; the values that are missing come from `policy`."""

    task: Task
    policy: SolvedPolicy
    action: Sequence[str]  # as name=value

    def __call__(self, context: Array) -> Array:
        """See `SolvedPolicy`."""
        return quantities.point(self.task.action, self.action, self.policy(context), "--action")

    def actions(self, contexts: Array) -> Array:
        """See `SolvedPolicy`."""
        return np.array([self(context) for context in contexts])

    def predict(self, context: Array) -> tuple[float, float, float]:
        """See `SolvedPolicy`: the reward that the policy expects of its own action."""
        return self.policy.predict(context)


def rollout(
    config: Config,
    parts: SessionParts,
    chosen: Chosen,
    screen: Screen,
    folder: Path,
    *,
    yes: bool,
    watcher: Watcher | None = None,
) -> SessionStore:
    """Run the trials as a session in `folder`, and return it. If nothing moved, no session is left.

    Raises UsageError for a wrong value, and the errors of a session's trials.
    """
    task, target = parts.task, parts.target
    unattended = yes and not target.needs_consent
    if not unattended:
        console.require_terminal(NO_CONSENT if target.needs_consent else console.NO_TERMINAL)
    operator = Unattended(screen) if unattended else Attended(screen)
    contexts, mean = typed(task, chosen)
    if folder_of(folder.parent, folder.name).exists():
        raise UsageError(f"{folder} exists already: name another --out")
    facts = facts_for(
        folder.name, config, parts, method=ROLLOUT, policy_of=chosen.session or "", particles=1, trials=len(contexts)
    )
    particle = Particle(mean[None])
    store = SessionStore.create(folder.parent, facts, SessionStart(particles=(rows_of(particle),)))
    try:
        if problem := failures(target.checks()):
            raise PreflightFailed(f"not ready, nothing has moved: {problem}")
        with screen.busy("Training the task policy", "training"):
            adaptation, history = parts.adaptation, chosen.history
            policy = adaptation.final(history) if history else adaptation.train(particle, ())

        def context_of(stage: RunTrial) -> Array:
            return np.asarray(contexts[stage.trial])

        with ExitStack() as stack:
            stack.enter_context(store.locked())
            log = stack.enter_context(logged(store, screen, parts.provenance.versions))
            watchers = AllOf(log) if watcher is None else AllOf(watcher, log)
            session = RunningSession(store, parts, operator, screen, watchers, context_of=context_of)
            session.policies[0, 0] = ChosenActions(task, policy, chosen.action)
            for stage in stages(session):
                if before_adapting(session, stage):
                    break
    except (NotExecutable, MotionRefused) as error:
        error.add_note(
            "Nothing has moved. Choose another --action: adaptsim preview "
            f"--task {task.name} --action name=value shows how close a motion comes to every limit"
        )
        raise
    finally:
        if not store.existing().started:
            shutil.rmtree(store.folder)
    return store


def rollout_output(store: SessionStore, record: TrialRecord, chosen: Chosen) -> Rollout:
    """A trial of a rollout, as it is printed."""
    facts = store.facts
    return Rollout(
        **dict(record.view(PlayedTrial)),
        task=facts.task,
        hw=facts.hw,
        world=facts.world,
        seed=facts.seed,
        units=facts.units,
        params=None if chosen.action else record.parameters,
        session=facts.policy_of or None,
        iterations=len(chosen.history),
        goal_m=record.goal_m,
        camera_late_s=facts.camera_late_s,
        flags=record.track.flags,
        track=record.track,
        when=record.started,
    )
