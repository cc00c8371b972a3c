"""The records in a session's folder, and the random numbers of its steps.

Records are checked on reading and never edited after writing.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
from pydantic import Field, ValidationError

from adaptsim_cli.errors import SessionError, explained
from adaptsim_cli.screen.outputs import Quantities
from adaptsim_cli.screen.outputs.trials import BestRecord, ControlRecord, ForecastRecord, SuspicionRecord, TrackRecord
from adaptsim_cli.storage import durable
from hw.bounded import JSON_BYTES, Unreadable, parse_table, read_bytes
from hw.records import AnyRecord, Record, content_of, from_any_version
from hw.types import Array
from perception.types import Outcome
from sim.adaptation.method import FAILED
from sim.adaptation.stages import Layout, Role, TrialKey
from sim.adaptation.verdict import Verdict
from sim.types import Space


def now() -> str:
    """The time for a record, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


class Draw(IntEnum):
    """The purpose of a random number; part of its seed."""

    START = 0
    CONTEXT = 1
    NEXT = 2
    CONTROL = 3


def generator(
    seed: int, draw: Draw, iteration: int = 0, particle: int = 0, trial: int = 0, attempt: int = 0
) -> np.random.Generator:
    """The random numbers of one step. They depend only on the step, never on earlier steps."""
    return np.random.default_rng(np.random.SeedSequence((seed, int(draw), iteration, particle, trial, attempt)))


FORMAT = 4

WITH_CONTROL = 5
"""The format of a session with control trials, because an older program would learn from them. Others have FORMAT."""

ROLLOUT = "rollout"
"""The `method` of a session without adaptation: trials with a chosen action or policy."""

Row = tuple[float, ...]
Samples = tuple[Row, ...]


class DimensionRecord(Record):
    """A named quantity with its range, so that a session can be read without the task's code."""

    name: str
    unit: str
    low: float
    high: float
    scale: Literal["linear", "log", "integer"]
    words: tuple[str, ...] = ()  # of a category, whose value is an index


def as_records(space: Space) -> tuple[DimensionRecord, ...]:
    """The dimensions of a space, in order."""
    return tuple(
        DimensionRecord(name=d.name, unit=d.unit, low=d.low, high=d.high, scale=d.scale, words=d.words)
        for d in space.dimensions
    )


class SessionFacts(Record):
    """session.toml: the settings that a session was begun with, and must continue with."""

    format: int = FORMAT
    name: str
    task: str
    hw: str
    world: str
    world_sha256: str = ""  # hash of the world's file, or of the recorded trials
    recorded: str = ""  # folder of the recorded trials; empty: trials happen
    held_out: float = 0.0  # fraction of the recorded trials held out for scoring
    start_from: str = ""  # session whose posterior this one began with
    start_from_sha256: str = ""  # hash of that posterior
    policy_of: str = ""  # of a rollout: session whose best policy acts
    control: str = ""  # method or session whose policy makes the control trials; empty: there are none
    control_sha256: str = ""  # hash of that session's record
    pairs: int = 0  # planned for the comparison with the control; 0: those of a session of five iterations
    control_seed: int = 0  # of the order of control trials; random on a real arm, where a person must not know it
    seed: int
    method: str  # how particles are updated; "rollout": nothing is adapted
    task_file: str = ""  # that declares the task; empty: a package
    task_sha256: str = ""  # of its content
    solver: str = ""  # how task policies are trained; empty: the checkpoint's solver
    object: str = ""  # file with the ranges of an own object
    particles: int
    trials: int  # per particle and iteration
    created: str  # ISO 8601
    checkpoint: str
    checkpoint_sha256: str
    checkpoint_folder: str = ""  # of a checkpoint that does not ship
    calibration: str  # where it comes from
    calibration_sha256: str  # of the poses of camera and tool
    camera_late_s: float = 0.0  # measured by the calibration, subtracted from the camera's time stamps
    versions: dict[str, str]
    title: str  # of the task
    object_name: str
    parameters: tuple[DimensionRecord, ...]
    context: tuple[DimensionRecord, ...]
    action: tuple[DimensionRecord, ...]
    curves: dict[str, int] = Field(default_factory=dict)
    """Name -> index of the track's columns that are drawn over time instead of on the table."""

    def named(self) -> dict[str, str | int]:
        """The facts that identify this session, the first columns of every table."""
        keys = {"session": self.name, "task": self.task, "hw": self.hw, "world": self.world}
        return {**keys, "method": self.method, "seed": self.seed}

    @property
    def layout(self) -> Layout:
        """The trials of its iterations.

        The first policies have learnt nothing yet, unless they begin with the posterior of another session. So control
        trials begin with the second iteration.
        """
        begin = None if not self.control else 0 if self.start_from else 1
        return Layout(self.particles, self.trials, begin, self.control_seed)

    @property
    def units(self) -> dict[str, str]:
        """Unit of every parameter, context and action by its name."""
        return {d.name: d.unit for d in (*self.parameters, *self.context, *self.action)}


