"""The records in a session's folder. Checked on reading; never edited after writing."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, ValidationError

from adaptsim_cli.errors import SessionError
from adaptsim_cli.session.stages import TrialKey
from adaptsim_cli.storage import sealed
from adaptsim_cli.storage.validation import place
from hw.bounded import JSON_BYTES, Unreadable, parse_table, read_bytes
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.types import Dimension, Space

if TYPE_CHECKING:
    from sim.adaptation.outlook import Outlook

FORMAT = 3
COUNTED_FROM_ONE_SINCE = 3
"""The first format that also numbers iterations, attempts, particles and results from 1 on the disk."""
SEALED_SINCE = 2
"""The first format in which every record is sealed and holds the SHA-256 of every other file of a session."""

Row = tuple[float, ...]
Samples = tuple[Row, ...]


class Record(BaseModel):
    """Base of all stored records: frozen, and unknown keys are an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class DimensionRecord(Record):
    """A named quantity with its range, so that a session can be read without the task's code."""

    name: str
    unit: str
    low: float
    high: float
    scale: Literal["linear", "log", "integer"]


def as_records(space: Space) -> tuple[DimensionRecord, ...]:
    """The dimensions of a space, in order."""
    return tuple(
        DimensionRecord(name=d.name, unit=d.unit, low=d.low, high=d.high, scale=d.scale) for d in space.dimensions
    )


class Facts(Record):
    """session.toml: the settings that a session was begun with, and must continue with."""

    format: int = FORMAT
    name: str
    task: str
    hw: str
    world: str
    world_sha256: str = ""
    seed: int
    method: str
    adaptsim_is: str = "adaptsim-of-checkpoint"  # what the method adaptsim meant when the session was begun
    solver: str = ""  # how task policies are trained; empty: the checkpoint's solver
    object: str = ""  # file with the ranges of an own object
    particles: int
    trials: int  # per particle and iteration
    created: str  # ISO 8601
    checkpoint: str
    checkpoint_sha256: str
    calibration: str  # where it comes from
    calibration_sha256: str  # of the poses of camera and tool
    camera_late_s: float = 0.0  # measured by the calibration, subtracted from the camera's time stamps
    versions: dict[str, str]
    title: str  # of the task
    object_name: str
    parameters: tuple[DimensionRecord, ...]
    context: tuple[DimensionRecord, ...]
    action: tuple[DimensionRecord, ...]
    curves: dict[str, int] = {}
    """Name -> index of the track's columns that are drawn over time instead of on the table."""

    def named(self) -> dict[str, str | int]:
        """The facts that identify this session, the first columns of every table."""
        keys = {"session": self.name, "task": self.task, "hw": self.hw, "world": self.world}
        return {**keys, "method": self.method, "seed": self.seed}

    @property
    def units(self) -> dict[str, str]:
        """Unit of every parameter, context and action by its name."""
        return {d.name: d.unit for d in (*self.parameters, *self.context, *self.action)}


class SessionStart(Record):
    """start.json: the first particles, as samples in units."""

    particles: tuple[Samples, ...]


class TrackRecord(Record):
    """An `ObjectTrack`."""

    t_s: Row
    state: tuple[Row, ...]
    confidence: Row
    outcome: Outcome
    end_in_tool_m: Row | None  # None: not known
    flags: tuple[str, ...]

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
        )


class KeyMoment(Record):
    """A camera frame stored for the report."""

    label: str  # "start", "contact", "lift", "end"
    t_s: float  # since the start of the tool's motion
    file: str


class MotionRecord(Record):
    """motion.json: a finished motion, with its proposal; stored before the recording is tracked."""

    drawn_context: Row
    context: Row
    action: Row
    predicted_reward: float
    predicted_low: float
    predicted_high: float
    started: str  # ISO 8601
    stopped: str | None  # why the motion ended early; None: it did not
    timing_s: dict[str, float]
    checksums: dict[str, str] = {}  # name -> SHA-256 of each recorded file


