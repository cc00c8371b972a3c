"""The record of a trial as it grows: proposed, moved, tracked."""

from __future__ import annotations

from adaptsim_cli.screen.outputs.trials import TrackRecord, as_observed, as_row, named
from adaptsim_cli.session.live_trial import Motion, PlannedTrial, TrackedTrial
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.stages import RunTrial
from sim.tasks.task import SolvedPolicy, Task


def propose(
    task: Task, stage: RunTrial, parameters: Array, policy: SolvedPolicy, planned: PlannedTrial
) -> MotionRecord:
    """A planned trial with its predicted reward; `parameters` (p,) are those of the policy."""
    expected, low, high = policy.predict(planned.context)
    return MotionRecord(
        trial=stage.key.number,
        attempt=stage.key.attempt + 1,
        iteration=stage.iteration + 1,
        particle=stage.particle + 1,
        parameters=named(task.parameters.names, parameters),
        drawn_context=named(task.context.names, planned.drawn),
        context=named(task.context.names, planned.context),
        goal_m=None if task.goal_m is None else as_row(task.goal_m(planned.context)),
        action=named(task.action.names, planned.action),
        predicted_reward=expected,
        predicted_low=low,
        predicted_high=high,
        role=stage.role,
    )


def motion_record(proposed: MotionRecord, started: str, motion: Motion, timing_s: dict[str, float]) -> MotionRecord:
    """The record of a finished motion."""
    stopped = None if motion.stopped is None else str(motion.stopped)
    return proposed.model_copy(update={"started": started, "stopped": stopped, "timing_s": timing_s})


def ended_in_words(task: Task, track: ObjectTrack) -> str:
    """The end of a success in the task's own words; empty if it has none."""
    return "" if task.outcome_in_words is None or not task.succeeded(track) else task.outcome_in_words(track)


def trial_record(task: Task, motion: MotionRecord, tracked_trial: TrackedTrial) -> TrialRecord:
    """The record of a tracked trial."""
    return TrialRecord(
        **dict(motion),
        observation=as_observed(task.observation(tracked_trial.track)),
        reward=task.score(tracked_trial.track, motion.context_array),
        outcome=tracked_trial.track.outcome,
        ended=ended_in_words(task, tracked_trial.track),
        track=TrackRecord.from_track(tracked_trial.track),
        moments=tracked_trial.moments,
        film=tracked_trial.film,
        control_success_rate=tracked_trial.control_success_rate,
    )
