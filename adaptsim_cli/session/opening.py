"""Joins the parts of a session: settings -> devices, tracker, planner and adaptation."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptsim_cli.bench.checkpoints import task_of
from adaptsim_cli.bench.devices.opening import open_lab
from adaptsim_cli.bench.devices.trackers import tracker_of
from adaptsim_cli.bench.rig import Rig
from adaptsim_cli.bench.rig_frames import ground_of, hash_of
from adaptsim_cli.bench.touch_off_in_use import origin
from adaptsim_cli.config import PERSON, Config, Places, is_own, places
from adaptsim_cli.errors import UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.checkpoint import (
    checkpoint_in_session,
    cost_in_words,
    recordings_of,
    solver_of,
    started_from,
)
from adaptsim_cli.session.control_policies import control_of
from adaptsim_cli.session.folders import FACTS
from adaptsim_cli.session.own.exchange import Answerer
from adaptsim_cli.session.own.person import TypedAnswers
from adaptsim_cli.session.own.program import Program
from adaptsim_cli.session.own.target import OwnTarget
from adaptsim_cli.session.recorded.comparison import compared
from adaptsim_cli.session.records import SessionFacts
from adaptsim_cli.session.rig_sessions import own_ground
from adaptsim_cli.session.rig_target import RigTarget
from adaptsim_cli.session.session_policies import trained_policies, with_session_policies
from adaptsim_cli.session.simulated_target import RecordedTarget, SimulatedTarget
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import Provenance, SessionParts, Target
from adaptsim_cli.storage.durable import versions
from hw.braking import FULL
from perception.types import Outcome
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.method import Simulating
from sim.adaptation.methods import kind_of
from sim.adaptation.worth_in_words import worth_in_words
from sim.rollouts.recorded import RecordedTrials
from sim.tasks import files_of
from sim.tasks.task import Executable, Expectations, Policies, Task

if TYPE_CHECKING:
    from adaptsim_cli.bench.devices.drivers import Drivers
    from sim.adaptation.checkpoint import Checkpoint


@contextmanager
def open_parts(
    config: Config,
    learnt: Path,
    drivers: Drivers | None = None,
    own: SessionFacts | None = None,
    screen: Screen | None = None,
    answerer: Answerer | None = None,
) -> Iterator[SessionParts]:
    """All parts of a session, with its devices connected. `drivers` are those of a real lab's devices.

    With `own`, calibration and touch-off are those of this session instead of those in use. `answerer` answers for a
    robot of one's own, instead of the program or the person of the settings.

    NAF stores policies and rollouts in the folder `learnt`, which no other process may use meanwhile.

    Raises SimError, DeviceUnavailable, CalibrationMissing, UsageError.
    """
    with checkpoint_in_session(config, learnt) as unbiased:
        checkpoint, prior = started_from(unbiased, config)
        of_library, session = checkpoint, learnt.parent
        checkpoint = with_session_policies(of_library, session, config.workers, None)
        worth = tuple(worth_in_words(checkpoint.card.worth))
        training = checkpoint.solver.task.training
        train = partial(trained_policies, of_library, session, config.workers) if training is not None else None
        if config.recorded:
            yield _recorded_parts(config, checkpoint, prior, session)
            return
        with (
            _open_own_or_target(config, checkpoint.solver, session, drivers, own, screen, answerer) as opened,
            solver_of(checkpoint, config.solver, config.workers, learnt) as (policies, expectations),
        ):
            task, target, executable, rig = opened
            adaptation = _adaptation(config, checkpoint, policies, expectations, executable)
            control, sha256 = control_of(config, checkpoint, policies, executable)
            world = "" if config.is_own else _world_sha256(config.lab_world)
            origin = replace(_provenance(checkpoint, prior, world), control_sha256=sha256)
            if rig is not None:
                origin = replace(
                    origin,
                    calibration=rig.hand_eye.source,
                    calibration_sha256=hash_of(rig.hand_eye.X_BC, task.require_hardware().X_FT),
                    camera_late_s=rig.hand_eye.camera_late_s,
                )
            newest = None if rig is None else rig.camera.newest
            rollouts = None
            if isinstance(adaptation.method, Simulating):
                rollouts, worth = adaptation.method.rollouts, (cost_in_words(adaptation.method, config),)
            yield SessionParts(task, target, adaptation, origin, control, newest, worth, train, rollouts)


def _recorded_parts(config: Config, checkpoint: Checkpoint, prior: str, session: Path) -> SessionParts:
    """The parts of a session in the folder `session` whose trials were recorded before. Raises UsageError, SimError."""
    if not config.is_simulated:
        raise UsageError(f"--recorded: nothing moves, so leave out --hw {config.hw}")
    if config.solver:
        raise UsageError(f"--recorded: policies choose among recorded actions, so leave out --solver {config.solver}")
    if config.control:
        raise UsageError(f"--recorded: no further trial can be made, so leave out --control {config.control}")
    begun = (session / FACTS).exists()
    recordings = recordings_of(checkpoint, config) if begun else recordings_of(checkpoint, config, compared)
    solver = recordings.checkpoint.solver
    title = f"recorded trials of {config.recorded}, {len(recordings.held_out)} of them held out"
    title = "; ".join((title, *recordings.shown.notes))
    target = RecordedTarget(recordings.shown, title, _spent(recordings.shown, session))
    adaptation = _adaptation(config, recordings.checkpoint, solver, solver, target.executable)
    return SessionParts(solver.task, target, adaptation, _provenance(checkpoint, prior, recordings.sha256))


def _own_target(
    config: Config, expectations: Expectations, session: Path, screen: Screen | None, answerer: Answerer | None
) -> OwnTarget:
    """The target that asks and is told. Raises UsageError, NoHardware for a task that no lab can report."""
    task = expectations.task
    task.require_report()
    if config.pace < FULL or config.realtime:
        raise UsageError("--hw own: your code decides how fast your robot moves, so leave out --pace and --realtime")
    if answerer is None and config.answer_with == PERSON:
        if screen is None:
            raise UsageError(f"--answer-with {PERSON}: a person answers at a terminal; leave out --yes")
        if kind_of(config.method).needs_whole:
            raise UsageError(
                f"--method {config.method} needs every moment of a trial, and a person may report only its end: "
                "adapt with adaptsim, or have a program report whole trajectories"
            )
        answerer = TypedAnswers(screen, task)
    elif answerer is None and config.answer_with:
        moves = config.answer_moves == "robot"
        release = Release(screen, real=True) if moves else Release()
        answerer = Program(config.answer_with, moves, config.answer_limit_s, screen, release)
    if answerer is None:
        raise UsageError(
            "--hw own: who answers for your robot? Name a program (--answer-with 'python my_robot.py'), or "
            "--answer-with person, or ask from Python: api.begin(..., hw='own'), session.ask (docs/guide/own-robot.md)"
        )
    return OwnTarget.of_session(task, session, answerer, config.method, expectations)


def _adaptation(
    config: Config,
    checkpoint: Checkpoint,
    policies: Policies,
    expectations: Expectations,
    executable: Executable | None,
) -> Adaptation:
    from sim.adaptation.methods import make_method
    from sim.adaptation.trajectory_likelihood import TrajectoryLikelihood

    method = make_method(config.method, checkpoint.solver.task, checkpoint)
    likelihood: TrajectoryLikelihood | Simulating | None = method if isinstance(method, Simulating) else None
    if likelihood is None and (table := checkpoint.reward_table) is not None:
        likelihood = TrajectoryLikelihood(checkpoint.solver, table.truths, table.prior)
    return Adaptation(method, policies, expectations, executable, likelihood)


def _provenance(checkpoint: Checkpoint, prior: str, world_sha256: str) -> Provenance:
    """The provenance of parts without a calibration."""
    task, folder = checkpoint.solver.task.name, checkpoint.path.absolute()
    return Provenance(
        checkpoint=f"{task}/{folder.name}",
        checkpoint_sha256=checkpoint.sha256,
        checkpoint_folder="" if folder.parent == files_of(task, "checkpoints").absolute() else str(folder),
        world_sha256=world_sha256,
        calibration="",
        calibration_sha256="",
        versions=versions(),
        start_from_sha256=prior,
    )


def _spent(trials: RecordedTrials, session: Path) -> set[int]:
    """The recordings that a session has used already, those of attempts that do not count too."""
    if not (session / FACTS).is_file():
        return set()
    store = SessionStore.open(session.parent, session.name)
    existing = store.existing()
    keys = existing.completed | existing.recorded
    used = [store.motion(store.iteration_of(key.number), key).action_array for key in keys]
    return {int(row) for row in trials.at(np.array(used))} if used else set()


_Opened = tuple[Task, Target[Any, Any], Executable | None, Rig | None]


@contextmanager
def _open_own_or_target(
    config: Config,
    expectations: Expectations,
    session: Path,
    drivers: Drivers | None,
    own: SessionFacts | None,
    screen: Screen | None,
    answerer: Answerer | None,
) -> Iterator[_Opened]:
    """See `_open_target`; a robot of one's own is a target without devices."""
    if config.is_own:
        yours = _own_target(config, expectations, session, screen, answerer)
        yield yours.task, yours, yours.executable, None
        return
    with _open_target(config, expectations.task, drivers, own, screen) as opened:
        yield opened