class TrialRecord(Record):
    """trial.json: one completed execution."""

    number: int
    attempt: int
    iteration: int
    particle: int
    trial: int
    drawn_context: Row
    context: Row
    goal_m: Row | None = None  # (x, y) wanted place of the object, for a task with such goals
    action: Row
    predicted_reward: float
    predicted_low: float
    predicted_high: float
    observation: Row
    reward: float
    outcome: Outcome
    overruled_from: Outcome | None = None
    track: TrackRecord
    moments: tuple[KeyMoment, ...]
    control_success_rate: float
    started: str  # ISO 8601
    timing_s: dict[str, float]
    files: dict[str, int]  # name -> size in bytes of the other files in the folder, without motion.json
    checksums: dict[str, str] = {}  # name -> SHA-256 of each file derived from the recording

    @property
    def place(self) -> tuple[int, TrialKey]:
        """(iteration, key) of the trial; stages count from 0."""
        return self.iteration - 1, TrialKey(self.number, self.attempt - 1)

    def amended(self, by: Amendment) -> TrialRecord:
        """The trial with its amended outcome and reward."""
        tracked = self.overruled_from or self.outcome
        return self.model_copy(
            update={
                "outcome": by.outcome,
                "overruled_from": None if tracked == by.outcome else tracked,
                "reward": by.reward,
                "observation": by.observation,
                "track": self.track.model_copy(update={"outcome": by.outcome}),
            }
        )


RIG = "rig.json"


class RigFacts(Record):
    """rig.json beside a trial on a real rig: the object's mass, and the state of pedal, tool and camera."""

    object_mass_kg: float | None = None
    weighed: str | None = None  # ISO 8601
    pedal: Literal["held", "waived"] | None = None  # "waived": the rig file waives it
    tool: Literal["held", "waived"] | None = None  # checked by the hand before every motion; "waived": by the rig file
    tool_width_m: float | None = None  # between the fingers that hold it, at the command's first check
    brightness: float | None = None  # median grey value of the picture before the motion, 0 to 255
    camera: dict[str, Any] | None = None  # serial, exposure, white balance, lost frames
    problem: str = ""  # why the other values are missing
    operator: str = ""  # who typed the arm's model
    consent: str | None = None  # ISO 8601: when it was typed
    stop_button: str = ""  # ISO 8601: when the arm's stop button was last found to stop it; "": never, or waived
    waived: tuple[str, ...] = ()  # checks that the rig file waives
    pace: float = 1.0  # of every motion


class Note(Record):
    """A marker beside a trial, with its reason: the motion was about to start, or the trial does not count, or counts
    again.
    """

    at: str  # ISO 8601
    text: str


class Amendment(Note):
    """amended.json beside a completed trial: the outcome that counts from then on."""

    outcome: Outcome
    outcome_before: Outcome
    reward: float
    reward_before: float
    observation: Row


class BestRecord(Record):
    """The particle with the highest mean reward so far, and the 95 % interval of that mean."""

    params: dict[str, float]
    mean_reward: float
    trials: int
    ci95: tuple[float, float]


NOTICEABLE = 0.05
"""Corrections below this fraction of the quantity's range are not shown."""


class OutlookRecord(Record):
    """The expected gain of another iteration, and the correction of the simulator's actions."""

    gain: float  # expected reward gained by one more iteration
    likely: float  # chance that more than 0.05 is left to gain
    done: bool  # another iteration is not worth its trials
    hopeless: bool  # nothing in the ranges of the action is expected to work
    correction: Row  # in units of the action, mean over contexts
    correction_std: Row  # standard deviation over contexts

    def noticeable(self, dimensions: Sequence[Dimension]) -> list[tuple[Dimension, float]]:
        """The quantities of the action with a noticeable correction, each with its correction."""
        pairs = zip(dimensions, self.correction, strict=True)
        return [(d, off) for d, off in pairs if abs(off) >= NOTICEABLE * (d.high - d.low)]

    @classmethod
    def of(cls, outlook: Outlook) -> OutlookRecord:
        """The record of an outlook."""
        return cls(
            gain=outlook.gain,
            likely=outlook.likely,
            done=outlook.done,
            hopeless=outlook.hopeless,
            correction=as_row(outlook.correction),
            correction_std=as_row(outlook.correction_std),
        )