class SessionStart(Record):
    """start.json: the first particles, as samples in units."""

    particles: tuple[Samples, ...]


class KeyMoment(Record):
    """A camera frame stored for the report."""

    label: str  # "start", "contact", "lift", "end"
    t_s: float  # since the start of the tool's motion
    file: str


class Film(Record):
    """The film of a trial: `film.jpg`, a sheet of small pictures in reading order, evenly in time (`film.py`)."""

    end_s: float  # time of the last picture since the start of the tool's motion; the first one shows that start
    camera: Row  # (12,) 3 x 4, row by row: a point in the base frame in m -> its place in a picture, from 0 to 1


class MotionRecord(Record):
    """A trial until it is tracked: proposed, then moved, and stored as motion.json before anybody tracks it."""

    trial: int  # number of the trial in the session, from 1
    attempt: int  # number of the attempt, from 1
    iteration: int
    particle: int
    parameters: Quantities  # the particle's mean, for which its policy was trained
    drawn_context: Quantities  # wanted, before the camera measured
    context: Quantities  # as measured
    goal_m: Row | None  # (x, y) wanted place of the object, for a task with such goals
    action: Quantities  # commanded
    predicted_reward: float
    predicted_low: float  # lower end of its 95 % interval
    predicted_high: float  # upper end
    started: str = ""  # ISO 8601; "": it has not moved
    stopped: str | None = None  # why the motion ended early; None: it did not
    timing_s: dict[str, float] = Field(default_factory=dict)  # wall time by stage
    checksums: dict[str, str] = Field(default_factory=dict)  # name -> SHA-256 of each recorded file
    role: Role = Role.ALONE  # the policy that acts: the session's own or the control's

    @property
    def is_blind(self) -> bool:
        """Whether the trial has a partner. Then the operator must not know which policy acts."""
        return self.role is not Role.ALONE

    @property
    def position(self) -> tuple[int, TrialKey]:
        """(iteration, key) of the trial; stages count from 0."""
        return self.iteration - 1, TrialKey(self.trial, self.attempt - 1)

    @property
    def context_array(self) -> Array:
        """(c,) the measured context, in units."""
        return np.array(list(self.context.values()))

    @property
    def action_array(self) -> Array:
        """(a,) the commanded action, in units."""
        return np.array(list(self.action.values()))


class TrialRecord(MotionRecord):
    """trial.json: one tracked trial; JSON, tables, pages and films are views of it."""

    observation: tuple[float | None, ...]  # null: not observed
    reward: float
    outcome: Outcome
    overruled_from: Outcome | None = None
    ended: str = ""  # the end in the task's own words
    track: TrackRecord
    moments: tuple[KeyMoment, ...]
    film: Film | None = None  # None without a camera
    control_success_rate: float
    files: dict[str, int] = Field(default_factory=dict)  # name -> bytes of the other files, without motion.json

    @property
    def is_rewarded(self) -> bool:
        """Whether its reward is above `FAILED`, for a success or as partial credit; for dots, pills and counts."""
        return self.reward > FAILED

    @property
    def outcome_words(self) -> str:
        """The outcome in plain words."""
        own_words = "" if self.overruled_from is not None else self.ended
        return own_words or self.outcome.value.replace("_", " ")

    @property
    def off_goal_mm(self) -> float | None:
        """Distance of the object's final place from its goal; None without a goal."""
        return None if self.goal_m is None else 1e3 * math.dist(self.track.state[-1][:2], self.goal_m)

    def counting_as(self, outcome: Outcome, reward: float, observation: tuple[float | None, ...]) -> TrialRecord:
        """The trial with the outcome that an operator set."""
        tracked = self.overruled_from or self.outcome
        return self.model_copy(
            update={
                "outcome": outcome,
                "overruled_from": None if tracked == outcome else tracked,
                "reward": reward,
                "observation": observation,
                "track": self.track.model_copy(update={"outcome": outcome}),
            }
        )


RIG = "rig.json"


class Note(Record):
    """A marker beside a trial, with its reason: the motion was about to start, or the trial does not count, or counts
    again.
    """

    at: str  # ISO 8601
    text: str


class Started(Note):
    """started.json beside a trial: the proposed trial, just before its motion."""

    proposed: MotionRecord | None = None