@contextmanager
def _open_target(
    config: Config, task: Task, drivers: Drivers | None, own: SessionFacts | None, screen: Screen | None
) -> Iterator[_Opened]:
    """The task as mounted, the target, the check for executable actions, the rig if there is one."""
    if task.hardware is None or _is_foreign(config, task):
        yield task, _simulated(config, task), None, None
        return
    with open_trials(config, places(), task, drivers, own, screen) as rig_target:
        yield (
            rig_target.task,
            rig_target,
            rig_target.executable,
            rig_target.rig,
        )


@contextmanager
def open_trials(
    config: Config,
    places: Places,
    task: Task,
    drivers: Drivers | None = None,
    own: SessionFacts | None = None,
    screen: Screen | None = None,
) -> Iterator[RigTarget]:
    """The devices for trials, connected, the arm last. Nothing moves.

    Every check that needs no device comes first. With `own`, calibration and touch-off are those of this session.
    Raises SessionError (unreadable touch-off), PreflightFailed (stale touch-off), CalibrationMissing, NotExecutable
    (the arm cannot hold the tool), DeviceUnavailable, CameraError, UsageError (a session's own calibration is gone),
    and the errors of `open_lab`.
    """
    with open_lab(config, task, drivers, screen) as lab:
        ground = ground_of(config, places, task, lab) if own is None else own_ground(config, places, task, lab, own)
        if ground.touched is not None:  # the touch-off overrides the rig file
            lab.note(origin(ground.touched, task))
        mounted_task = ground.mounted_task
        rig = lab.for_trials(mounted_task, ground.eye, config.calibration_days)
        yield RigTarget(mounted_task.task, rig, tracker_of(mounted_task.task), mounted_task.planner())


