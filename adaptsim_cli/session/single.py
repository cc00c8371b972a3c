"""A single trial with an action chosen by hand or by a policy. Nothing is adapted, and no session changes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from adaptsim_cli.config import Config
from adaptsim_cli.errors import PreflightFailed, UsageError
from adaptsim_cli.outputs.trials import Rollout
from adaptsim_cli.screen import console, views
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.views import failures
from adaptsim_cli.session.flow import motion_record, propose, show_proposal, trial_record
from adaptsim_cli.session.operator import Attended, Operator, Unattended
from adaptsim_cli.session.records import TrialRecord, now
from adaptsim_cli.session.target import Parts, Placed, Planned, Target
from adaptsim_cli.session.watching import AllOf, Watcher
from adaptsim_cli.storage import durable
from hw.errors import MotionRefused
from hw.types import Array
from perception.errors import PerceptionError
from sim.adaptation.method import Iteration, Particle
from sim.adaptation.stages import RunTrial, TrialKey
from sim.errors import NotExecutable
from sim.tasks.task import Task


@dataclass(frozen=True)
class Chosen:
    """The operator's choices, each as name=value."""

    context: Sequence[str]
    action: Sequence[str]  # missing ones come from the policy
    parameters: Sequence[str]  # the policy is trained for them; missing ones: the middle of Omega
    session: str | None = None  # if given: use its final policy instead, after `history`
    history: tuple[Iteration, ...] = ()
    number: int = 1  # of this one among several, for the lab's chance

    @property
    def stage(self) -> RunTrial:
        """The trial in the terms of a session."""
        return RunTrial(iteration=0, particle=0, trial=0, key=TrialKey(self.number, 0), interrupted=False)


def typed(task: Task, chosen: Chosen) -> tuple[Array, Array]:
    """(context (c,), parameters (p,)) as typed, missing ones from the middle of the range; checks the action too.

    Raises UsageError for a wrong name or value.
    """
    drawn = views.point(task.context, chosen.context, task.reference_context, "--context")
    middle = task.parameters.middle
    mean = views.point(task.parameters, chosen.parameters, middle, "--param")
    views.point(task.action, chosen.action, task.action.low, "--action")
    return drawn, mean


def drawn(task: Task, seed: tuple[int, int], count: int) -> list[list[str]]:
    """So many random contexts as name=value; the same seed draws the same ones."""
    rows = task.context.sample(np.random.default_rng(seed), count)
    return [[f"{name}={float(v)!r}" for name, v in zip(task.context.names, row, strict=True)] for row in rows]


def rollout(
    config: Config,
    parts: Parts,
    chosen: Chosen,
    screen: Screen,
    folder: Path,
    *,
    yes: bool,
    watcher: Watcher | None = None,
) -> Rollout:
    """Set up, propose, confirm, execute, track and store one trial in `folder`; returns its record.

    Raises UsageError for a wrong value, and the errors of a session's trial. The recording is stored before it is
    tracked, and stays if tracking fails.
    """
    task, target = parts.task, parts.target
    unattended = yes and not target.is_real
    if not unattended:
        console.require_terminal()
    operator = Unattended(screen) if unattended else Attended(screen)
    context, mean = typed(task, chosen)
    if folder.exists():
        raise UsageError(f"{folder} exists already: name another --out")
    durable.require_writable(folder.parent)
    if problem := failures(target.checks()):
        raise PreflightFailed(f"not ready, nothing has moved: {problem}")

    with screen.busy("Training the task policy", "training"):
        learner, history = parts.learner, chosen.history
        policy = learner.final(history) if history else learner.train(Particle(mean[None]), ())
    placed = _place(target, chosen.stage, context, operator, screen)
    with screen.busy("Choosing the action: the best that the arm can do", "choosing"):
        proposed = policy(placed.context)
    action = views.point(task.action, chosen.action, proposed, "--action")
    planned = _plan(task, target, placed, action, screen)
    picture = folder.with_name(f"{folder.name}-overlay.jpg")
    try:
        proposal = propose(task, chosen.stage, mean, policy, planned, partial(_keep, picture))
        show_proposal(task, proposal, planned, screen, watcher or AllOf())
        operator.approve(proposal, target.is_real, target.release)
        started = now()
        executed = target.execute(planned, screen.busy)
        with screen.busy("Storing the recording", "storing"):
            durable.make_folder(folder.parent)
            files, recorded = executed.stored()
            durable.write_folder(folder, files)
        if executed.stopped is not None:
            raise executed.stopped
    finally:
        picture.unlink(missing_ok=True)  # the folder holds it from now on
    seen = target.track(placed.context, action, recorded, screen.busy)
    record = trial_record(task, motion_record(proposal, started, executed, screen.lap_s()), seen)
    (watcher or AllOf()).tracked(record, seen)
    shown = _shown(config, parts, record, chosen)
    content = json.dumps(shown.model_dump(mode="json"), allow_nan=False, indent=1).encode()
    durable.complete_folder(folder, seen.files, "trial.json", content)
    return shown


def _place(target: Target, stage: RunTrial, drawn: Array, operator: Operator, screen: Screen) -> Placed:
    """Have the object placed; if it is not found, try again as often as the operator wants."""
    while True:
        try:
            return target.place(drawn, stage.key, operator, screen.busy)
        except PerceptionError as error:
            screen.note(f"Attempt {stage.key.attempt + 1}, nothing has moved: {error}")
            if not operator.try_again(stage):
                raise
        stage = replace(stage, key=TrialKey(stage.key.number, stage.key.attempt + 1))


def _plan(task: Task, target: Target, placed: Placed, action: Array, screen: Screen) -> Planned:
    """The motion, within every limit. Raises NotExecutable or MotionRefused, which name the command to find one."""
    try:
        return target.plan(placed, action, screen.busy)
    except (NotExecutable, MotionRefused) as error:
        error.add_note(
            "Nothing has moved. Choose another --action: adaptsim preview "
            f"--task {task.name} --action name=value shows how close a motion comes to every limit"
        )
        raise


def _keep(path: Path, overlay: bytes) -> Path:
    """Write the picture of the detection to a file that a person can open before agreeing."""
    durable.replace_file(path, overlay)
    return path


def _shown(config: Config, parts: Parts, record: TrialRecord, chosen: Chosen) -> Rollout:
    """The trial as it is stored and printed."""
    task = parts.task
    spaces = (task.parameters, task.context, task.action)
    return Rollout(
        task=task.name,
        hw=config.hw,
        world=config.lab_world,
        seed=config.seed,
        units={d.name: d.unit for space in spaces for d in space.dimensions},
        params=None if chosen.action else record.parameters,
        session=None if chosen.action else chosen.session,
        iterations=len(chosen.history),
        context=record.context,
        goal_m=record.goal_m,
        action=record.action,
        camera_late_s=parts.provenance.camera_late_s,
        outcome=record.outcome,
        reward=record.reward,
        flags=record.track.flags,
        observation=record.observation,
        track=record.track,
        when=record.started,
    )
