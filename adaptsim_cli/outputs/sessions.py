"""Outputs of the commands that read and keep sessions."""

from __future__ import annotations

from typing import Any

from adaptsim_cli.outputs import Output, Quantities, said
from adaptsim_cli.outputs.trials import UNITS, BestRecord, PlayedTrial
from hw.records import Record
from perception.types import Outcome
from sim.adaptation.verdict import Verdict


class SessionRow(Record):
    """One session in one line. A damaged one has only `session` and `error`."""

    session: str = said("its name")
    task: str = said("which task")
    hw: str = said("hardware: fake, panda or fr3")
    world: str = said("world of the simulated lab; empty on a real arm")
    method: str = said("method of adaptation")
    seed: int = said("seed of all random numbers")
    created: str = said("when it was begun")
    iterations: int = said("complete iterations")
    trials: int = said("completed trials that count")
    mean_reward: float | None = said("of these trials; null without one")
    verdict: Verdict | None = said("of its last iteration; null before the first")
    size_bytes: int = said("its size on the disk")
    note: str = said("the operator's note")
    begun_as: str = said("its name when it was begun, if it was renamed or copied since; else empty")


class Damaged(Record):
    """A session that cannot be read."""

    session: str = said("its name")
    error: str = said("what is wrong with it")


class SessionList(Output):
    """All sessions, newest last."""

    sessions: list[SessionRow | Damaged] = said("one each")


class ShownTrial(PlayedTrial):
    """One completed trial that counts, with its place in the session."""

    attempt: int = said("which attempt at it counts, from 1")
    iteration: int = said("number of its iteration, from 1")
    particle: int = said("number of its particle, from 1")
    predicted_reward: float = said("reward that the simulator predicted")
    overruled_from: Outcome | None = said("tracked outcome, if the operator set another")
    timing_s: dict[str, float] = said("wall time by stage")


class ShownResult(Record):
    """One complete iteration."""

    iteration: int = said("its number, from 1")
    best: BestRecord = said("the best parameters so far")
    verdict: Verdict = said("whether to stop or to go on, and why")
    timing_s: dict[str, float] = said("wall time by stage; `total` is their sum")


class ShownRejection(Record):
    """One attempt that does not count."""

    trial: int = said("number of the trial, from 1")
    attempt: int = said("number of the attempt, from 1")
    at: str = said("when it was rejected, ISO 8601")
    reason: str = said("the reason that the operator gave")


class SessionShown(Output):
    """One session with all that counts in it."""

    facts: dict[str, Any] = said("its settings, as in session.toml")
    folder: str = said("its folder")
    units: dict[str, str] = said(UNITS)
    trials: list[ShownTrial] = said("its trials, in order")
    rejected: list[ShownRejection] = said("attempts that do not count, in order")
    results: list[ShownResult] = said("its complete iterations, in order")
    newer_keys: tuple[str, ...] = said("keys that a newer version of adaptsim wrote; they are kept and not used")


class Verified(Record):
    """One session, file by file."""

    session: str = said("its name")
    files: int = said("files that were read")
    damage: tuple[str, ...] = said("one message a damaged file")
    newer_keys: tuple[str, ...] = said("keys that a newer version of adaptsim wrote; they are kept and not used")


class VerifiedSessions(Output):
    """Sessions that were read from end to end."""

    sessions: list[Verified] = said("one each")


class Redone(Output):
    """A trial that will be done again."""

    session: str = said("which session")
    trial: int = said("number of the trial, from 1")
    next_attempt: int = said("number of its next attempt, from 1")


class Amended(Output):
    """A trial that counts again, or counts with another outcome."""

    session: str = said("which session")
    trial: int = said("number of the trial, from 1")
    attempt: int = said("number of the attempt, from 1")
    changed: str = said("what changed, in one sentence")


class Marked(Output):
    """A session after `sessions mark`."""

    session: str = said("which session")
    folder: str = said("its folder")
    note: str = said("the operator's note")


class Deleted(Output):
    """A session that was deleted."""

    session: str = said("which session")
    deleted: bool = said("true")


class PrunedRecordings(Output):
    """Recordings that were removed."""

    session: str = said("which session")
    files: int = said("recordings that were removed")
    trials: int = said("trials that they belonged to")
    size_bytes: int = said("disk space freed")