class Amendment(Note):
    """amended.json beside a completed trial: the outcome that counts from then on."""

    outcome: Outcome
    outcome_before: Outcome
    reward: float
    reward_before: float
    observation: tuple[float | None, ...]


class ResultRecord(Record):
    """result.json: the result of one iteration's trials."""

    iteration: int
    trials: tuple[tuple[int, int], ...]  # (number, attempt)
    next_particles: tuple[Samples, ...]
    best: BestRecord
    verdict: Verdict
    outlook: ForecastRecord | None = None  # None: the method makes no forecast
    suspicion: SuspicionRecord | None = None  # what the trials so far hint at about the rig
    timing_s: dict[str, float]
    proposal_s: float  # wall time from the end of the last motion until the next task policies are trained
    summary_sha256: str = ""
    control: ControlRecord | None = None  # None: no pair of a trial and its control yet
    changes: int = 0
    """The number of amended outcomes and restored attempts, up to this iteration, that the result includes."""
    amended: tuple[str, ...] = ()
    """The amendments that no earlier result included, one sentence each."""

    @property
    def keys(self) -> tuple[TrialKey, ...]:
        """The keys of its trials."""
        return tuple(TrialKey(number, attempt - 1) for number, attempt in self.trials)


class Pruned(Record):
    """pruned.json beside a trial: recordings removed to make room, with their sizes in bytes."""

    at: str  # ISO 8601
    files: dict[str, int]  # name -> size in bytes


def to_json(record: Record) -> bytes:
    """The record as indented, sealed JSON. Raises ValueError on a value that is not finite."""
    return durable.seal_json((json.dumps(content_of(record), indent=1, allow_nan=False) + "\n").encode())


def to_toml(record: Record) -> bytes:
    """A record as the bytes of a TOML file, sealed."""
    return durable.seal_toml(tomli_w.dumps(content_of(record)).encode())


def read(kind: type[AnyRecord], path: Path) -> AnyRecord:
    """Read a record, of this version or a newer one of the same format. Raises SessionError naming file and defect."""
    data = table(path, is_sealed=True)
    version = data.get("format", FORMAT)
    if isinstance(version, int) and version < FORMAT:
        raise earlier(f"{path} is of format {version}{_writer(data)}", path.parent)
    if version not in (FORMAT, WITH_CONTROL):
        raise SessionError(
            f"{path} is of format {version}, and this version of adaptsim reads format {WITH_CONTROL}. Update "
            "adaptsim, or start another session with --session"
        )
    try:
        return from_any_version(kind, data)
    except ValidationError as error:
        if isinstance(data.get("context"), list) and "format" not in data:
            raise earlier(f"{path} was written by an earlier version", path.parents[2]) from error
        raise corrupt(path, explained(error)) from error


def earlier(sentence: str, folder: Path) -> SessionError:
    """The error for the session of an earlier format in `folder`; `sentence` says how the format was recognised."""
    return SessionError(
        f"{sentence}, and this version of adaptsim reads formats {FORMAT} and {WITH_CONTROL}. `adaptsim sessions "
        f"migrate {folder.name}` writes the session again for this version, and keeps the old one; `adaptsim report` "
        "and --recorded read it as it is"
    )


def _writer(data: Mapping[str, Any]) -> str:
    """The version that wrote a record, ", written by adaptsim 0.1.0"; "" if the record does not say."""
    versions = data.get("versions")
    version = versions.get("adaptsim") if isinstance(versions, dict) else None
    return f", written by adaptsim {version}" if isinstance(version, str) else ""


_UNSEALED = b"format = 1\n"
"""The first line of the session.toml of a session without seals."""


def table(path: Path, *, is_sealed: bool) -> dict[str, Any]:
    """The table in a file, without its seal."""
    try:
        content = read_bytes(path, JSON_BYTES)
        if is_sealed and not content.startswith(_UNSEALED):
            durable.require_seal(content, path.suffix)
        data = parse_table(content, is_toml=path.suffix == ".toml")
    except FileNotFoundError as error:
        raise corrupt(path, "it is missing") from error
    except (Unreadable, durable.SealBroken) as error:
        raise corrupt(path, f"it {error}") from error
    data.pop(durable.SEAL, None)
    return data


def require_size(path: Path, size: int) -> None:
    """Raises SessionError unless there is a file of `size` bytes."""
    actual_size = path.stat().st_size if path.is_file() else None
    if actual_size != size:
        raise corrupt(path, "it is missing" if actual_size is None else f"{actual_size} bytes instead of {size}")


def corrupt(path: Path, why: str) -> SessionError:
    """The error for a damaged file, with the way out."""
    return SessionError(
        f"{path} is corrupt or incomplete ({why}). Restore it from a copy, or start another session with --session"
    )
