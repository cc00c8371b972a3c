"""One iteration of a session, from the first question to the next proposal. Read from the top.

`stages` runs the loop of every session (`sim.adaptation.sessions`): a trial, the adaptation, the end of an iteration.
Each is stored before the next one begins, so a session can stop or be killed between any two lines. Rules around the
loop (`ending`), the report and the printed result are in `running`, which takes the stages. The steps of a trial are in
`rig_target` and `simulated_target`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from adaptsim_cli.errors import AnswerAwaited, SessionError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.outputs.trials import IterationOutput
from adaptsim_cli.screen.stopwatch import added
from adaptsim_cli.session import terminal_views
from adaptsim_cli.session.advice import check_first
from adaptsim_cli.session.control import ControlPolicy, is_hidden, policy_of_trial
from adaptsim_cli.session.correcting import choices_of, overruled
from adaptsim_cli.session.deferred import submit
from adaptsim_cli.session.folders import FILM
from adaptsim_cli.session.history import history_of, left_s, particles_of, result_of
from adaptsim_cli.session.live_trial import Motion, OutcomeUndecided, PlacedTrial, PlannedTrial
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.preflight import drift
from adaptsim_cli.session.records import Draw, MotionRecord, generator, now
from adaptsim_cli.session.results import iteration_result
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.summary import summary
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.trial_records import motion_record, propose, trial_record
from adaptsim_cli.session.watching import AllOf, Watcher
from adaptsim_cli.storage import durable
from hw.errors import HardwareError
from hw.types import Array
from perception.errors import ObjectNotFound, PerceptionError
from sim.adaptation.adaptation import Adaptation
from sim.adaptation.method import Iteration as LearntIteration
from sim.adaptation.method import Particle
from sim.adaptation.posterior import Posterior
from sim.adaptation.sessions import Policies, PolicySource, Progress, iterate, train
from sim.adaptation.stages import Adapt, Role, RunTrial, Show, Stage, TrialKey, next_stage
from sim.errors import ActionImpossible, NotExecutable
from sim.tasks.task import SolvedPolicy

REJECTED = "rejected attempts"
"""Two entries among the times of an iteration: the sum, and the time of attempts that do not count."""
RIM = 0.1
"""Drawn placements keep this far from the edge of the area, as a share of it, because placing by hand is inexact."""


@dataclass(frozen=True)
class RunningSession:
    """A stored session with the parts, the operator and the screen that run it."""

    store: SessionStore
    parts: SessionParts
    operator: Operator
    screen: Screen
    watcher: Watcher = field(default_factory=AllOf)
    thread: Executor | None = None  # for work beside the operator
    policies: Policies = field(default_factory=dict)
    context_of: Callable[[RunTrial], Array] | None = None  # chosen by hand for a rollout; None: drawn
    control_policies: list[ControlPolicy] = field(default_factory=list)
    awaited: set[TrialKey] = field(default_factory=set)  # trials that were asked for, and whose answers come later
    overhead_s: dict[str, float] = field(default_factory=dict)  # time of the iteration outside the trials that count

    @property
    def adaptation(self) -> Adaptation:
        """See `PlayableSession`."""
        return self.parts.adaptation

    @property
    def progress(self) -> Progress:
        """See `PlayableSession`; the operator hears of each step."""
        return self.screen.busy

    def next_stage(self) -> Stage:
        """See `PlayableSession`; the files on the disk decide. The time until here belongs to no trial.

        Raises AnswerAwaited once nothing is left but trials whose answers come later.
        """
        existing = self.store.existing()
        with_awaited = replace(existing, completed=existing.completed | self.awaited)
        stage = next_stage(with_awaited, self.store.facts.layout)
        if self.awaited and not isinstance(stage, RunTrial):
            which = ", ".join(str(key.number) for key in sorted(self.awaited))
            raise AnswerAwaited(f"answers are awaited of trials {which}")
        self.book_overhead()
        return stage

    def particles(self, iteration: int) -> tuple[Particle, ...]:
        """See `PlayableSession`."""
        return particles_of(self.store, iteration)

    def history(self, iterations: int) -> tuple[LearntIteration, ...]:
        """See `PlayableSession`."""
        return history_of(self.parts.task, self.store, iterations - 1)

    def generator(self, iteration: int) -> np.random.Generator:
        """See `PlayableSession`."""
        return generator(self.store.facts.seed, Draw.NEXT, iteration)

    def play_trial(self, stage: RunTrial, policy: PolicySource) -> None:
        """See `PlayableSession`; a trial whose answer comes later is put aside."""
        try:
            run_trial(self, stage, policy)
        except AnswerAwaited:
            self.awaited.add(stage.key)

    def controls(self) -> tuple[ControlPolicy, ...]:
        """The policies of the control trials; trained before the first of them."""
        if not self.control_policies:
            assert self.parts.control is not None, "a session with control trials has their policies"
            with self.progress("Training the policies of the control trials", "training"):
                self.control_policies.extend(self.parts.control())
        return tuple(self.control_policies)

    def keep_particles(self, stage: Adapt, history: Sequence[LearntIteration], particles: tuple[Particle, ...]) -> None:
        """See `PlayableSession`."""
        keep_particles(self, stage, history, particles)

    def mark_shown(self, iteration: int) -> None:
        """See `PlayableSession`."""
        self.store.mark_shown(iteration, now())

    def book_overhead(self, stage: str | None = None) -> None:
        """Count the time since the last lap for the iteration instead of a trial; all of it as `stage`, if given."""
        lap_s = self.screen.lap_s()
        spent = added(self.overhead_s, lap_s if stage is None else {stage: sum(lap_s.values())})
        self.overhead_s.clear()
        self.overhead_s.update(spent)


def stages(session: RunningSession) -> Iterator[Stage]:
    """Run the missing stages of the session in order. Each is yielded once it is stored and the watchers have it.

    Raises StoppedByOperator, HardwareError, PerceptionError, NotExecutable, AnswerAwaited or SessionError; completed
    stages stay stored.
    """
    for stage in iterate(session):
        is_trial = isinstance(stage, RunTrial) and stage.key in session.store.existing().completed
        if is_trial or isinstance(stage, Adapt):
            update_watchers(session)
        yield stage


def run_iteration(session: RunningSession) -> IterationOutput:
    """Do the missing stages of the present iteration, show the result, and return its summary.

    It counts as shown only after `mark_shown`. Raises the errors of `stages`.
    """
    complete = next(stage for stage in stages(session) if isinstance(stage, Show))
    return show(session, complete)


def run_trial(session: RunningSession, stage: RunTrial, policy: PolicySource) -> None:
    """Execute and record one motion, then track, review and store the trial; or note why it does not count.

    The recording is on the disk before it is tracked. A trial interrupted later continues from the recording.
    """
    recorded = None
    if stage.recorded:
        session.screen.note(
            f"Trial {stage.key.number} continues from its recording: the motion is over, nothing moves."
        )
    elif _goes_on(session, stage):
        if (recorded := _execute(session, stage, *_begun(session, stage))) is None:
            return
    elif stage.interrupted and session.parts.target.spent(stage, session.operator):
        _reject(session, stage, "interrupted while the arm may have moved")
        return
    elif (recorded := _move(session, stage, *_acting(session, stage, policy))) is None:
        return
    _look(session, stage, recorded)


def _acting(session: RunningSession, stage: RunTrial, policy: PolicySource) -> tuple[SolvedPolicy, Array]:
    """The policy that acts, and (p,) the mean of the parameters that it was trained for.

    Both policies of a pair are trained before its first trial, so that no wait reveals which of them acts.
    """
    own = policy(), particles_of(session.store, stage.iteration)[stage.particle].mean
    if stage.role is Role.ALONE:
        return own
    control = policy_of_trial(session.controls(), session.store.facts, stage)
    return own if stage.role is Role.OWN else (control.policy, control.mean)


def _move(session: RunningSession, stage: RunTrial, policy: SolvedPolicy, mean: Array) -> Motion | None:
    """Set up, propose, confirm, execute, store the recording and return the motion. None: try again."""
    store, operator, target, progress = session.store, session.operator, session.parts.target, session.screen.busy
    try:
        placed = _place(session, stage, policy)
        with progress("Choosing the action: the best that the arm can do", "choosing"):
            action = policy(placed.context)
        planned = target.plan(placed, action, progress)
        trial = propose(session.parts.task, stage, mean, policy, planned)
        if planned.overlay is not None:
            planned = replace(planned, overlay_file=store.overlay(planned.overlay))
        session.screen.show(terminal_views.proposal(session.parts.task, trial, planned.summary))
        session.watcher.proposed(trial, planned)
        operator.approve(trial, planned, target.needs_consent, target.release)
    except (HardwareError, PerceptionError, NotExecutable) as error:
        _again(session, stage, error)
        return None
    store.mark_started(stage.iteration, stage.key, now(), trial)
    return _execute(session, stage, trial, planned)


def _goes_on(session: RunningSession, stage: RunTrial) -> bool:
    return stage.interrupted and session.parts.target.goes_on(stage.key)


def _begun(session: RunningSession, stage: RunTrial) -> tuple[MotionRecord, PlannedTrial]:
    """An interrupted attempt as it was proposed. Raises SessionError if no file has it."""
    proposed = session.store.proposed(stage.iteration, stage.key)
    if proposed is None:
        raise SessionError(f"trial {stage.key.number} was begun, and its proposal is missing: redo it")
    drawn = np.array(list(proposed.drawn_context.values()))
    return proposed, PlannedTrial(drawn, proposed.context_array, stage.key, proposed.action_array)


def _execute(session: RunningSession, stage: RunTrial, proposed: MotionRecord, planned: PlannedTrial) -> Motion | None:
    """Execute the trial, store the recording and return the motion. None: try again."""
    started = now()
    try:
        motion = session.parts.target.execute(planned, session.screen.busy)
        with session.screen.busy("Storing the recording", "storing"):
            files = motion.files()
            record = motion_record(proposed, started, motion, session.screen.lap_s())
            session.store.save_motion(record, files)
        if motion.stopped is not None:
            raise motion.stopped
        _say_drift(session)
    except (HardwareError, PerceptionError, NotExecutable) as error:
        _again(session, stage, error)
        return None
    return motion


def _again(session: RunningSession, stage: RunTrial, error: Exception) -> None:
    """Note why an attempt does not count. Raises `error` unless the trial is made again at once."""
    _reject(session, stage, str(error))
    if isinstance(error, ObjectNotFound) and error.picture is not None:
        session.screen.file("  The camera's picture", session.store.overlay(error.picture))
    if not (isinstance(error, PerceptionError | ActionImpossible) and session.operator.try_again(stage)):
        raise error


def _say_drift(session: RunningSession) -> None:
    """Tell the operator if the camera's picture differs from that of the session's first motion."""
    rigs = list(session.store.rigs())
    if rigs and (note := drift(rigs[0], rigs[-1])) is not None:
        session.screen.note(note)


def _look(session: RunningSession, stage: RunTrial, recorded: Motion | None) -> None:
    """Track a recording, have the result reviewed and store the trial. Without a motion, the recording is read from the
    disk.
    """
    store, operator, task, target = session.store, session.operator, session.parts.task, session.parts.target
    motion = store.motion(stage.iteration, stage.key)
    if motion.stopped is not None:
        _reject(session, stage, motion.stopped)
        return
    folder = store.trial_folder(stage.iteration, stage.key)
    if recorded is not None and (reason := operator.rejected_already()):
        _reject(session, stage, reason)
        return
    if recorded is None:
        with session.screen.busy("Reading the recording", "reading"):
            recorded = target.read(folder, motion.context_array, motion.action_array)
    undecided: OutcomeUndecided | None = None
    try:
        tracked_trial = recorded.track(session.screen.busy)
    except OutcomeUndecided as error:
        undecided, tracked_trial = error, error.tracked
    except PerceptionError as error:
        _reject(session, stage, str(error))
        if operator.try_again(stage):
            return
        raise
    record = trial_record(task, motion, tracked_trial)
    if undecided is None:
        session.screen.show(terminal_views.tracked(record))
    if tracked_trial.film is not None:
        durable.replace_file(folder / FILM, tracked_trial.files[FILM])
        session.screen.file("  Film", folder / FILM)
    session.watcher.tracked(record, tracked_trial)
    choices = choices_of(task, target.outcomes, tracked_trial.track, motion.context_array)
    review = operator.review(record, choices) if undecided is None else operator.decide(str(undecided), record, choices)
    if review.rejected:
        _reject(session, stage, review.rejected)
        if undecided is None or operator.try_again(stage):
            return
        raise undecided
    with session.screen.busy("Storing the trial", "storing"):
        if review.outcome is not None:
            record = overruled(task, record, review.outcome)
        record = record.model_copy(update={"timing_s": added(motion.timing_s, session.screen.lap_s())})
        store.save_trial(record, tracked_trial.files)
    if review.outcome is not None:
        session.screen.show(f"  Counts as {record.outcome_words}, reward {record.reward:.2f}.")


def keep_particles(
    session: RunningSession, stage: Adapt, history: Sequence[LearntIteration], particles: tuple[Particle, ...]
) -> None:
    """Judge the trials, train the next task policies and store the result of an iteration."""
    store, adaptation = session.store, session.parts.adaptation
    with session.screen.busy("Judging the trials", "adapting"):
        judgement = adaptation.assess(history)
    for index, particle in enumerate(particles):
        train(session, stage.iteration + 1, index, particle, history)
    result = iteration_result(
        session.parts.task, store, stage, history, particles, judgement, session.overhead_s, session.screen.lap_s()
    )
    shown = summary(store, result).model_dump(mode="json")
    store.save_result(result, json.dumps(shown, allow_nan=False).encode())
    session.overhead_s.clear()


def update_watchers(session: RunningSession) -> None:
    """Show watchers the present state of the session."""
    adaptation, store = session.parts.adaptation, session.store
    last = store.iterations() - 1
    if last >= 0 and is_hidden(store, last):
        last -= 1  # what the trials of this iteration taught would say which of them are the session's own

    def posterior() -> Posterior | None:
        return adaptation.posterior(history_of(session.parts.task, store, last))

    session.watcher.changed(store, posterior)


def show(session: RunningSession, stage: Show) -> IterationOutput:
    """Show what the iteration changed and return its summary."""
    store, screen = session.store, session.screen
    result = result_of(store, stage.iteration)
    before, after = particles_of(store, stage.iteration), particles_of(store, stage.iteration + 1)
    facts = store.facts
    words = (facts.recorded, check_first(facts.task, facts.hw, facts.calibration))
    screen.show(terminal_views.adapted(session.parts.task, before, after, result, screen.width, *words))
    return summary(store, result)


def _place(session: RunningSession, stage: RunTrial, policy: SolvedPolicy) -> PlacedTrial:
    """Announce the trial, then have the object placed and found; meanwhile the policy prepares for its drawn place."""
    task, parts = session.parts.task, session.parts
    drawn = _drawn(session, stage) if session.context_of is None else session.context_of(stage)
    particle = particles_of(session.store, stage.iteration)[stage.particle]
    session.screen.show(terminal_views.trial(task, session.store.facts, stage, particle, left_s(session.store, stage)))
    deferred = submit(session.thread, partial(policy.actions, drawn[None]))
    try:
        placed: PlacedTrial = parts.target.place(drawn, stage.key, session.operator, session.screen.busy)
        return placed
    finally:
        deferred.settle()


def _drawn(session: RunningSession, stage: RunTrial) -> Array:
    """(c,) a random context without the rim; the same for the same attempt."""
    space, seed = session.parts.task.context, session.store.facts.seed
    rng = generator(seed, Draw.CONTEXT, stage.iteration, stage.particle, stage.trial, stage.key.attempt)
    unit = space.normalise(space.sample(rng, 1)[0])
    return space.denormalise(RIM + (1.0 - 2.0 * RIM) * unit)


def _reject(session: RunningSession, stage: RunTrial, reason: str) -> None:
    session.store.reject(stage.iteration, stage.key, now(), reason)
    session.book_overhead(REJECTED)
    session.screen.note(f"Trial {stage.key.number}, attempt {stage.key.attempt + 1}, does not count: {reason}")
    folder = session.store.trial_folder(stage.iteration, stage.key)
    if folder.is_dir():
        session.screen.file("Its recording is kept", folder)
        motion = session.store.motion(stage.iteration, stage.key)
        session.overhead_s[REJECTED] = session.overhead_s.get(REJECTED, 0.0) + sum(motion.timing_s.values())
        if motion.stopped is None:
            name = session.store.facts.name
            session.screen.plain(f"To let it count after all: adaptsim sessions accept {name} {stage.key.number}")