class Quantity(Record):
    """One parameter, context or action."""

    name: str = said("its name")
    unit: str = said("its unit; empty for a plain number")
    low: float = said("lower end of its range")
    high: float = said("upper end of its range")
    scale: str = said("how it is normalised: linear, log or integer")
    plain_name: str = said("its plain name")
    meaning: str = said("what it is, in one line")


class Policy(Output):
    """The best policy of a session as a table."""

    format: int = said("version of the table")
    session: str = said("which session")
    task: str = said("which task")
    checkpoint: str = said("checkpoint that it was trained with")
    checkpoint_sha256: str = said("hash of the checkpoint's weights")
    parameters: Quantities = said("parameters that it was trained for, in the units of `quantities`")
    quantities: dict[str, list[Quantity]] = said("the quantities in `parameters`, `context` and `action`, in order")
    contexts: list[list[float]] = said("contexts over the whole area, in units")
    actions: list[list[float]] = said("the policy's action at each, in units")


class Exported(Output):
    """Trials in the format of another program."""

    session: str = said("which session")
    format: str = said("which format")
    written: list[str] = said("files and folders that were written")


class Replayed(Output):
    """A trial as a video or a Rerun file."""

    session: str = said("which session")
    trial: int = said("number of the trial, from 1")
    recording: str = said("the recording that it was made from")
    written: str = said("file that was written")


class Bundled(Output):
    """A session for a bug report."""

    session: str = said("which session")
    bundle: str = said("archive that was written")
    files: list[str] = said("its contents")


class Reported(Output):
    """The page of a session."""

    session: str = said("which session")
    report: str = said("page that was written")


class ComparedMethod(Record):
    """The pooled result of the sessions of one method."""

    method: str = said("which method")
    sessions: int = said("how many sessions")
    last_reward: float = said("mean reward of their last iterations")
    last_ci95: tuple[float, float] | None = said("its 95 % interval; null for one session")
    pairs: int = said("sessions that have a partner of the first method in the same world with the same seed")
    difference: float | None = said("mean difference to the first method over these pairs; null under two pairs")
    difference_ci95: tuple[float, float] | None = said("its 95 % interval")


class ParameterBelief(Record):
    """What one session believes of one parameter."""

    session: str = said("which session")
    parameter: str = said("which parameter")
    unit: str = said("its unit")
    low: float = said("lower end of the 90 % interval")
    median: float = said("median of the posterior")
    high: float = said("upper end of the interval")


class Compared(Output):
    """Several sessions beside each other."""

    task: str = said("which task")
    sessions: list[dict[str, str | int | float]] = said("the rows of sessions.csv")
    methods: list[ComparedMethod] = said("one for each method")
    posteriors: list[ParameterBelief] = said("one for each session with a posterior and each parameter")
    page: str = said("page that was written")
    tables: list[str] = said("tables that were written")


class Stored(Record):
    """A trial as first tracked."""

    outcome: str = said("outcome that counts")
    tracked_outcome: str = said("outcome that tracking found")
    reward: float = said("reward that counts")
    context: Quantities = said("context as measured, in `units`")
    flags: list[str] = said("warnings of the tracking")


class Now(Record):
    """The same trial, tracked now."""

    outcome: str = said("tracked outcome")
    reward: float | None = said("its reward; null if there is none")
    context: Quantities | None = said("context as measured, in `units`; null where the object was not found")
    flags: list[str] = said("warnings of the tracking")


class RetrackedTrial(Record):
    """One trial, tracked again."""

    trial: int = said("number of the trial in the session, from 1")
    iteration: int = said("number of its iteration, from 1")
    attempt: int = said("number of the attempt, from 1")
    stored: Stored = said("the track at the time")
    now: Now | None = said("the track now; null if tracking failed")
    same_outcome: bool = said("whether both have the same outcome")
    end_apart_mm: float | None = said("distance between the two ends")
    most_apart_mm: float | None = said("largest distance between the two tracks")
    failure: str | None = said("why tracking failed")


class Retracked(Output):
    """Trials of a session, tracked again."""

    session: str = said("which session")
    units: dict[str, str] = said(UNITS)
    trials: list[RetrackedTrial] = said("one each")
