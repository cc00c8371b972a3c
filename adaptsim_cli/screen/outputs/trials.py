"""Trials and their results, as they are stored and printed by run-iteration, rollout and preview."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from adaptsim_cli.screen.outputs import Output, Quantities, described, optional
from hw.records import Record
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.adaptation.paired import Claim
from sim.adaptation.stages import Role
from sim.adaptation.verdict import Verdict
from sim.types import Dimension, Suspicion

if TYPE_CHECKING:
    from sim.adaptation.method import SessionForecast

UNITS = "unit of every parameter, context and action by its name; empty for a plain number"


OBSERVED = "motion of the object, normalised with the task's fixed bounds, time by time; null: not observed"


class PlayedTrial(Record):
    """One completed trial that counts."""

    trial: int = described("number of the trial in the session, from 1")
    context: Quantities = described("context as measured, in `units`")
    action: Quantities = described("commanded action, in `units`")
    reward: float = described("between 0 and 1")
    outcome: Outcome = described("how it ended, a value of `perception.types.Outcome`")
    ended: str = Field(default="", description="the end in the task's own words; empty: those of the outcome")
    observation: tuple[float | None, ...] = described(OBSERVED)
    attempt: int = described("which attempt at it counts, from 1")
    iteration: int = described("number of its iteration, from 1")
    particle: int = described("number of its particle, from 1")
    role: Role = described("`own` or `control`: which policy acted; `alone`: an iteration without control trials")
    predicted_reward: float = described("predicted reward, from all trials before it")
    overruled_from: Outcome | None = described("tracked outcome, if the operator set another")
    timing_s: dict[str, float] | None = optional("wall time by stage; null where the iteration states it")


class ParticleShown(Record):
    """One particle with its trials."""

    params: Quantities = described("parameters that its trials were made with, in `units`")
    trials: list[PlayedTrial] = described("its trials of this iteration")
    mean_reward: float = described("of these trials")
    next_params: Quantities = described("parameters of the next iteration, in `units`")


class BestRecord(Record):
    """The best parameters of the session so far."""

    params: Quantities = described("parameters, in `units`")
    mean_reward: float = described("predicted reward of their policy, averaged over all contexts")
    trials: int = described("trials behind the prediction")
    ci95: tuple[float, float] = described("95 % interval of the predicted reward")
    tried: tuple[int, ...] | None = Field(
        default=None, description="trials that this policy would repeat, action for action; null: not known"
    )
    tried_reward: float | None = Field(default=None, description="mean reward of these trials; null: there are none")
    chosen_after: int | None = Field(
        default=None, description="trials before the iteration that first tried this policy, or all of them if none did"
    )


NOTICEABLE = 0.05
"""Corrections below this fraction of the quantity's range are not shown."""


class ForecastRecord(Record):
    """Whether the session is done, and the correction of the simulator's actions."""

    gain: float | None = optional("expected gain by another iteration, in records of earlier versions; else null")
    likely: float | None = optional("chance of a further gain above 0.05, in records of earlier versions; else null")
    done: bool = described("two iterations are done and the last one confirmed its policy, or nothing may work")
    hopeless: bool = described("nothing in the ranges of the action is expected to work")
    correction: tuple[float, ...] = described(
        "the correction that the trials add to the simulator's action, in the order of the action"
    )
    correction_std: tuple[float, ...] = described("its standard deviation over contexts")

    def noticeable(self, dimensions: Sequence[Dimension]) -> list[tuple[Dimension, float]]:
        """The quantities of the action with a noticeable correction, each with its correction."""
        pairs = zip(dimensions, self.correction, strict=True)
        return [(d, off) for d, off in pairs if abs(off) >= NOTICEABLE * (d.high - d.low)]

    @classmethod
    def of(cls, forecast: SessionForecast) -> ForecastRecord:
        """The record of a forecast."""
        return cls(
            done=forecast.done,
            hopeless=forecast.hopeless,
            correction=as_row(forecast.correction),
            correction_std=as_row(forecast.correction_std),
        )


class SuspicionRecord(Record):
    """A fault of the rig at which the trials of a session hint."""

    question: str = described("the question to the person")
    why: str = described("what the trials showed")
    look: str = described("how to find out without a command")

    @classmethod
    def of(cls, suspicion: Suspicion) -> SuspicionRecord:
        """The record of a task's suspicion."""
        return cls(question=suspicion.question, why=suspicion.why, look=suspicion.look)


class ControlRecord(Record):
    """The comparison of trials with their control trials: an answer that stays valid after every pair."""

    control: str = described("method or session whose policy made the control trials")
    pairs: int = described("complete pairs so far")
    mean_reward: float = described("mean reward of the session's trials in them")
    control_reward: float = described("mean reward of their control trials")
    difference: float = described("the first minus the second")
    ci95: tuple[float, float] = described("95 % interval of the difference, valid at any time")
    claim: Claim = described(
        "`shown`: the session is better; `worse`; `no gain`: better by less than 0.05, if at all; `open`: not shown yet"
    )
    decided_after: int | None = described("pairs after which this was first shown; null: open")
    further: int | None = described("further pairs expected until it is shown; null: not open, or not known")


