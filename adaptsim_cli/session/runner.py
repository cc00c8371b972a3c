"""One iteration of a session, from the first question to the next proposal. Read from the top.

`run_iteration` asks `stages.next_stage` what is missing and does that: a trial, or the adaptation. Whatever
completes is stored before the next thing begins, so a session can stop or be killed between any two lines.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from adaptsim_cli.console import Screen
from adaptsim_cli.session import execution, moments, recording
from adaptsim_cli.session.operator import Accept, Judged, Operator, Overrule, Proposal, Redo
from adaptsim_cli.session.parts import Parts, TrainedPolicy
from adaptsim_cli.session.recording import encode_jpeg
from adaptsim_cli.session.records import BestRecord, ResultRecord, Samples, TrackRecord, TrialRecord, as_row
from adaptsim_cli.session.stages import Adapt, Draw, RunTrial, Show, generator, next_stage
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.summary import summary
from hw.errors import HardwareError
from perception.errors import ObjectNotFound, PerceptionError
from perception.types import ObjectTrack, Outcome
from sim.adaptation.method import Iteration, Particle, ParticleTrials, Trial
from sim.errors import NotExecutable

RIM = 0.1
"""Share of the area at each side in which nobody is asked to place the object: hands are not that steady."""


@dataclass(frozen=True)
class Session:
    """A stored session together with the parts, the operator and the screen that carry it on."""

    store: SessionStore
    parts: Parts
    operator: Operator
    screen: Screen
    policies: dict[tuple[int, int], TrainedPolicy] = field(default_factory=dict)  # trained so far in this process

    @property
    def seed(self) -> int:
        return self.store.facts.seed


def run_iteration(session: Session) -> dict[str, Any]:
    """Do what is missing of the present iteration, show what changed, and return its summary.

    Raises StoppedByOperator, HardwareError, PerceptionError, NotExecutable or SessionError; what completed is stored.
    """
    facts = session.store.facts
    while True:
        stage = next_stage(session.store.existing(), facts.particles, facts.trials)
        if isinstance(stage, RunTrial):
            run_trial(session, stage)
        elif isinstance(stage, Adapt):
            adapt(session, stage)
        else:
            return show(session, stage)


def run_trial(session: Session, stage: RunTrial) -> None:
    """Set up, propose, confirm, execute, track, review and store one trial; or note why it does not count."""
    store, parts, operator = session.store, session.parts, session.operator
    if stage.interrupted:
        operator.repeat_interrupted(stage, parts.rig.is_real)
        if parts.rig.is_real:
            _reject(session, stage, "interrupted while the arm may have moved")
            return
    moved = False
    try:
        policy = _policy(session, stage.iteration, stage.particle)
        ready = _set_up(session, stage)
        proposal, plan = _propose(session, stage, policy, ready)
        operator.approve(proposal, parts.rig.is_real)

        store.mark_started(stage.iteration, stage.key, _now())
        moved, began = True, time.perf_counter()
        with session.screen.busy("The robot moves and the camera records"):
            executed = execution.execute(parts, plan)
        executed_s = time.perf_counter() - began
        with session.screen.busy(f"Tracking the {parts.task.object_name} in {len(executed.frames)} frames"):
            track = execution.track(parts, executed, ready.detection)
        tracked_s = time.perf_counter() - began - executed_s
    except (HardwareError, PerceptionError, NotExecutable) as error:
        _reject(session, stage, str(error))
        if isinstance(error, PerceptionError) and operator.try_again(stage, str(error), moved):
            return
        raise

    review = operator.review(_judged(session, proposal, track))
    if isinstance(review, Redo):
        _reject(session, stage, review.reason)
        return
    tracked = track.outcome
    if isinstance(review, Overrule):
        track = replace(track, outcome=review.outcome)
    with session.screen.busy("Storing the trial"):
        record, files = _trial_record(session, proposal, ready, executed, track, tracked)
        timing_s = {"rollout": executed_s, "tracking": tracked_s, "storing": time.perf_counter() - began - executed_s}
        timing_s["storing"] -= tracked_s
        store.save_trial(record.model_copy(update={"timing_s": timing_s}), files)
    session.screen.trial_done(record, manual=not isinstance(review, Accept))


def adapt(session: Session, stage: Adapt) -> None:
    """Move the particles, train their task policies and store the result."""
    store, learner = session.store, session.parts.learner
    began = time.perf_counter()
    history = _history(store, stage.iteration)
    with session.screen.busy("Adapting the simulation parameters"):
        particles = learner.next(history, generator(session.seed, Draw.NEXT, stage.iteration))
        best, verdict = learner.judge(history, generator(session.seed, Draw.JUDGE, stage.iteration))
    adapted_s = time.perf_counter() - began
    for index, particle in enumerate(particles):
        _train(session, stage.iteration + 1, index, particle)
    trained_s = time.perf_counter() - began - adapted_s

    records = store.trials(stage.iteration)
    spent = {key: sum(r.timing_s[key] for r in records) for key in ("rollout", "tracking", "storing")}
    timing_s = {
        "rollouts": spent["rollout"],
        "tracking": spent["tracking"],
        "adaptation": adapted_s,
        "training": trained_s,
        "total": sum(spent.values()) + adapted_s + trained_s,
    }
    names = session.parts.task.parameters.names
    result = ResultRecord(
        iteration=stage.iteration,
        trials=stage.keys,
        next_particles=tuple(_rows(particle) for particle in particles),
        best=BestRecord(
            params=dict(zip(names, as_row(best.particle.mean), strict=True)),
            mean_reward=best.mean_reward,
            trials=best.trials,
            ci95=best.ci95,
        ),
        verdict=verdict,
        timing_s=timing_s,
        proposal_s=adapted_s + trained_s + records[-1].timing_s["tracking"] + records[-1].timing_s["storing"],
    )
    shown = summary(store.facts, names, particles_of(store, stage.iteration), records, result)
    store.save_result(result, json.dumps(shown, allow_nan=False).encode())


def show(session: Session, stage: Show) -> dict[str, Any]:
    """Show what the iteration changed and return its summary."""
    store, screen = session.store, session.screen
    if (result := store.result(stage.iteration)) is not None:
        before, after = particles_of(store, stage.iteration), particles_of(store, stage.iteration + 1)
        screen.adapted(session.parts.task, before, after, result)
    return store.summary(stage.iteration)


def particles_of(store: SessionStore, iteration: int) -> tuple[Particle, ...]:
    """The particles that an iteration's trials were (or will be) made with."""
    stored: tuple[Samples, ...] = store.start.particles
    if iteration > 0:
        result = store.result(iteration - 1)
        if result is None:
            raise ValueError(f"iteration {iteration - 1} has no result yet")
        stored = result.next_particles
    return tuple(Particle(np.array(samples)) for samples in stored)