class ResultRecord(Record):
    """result.json: the result of one iteration's trials."""

    iteration: int
    trials: tuple[tuple[int, int], ...]  # (number, attempt)
    next_particles: tuple[Samples, ...]
    best: BestRecord
    verdict: str
    outlook: OutlookRecord | None = None  # None: the method makes no forecast
    timing_s: dict[str, float]
    proposal_s: float  # wall time from the end of the last motion until the next task policies are trained
    summary_sha256: str = ""
    changes: int = 0
    """The number of amended outcomes and restored attempts, up to this iteration, that the result includes."""
    amended: tuple[str, ...] = ()
    """Those of them that no earlier result included, one sentence each."""

    @property
    def keys(self) -> tuple[TrialKey, ...]:
        """The keys of its trials."""
        return tuple(TrialKey(number, attempt - 1) for number, attempt in self.trials)


class Pruned(Record):
    """pruned.json beside a trial: recordings removed to make room, with their sizes in bytes."""

    at: str  # ISO 8601
    files: dict[str, int]  # name -> size in bytes


AnyRecord = TypeVar("AnyRecord", bound=Record)


def to_json(record: Record) -> bytes:
    """The record as indented, sealed JSON. Raises ValueError on a value that is not finite."""
    return sealed.seal_json((json.dumps(record.model_dump(mode="json"), indent=1, allow_nan=False) + "\n").encode())


def to_toml(record: Record) -> bytes:
    """A record as the bytes of a TOML file, sealed."""
    return sealed.seal_toml(tomli_w.dumps(record.model_dump(mode="json")).encode())


def renumbered(record: AnyRecord, by: int) -> AnyRecord:
    """The record with all numbers but that of the trial raised by `by`: earlier formats counted from 0."""
    if isinstance(record, TrialRecord):
        counted = ("attempt", "iteration", "particle", "trial")
        return record.model_copy(update={name: getattr(record, name) + by for name in counted})
    if isinstance(record, ResultRecord):
        trials = tuple((number, attempt + by) for number, attempt in record.trials)
        return record.model_copy(update={"iteration": record.iteration + by, "trials": trials})
    return record


def read(kind: type[AnyRecord], path: Path, *, must_be_sealed: bool = False) -> AnyRecord:
    """Read a record. Raises SessionError naming the file and its defect."""
    data, is_sealed = _load(path)
    version = data.get("format", 1)
    if isinstance(version, int) and version > FORMAT:
        raise SessionError(
            f"{path} is of format {version}; this version reads up to {FORMAT}. Install a newer adaptsim"
        )
    if not is_sealed and (must_be_sealed or (isinstance(version, int) and version >= SEALED_SINCE)):
        raise corrupt(path, "its checksum is missing")
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = place(first["loc"]) or "the whole file"
        raise corrupt(path, f"{where}: {first['msg']}") from error


def read_object(path: Path) -> dict[str, Any]:
    """The one table of a TOML or JSON file. Raises SessionError naming the file."""
    return _load(path)[0]


def _load(path: Path) -> tuple[dict[str, Any], bool]:
    """The table in a file, and whether it is sealed."""
    try:
        content = read_bytes(path, JSON_BYTES)
        is_sealed = sealed.is_sealed(content, path.suffix)
        data = parse_table(content, is_toml=path.suffix == ".toml")
    except FileNotFoundError as error:
        raise corrupt(path, "it is missing") from error
    except (Unreadable, sealed.SealBroken) as error:
        raise corrupt(path, f"it {error}") from error
    if is_sealed:
        data.pop(sealed.KEY, None)
    return data, is_sealed


def require_size(path: Path, size: int) -> None:
    """Raises SessionError unless there is a file of `size` bytes."""
    found = path.stat().st_size if path.is_file() else None
    if found != size:
        raise corrupt(path, "it is missing" if found is None else f"{found} bytes instead of {size}")


def corrupt(path: Path, why: str) -> SessionError:
    """The error for a damaged file, with the way out."""
    return SessionError(
        f"{path} is corrupt or incomplete ({why}). Restore it from a copy, or start another session with --session"
    )


def as_row(array: Array) -> Row:
    """An array of any shape as one flat row of floats."""
    return tuple(float(x) for x in np.asarray(array).ravel())