class IterationOutput(Output):
    """The result of one iteration: one object per line and iteration."""

    task: str = described("which task")
    session: str = described("which session")
    iteration: int = described("number of the iteration, from 1")
    hw: str = described("hardware: fake, panda, fr3 or fr3v2")
    world: str = described("world of the simulated lab; empty on a real arm")
    seed: int = described("seed of all random numbers")
    units: dict[str, str] = described(UNITS)
    particles: list[ParticleShown] = described("particles, side by side")
    best: BestRecord = described("the best parameters so far")
    verdict: Verdict = described("whether to stop or to go on, and why")
    outlook: ForecastRecord | None = described("null if the method makes no forecast")
    suspicion: SuspicionRecord | None = described("what the trials so far hint at about the rig; null: nothing")
    control: ControlRecord | None = described("comparison with the control trials; null: no pair of trials yet")
    timing_s: dict[str, float] = described("wall time by stage; `other` has no name, `total` is their sum")


class TrackRecord(Record):
    """The tracked object, an `ObjectTrack`."""

    t_s: tuple[float, ...] = described("times, from the start of the tool's motion")
    state: tuple[tuple[float, ...], ...] = described(
        "a row for each time: position in m, or the states of a task without an arm"
    )
    confidence: tuple[float, ...] = described("between 0 and 1, for each time")
    outcome: Outcome = described("how it ended")
    end_in_tool_m: tuple[float, ...] | None = described(
        "the object's last position in the tool's frame; null if unknown"
    )
    flags: tuple[str, ...] = described("warnings of the tracking and of the end of the motion")
    watched_s: tuple[float | None, float | None] = Field(
        default=(None, None), description="first and last time at which the state is known; null: no such bound"
    )

    @classmethod
    def from_track(cls, track: ObjectTrack) -> TrackRecord:
        """The record of a track."""
        end = track.end_in_tool_m
        return cls(
            t_s=as_row(track.t_s),
            state=tuple(as_row(row) for row in track.state),
            confidence=as_row(track.confidence),
            outcome=track.outcome,
            end_in_tool_m=as_row(end) if np.isfinite(end).all() else None,
            flags=track.flags,
            watched_s=(_bound(track.watched_s[0]), _bound(track.watched_s[1])),
        )

    def track(self) -> ObjectTrack:
        """The track, its arrays read-only."""
        return ObjectTrack(
            t_s=np.array(self.t_s),
            state=np.array(self.state),
            outcome=self.outcome,
            end_in_tool_m=np.full(3, math.nan) if self.end_in_tool_m is None else np.array(self.end_in_tool_m),
            confidence=np.array(self.confidence),
            flags=self.flags,
            watched_s=(
                -math.inf if self.watched_s[0] is None else self.watched_s[0],
                math.inf if self.watched_s[1] is None else self.watched_s[1],
            ),
        )


def _bound(t_s: float) -> float | None:
    return t_s if math.isfinite(t_s) else None


def as_observed(observation: Array) -> tuple[float | None, ...]:
    """An observation (size,) as a row, with null where nothing was observed."""
    return tuple(None if math.isnan(x) else x for x in as_row(observation))


def as_row(array: Array) -> tuple[float, ...]:
    """An array of any shape as one flat row of floats."""
    return tuple(float(x) for x in np.asarray(array).ravel())


def named(names: Sequence[str], point: Array) -> Quantities:
    """A point by the names of its quantities. Raises ValueError if the counts differ."""
    return dict(zip(names, as_row(point), strict=True))


class Rollout(PlayedTrial, Output):
    """One single trial, with its conditions."""

    task: str = described("which task")
    hw: str = described("hardware: fake, panda, fr3 or fr3v2")
    world: str = described("world of the simulated lab; empty on a real arm")
    seed: int = described("seed of all random numbers")
    units: dict[str, str] = described(UNITS)
    params: Quantities | None = described("parameters of the policy; null if the action was chosen by hand")
    session: str | None = described("the session whose best policy acted; null: none")
    iterations: int = described("complete iterations behind that policy")
    goal_m: tuple[float, ...] | None = described("(x, y) of the goal, for a task with a goal on the table")
    camera_late_s: float = described("calibrated delay of the camera's time stamps, already subtracted")
    flags: tuple[str, ...] = described("warnings of the tracking and of the end of the motion")
    track: TrackRecord = described("the tracked object")
    when: str = described("when it was made")


class Limit(Record):
    """One limit of one path."""

    path: str = described("approach, motion or return")
    quantity: str = described("the limited quantity")
    where: str = described("joint or part")
    t_s: float = described("time at which it comes closest to its limit, from the start of the path")
    value: float = described("the value then, in `unit`")
    limit: float = described("the limit, in `unit`")
    unit: str = described("unit of both")
    ratio: float = described("share of the limit that is used, 1 is all of it")