def _set_up(session: Session, stage: RunTrial) -> execution.Ready:
    """Say what is going to happen and why, have the object placed, find it, and check that it lies in the area."""
    task, rig, tracker = session.parts.task, session.parts.rig, session.parts.tracker
    rng = generator(session.seed, Draw.CONTEXT, stage.iteration, stage.particle, stage.trial, stage.key.attempt)
    unit = task.context.normalise(task.context.sample(rng, 1)[0])
    drawn = task.context.denormalise(RIM + (1.0 - 2.0 * RIM) * unit)
    particle = particles_of(session.store, stage.iteration)[stage.particle]
    session.screen.trial(task, session.store.facts, stage, particle)

    wanted_m = tracker.placement(drawn)
    session.operator.placed(task.object_name, wanted_m, rig.is_real)
    rig.bench.place(wanted_m, stage.key.number, stage.key.attempt)
    frame, model = rig.camera.snapshot(), rig.camera.model()
    detection = tracker.find(frame, model, rig.hand_eye.X_BC)
    context = tracker.context(drawn, detection)
    if not task.context.contains(context):
        ranges = ", ".join(f"{d.label} {d.low:g} to {d.high:g}" for d in task.context.dimensions)
        found = ", ".join(f"{value:.3f}" for value in context)
        raise ObjectNotFound(f"the {task.object_name} lies outside of the area: found {found}; area {ranges}")
    overlay = encode_jpeg(tracker.overlay(frame, model, rig.hand_eye.X_BC, detection, wanted_m), 90)
    return execution.Ready(drawn, context, frame, detection, overlay)