def _is_foreign(config: Config, task: Task) -> bool:
    """Whether the world's physics has no arm, only the tool."""
    from sim.lab.world import load_world

    return bool(config.lab_world) and load_world(config.lab_world, task).physics != "drake"


def _simulated(config: Config, task: Task) -> SimulatedTarget:
    """The target for a task without hardware, or a foreign physics. Raises UsageError with real devices."""
    if not config.is_simulated:
        raise UsageError(
            f"--hw {config.hw}: the task {task.name} runs in simulation only, so no arm can execute it. "
            "Leave --hw out, or choose another --task"
        )
    if config.pace < FULL:
        raise UsageError(f"--pace {config.pace:g}: no arm moves in this simulated target, so there is nothing to slow")
    from sim.lab.rollout import rollout_in
    from sim.lab.world import load_world

    world = load_world(config.world, task)
    duration_s = float(task.observation.times_s[-1])
    title = f"simulated target, world {world.name}"
    if world.physics != "drake":
        title += f" in {world.physics}, without arm or camera"
    return SimulatedTarget(task.object_name, duration_s, title, partial(rollout_in, world, task=task))


def _world_sha256(name_or_path: str) -> str:
    """SHA-256 of the file of an own world, or of the name of a shipped one; empty without a world."""
    if not name_or_path:
        return ""
    path = Path(name_or_path).expanduser()
    content = path.read_bytes() if path.is_file() else repr(name_or_path).encode()
    return hashlib.sha256(content).hexdigest()


def seen_by_camera(config: Config, facts: SessionFacts) -> tuple[Task, tuple[Outcome, ...]]:
    """The task with the session's ranges, and its outcomes. Raises UsageError for a task without a camera."""
    task = task_of(config.model_copy(update={"task": facts.task, "object": facts.object}))
    if is_own(facts.hw):
        return task, task.require_report().outcomes
    if task.hardware is None or not facts.calibration:
        raise UsageError(f"session {facts.name} was simulated without a camera: its outcomes are exact")
    return task, tracker_of(task).outcomes
