"""Outputs of the commands that read and keep sessions."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from adaptsim_cli.screen.outputs import Output, Quantities, described
from adaptsim_cli.screen.outputs.trials import UNITS, BestRecord, PlayedTrial
from hw.records import Record
from sim.adaptation.verdict import Verdict


class SessionRow(Record):
    """One session in one line. A damaged one has only `session` and `error`."""

    session: str = described("its name")
    task: str = described("which task")
    hw: str = described("hardware: fake, panda, fr3 or fr3v2")
    world: str = described("world of the simulated lab; empty on a real arm")
    method: str = described("method of adaptation")
    seed: int = described("seed of all random numbers")
    created: str = described("when it was begun")
    iterations: int = described("complete iterations")
    trials: int = described("completed trials that count")
    mean_reward: float | None = described("of these trials; null without one")
    verdict: Verdict | None = described("of its last iteration; null before the first")
    size_bytes: int = described("its size on the disk")
    note: str = described("the operator's note")
    begun_as: str = described("its name when it was begun, if it was renamed or copied since; else empty")


class Damaged(Record):
    """A session that cannot be read."""

    session: str = described("its name")
    error: str = described("what is wrong with it")


class ShownResult(Record):
    """One complete iteration."""

    iteration: int = described("its number, from 1")
    best: BestRecord = described("the best parameters so far")
    verdict: Verdict = described("whether to stop or to go on, and why")
    timing_s: dict[str, float] = described("wall time by stage; `total` is their sum")


class ShownWaiting(Record):
    """One recorded attempt before its review."""

    trial: int = described("number of the trial, from 1")
    attempt: int = described("which attempt at it, from 1")


class ShownRejection(Record):
    """One attempt that does not count."""

    trial: int = described("number of the trial, from 1")
    attempt: int = described("number of the attempt, from 1")
    at: str = described("when it was rejected, ISO 8601")
    reason: str = described("the reason that the operator gave")


class SessionShown(Output):
    """One session with its trials and results."""

    facts: dict[str, Any] = described("its settings, as in session.toml")
    folder: str = described("its folder")
    units: dict[str, str] = described(UNITS)
    trials: list[PlayedTrial] = described("its trials, in order")
    rejected: list[ShownRejection] = described("attempts that do not count, in order")
    waiting: list[ShownWaiting] = described("recorded attempts that count once they are tracked and reviewed, in order")
    results: list[ShownResult] = described("its complete iterations, in order")
    newer_keys: tuple[str, ...] = described("keys that a newer version of adaptsim wrote; they are kept and not used")


class Verified(Record):
    """One session, file by file."""

    session: str = described("its name")
    files: int = described("files that were read")
    damage: tuple[str, ...] = described("one message a damaged file")
    newer_keys: tuple[str, ...] = described("keys that a newer version of adaptsim wrote; they are kept and not used")


class Amended(Output):
    """A trial that counts again, or counts with another outcome."""

    session: str = described("which session")
    trial: int = described("number of the trial, from 1")
    attempt: int = described("number of the attempt, from 1")
    changed: str = described("what changed, in one sentence")


class Marked(Output):
    """A session after `sessions mark`."""

    session: str = described("which session")
    folder: str = described("its folder")
    note: str = described("the operator's note")


class PrunedRecordings(Output):
    """Recordings that were removed."""

    session: str = described("which session")
    files: int = described("recordings that were removed")
    trials: int = described("trials that they belonged to")
    size_bytes: int = described("disk space freed")


class Quantity(Record):
    """One parameter, context or action."""

    name: str = described("its name")
    unit: str = described("its unit; empty for a plain number")
    low: float = described("lower end of its range")
    high: float = described("upper end of its range")
    scale: str = described("how it is normalised: linear, log or integer")
    plain_name: str = described("its plain name")
    meaning: str = described("what it is, in one line")
    words: list[str] = Field(default=[], description="the words of a category, from 0 on; empty for a number")


class ComparedMethod(Record):
    """The pooled result of the sessions of one method."""

    method: str = described("which method")
    sessions: int = described("how many different sessions")
    identical: int = described("how many more repeat one of these, trial by trial; they do not count")
    last_reward: float = described("mean reward of their last iterations")
    last_ci95: tuple[float, float] | None = described("its 95 % interval; null for one session")
    pairs: int = described("sessions that have a partner of the first method in the same world with the same seed")
    difference: float | None = described("mean difference to the first method over these pairs; null under two pairs")
    difference_ci95: tuple[float, float] | None = described("its 95 % interval")


class ParameterBelief(Record):
    """The belief of one session about one parameter."""

    session: str = described("which session")
    parameter: str = described("which parameter")
    unit: str = described("its unit")
    low: float | None = described("lower end of the 90 % interval; null where the posterior collapsed onto one sample")
    median: float | None = described("median of the posterior; null where it collapsed")
    high: float | None = described("upper end of the interval; null where the posterior collapsed")
    chances: dict[str, float] | None = Field(
        default=None,
        description="the probability of each word of a category; null for a number, or if the posterior collapsed",
    )


class Stored(Record):
    """A trial as first tracked."""

    outcome: str = described("outcome that counts")
    tracked_outcome: str = described("outcome that tracking found")
    reward: float = described("reward that counts")
    context: Quantities = described("context as measured, in `units`")
    flags: list[str] = described("warnings of the tracking")


class Now(Record):
    """The same trial, tracked now."""

    outcome: str = described("tracked outcome")
    reward: float | None = described("its reward; null if there is none")
    context: Quantities | None = described("context as measured, in `units`; null where the object was not found")
    flags: list[str] = described("warnings of the tracking")


class RetrackedTrial(Record):
    """One trial, tracked again."""

    trial: int = described("number of the trial in the session, from 1")
    iteration: int = described("number of its iteration, from 1")
    attempt: int = described("number of the attempt, from 1")
    stored: Stored = described("the track at the time")
    now: Now | None = described("the track now; null if tracking failed")
    same_outcome: bool = described("whether both have the same outcome")
    end_apart_mm: float | None = described("distance between the two ends")
    most_apart_mm: float | None = described("largest distance between the two tracks")
    failure: str | None = described("why tracking failed")