def _propose(
    session: Session, stage: RunTrial, policy: TrainedPolicy, ready: execution.Ready
) -> tuple[Proposal, execution.Plan]:
    """The action for this context, planned and checked against the arm's limits before anyone is asked."""
    action = policy(ready.context)
    plan = execution.plan(session.parts, ready.context, action)
    particle = particles_of(session.store, stage.iteration)[stage.particle]
    overlay = session.store.scratch("overlay.jpg", ready.overlay)
    proposal = Proposal(
        stage, particle.mean, ready.context, action, policy.predict(ready.context), plan.duration_s, overlay
    )
    session.screen.proposal(session.parts.task, proposal)
    return proposal, plan


def _judged(session: Session, proposal: Proposal, track: ObjectTrack) -> Judged:
    task, outcomes = session.parts.task, session.parts.tracker.outcomes
    rewards = [(o, task.score(replace(track, outcome=o), proposal.context)) for o in outcomes]
    possible = tuple((o, reward) for o, reward in rewards if np.isfinite(reward))
    return Judged(proposal, track.outcome, task.score(track, proposal.context), track.flags, possible)


def _trial_record(
    session: Session,
    proposal: Proposal,
    ready: execution.Ready,
    executed: execution.Executed,
    track: ObjectTrack,
    tracked: Outcome,
) -> tuple[TrialRecord, dict[str, bytes]]:
    """The record and the files beside it: recording, overlay and the frames of the key moments."""
    task, rig, stage = session.parts.task, session.parts.rig, proposal.stage
    model, X_BC, played = rig.camera.model(), rig.hand_eye.X_BC, executed.execution
    wanted = moments.moments(executed.plan.motion.t_s[-1], executed.plan.motion.contact)
    seen_m = np.array([[*ready.detection.xy_m, 0.0], *track.state[:, :3]])
    kept, images = moments.key_frames(executed.frames, model, X_BC, seen_m, played.t_start_s, wanted)
    files = {
        recording.FILE: recording.encode(ready.frame, executed.frames, model, X_BC, played, executed.X_BT_at, track),
        "overlay.jpg": ready.overlay,
        **images,
    }
    record = TrialRecord(
        number=stage.key.number,
        attempt=stage.key.attempt,
        iteration=stage.iteration,
        particle=stage.particle,
        trial=stage.trial,
        drawn_context=as_row(ready.drawn),
        context=as_row(proposal.context),
        action=as_row(proposal.action),
        predicted_reward=proposal.prediction.reward,
        predicted_low=proposal.prediction.low,
        predicted_high=proposal.prediction.high,
        observation=as_row(task.observation(track)),
        reward=task.score(track, proposal.context),
        outcome=track.outcome,
        overruled_from=None if tracked == track.outcome else tracked,
        track=TrackRecord.of(track),
        moments=kept,
        control_success_rate=played.control_success_rate,
        started=_now(),
        timing_s={},
        files={},
    )
    return record, files


def _policy(session: Session, iteration: int, particle: int) -> TrainedPolicy:
    """The task policy of a particle, trained again where an earlier process did: the seed makes it the same."""
    if (iteration, particle) not in session.policies:
        _train(session, iteration, particle, particles_of(session.store, iteration)[particle])
    return session.policies[iteration, particle]


def _train(session: Session, iteration: int, index: int, particle: Particle) -> None:
    with session.screen.busy(f"Training the task policy of particle {index + 1}"):
        rng = generator(session.seed, Draw.TRAIN, iteration, index)
        session.policies[iteration, index] = session.parts.learner.train(particle, rng)


def _history(store: SessionStore, last: int) -> tuple[Iteration, ...]:
    def trials(iteration: int, particle: int) -> tuple[Trial, ...]:
        chosen = (r for r in store.trials(iteration) if r.particle == particle)
        return tuple(Trial(np.array(r.context), np.array(r.action), np.array(r.observation), r.reward) for r in chosen)

    return tuple(
        tuple(ParticleTrials(p, trials(i, index)) for index, p in enumerate(particles_of(store, i)))
        for i in range(last + 1)
    )


def _reject(session: Session, stage: RunTrial, reason: str) -> None:
    session.store.reject(stage.iteration, stage.key, _now(), reason)
    session.screen.note(f"Trial {stage.key.number}, attempt {stage.key.attempt + 1}, does not count: {reason}")


def _rows(particle: Particle) -> Samples:
    return tuple(as_row(sample) for sample in particle.samples)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
