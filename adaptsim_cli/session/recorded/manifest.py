"""`recorded.toml`, which says where the trials of a folder are; and each trial as read, checked against its task."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from adaptsim_cli.errors import explained
from hw.bounded import Unreadable, read_table
from hw.records import Record, number_hint
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.errors import RecordingsRefused
from sim.rollouts.recorded import RecordedTrials
from sim.tasks.task import Task
from sim.types import Space

MANIFEST = "recorded.toml"


class Tables(Record):
    """Trials as rows of CSV or Parquet files."""

    trials: str = Field("trials.csv", description="file with one row per trial")
    trajectories: str = Field("trajectories.csv", description="file with one row per sample")
    state: tuple[str, ...] = Field(description="columns of a trajectory, in the order of the task's track")
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="our name = theirs, for trial, t_s, outcome, reward, contexts, actions, end_in_tool_x_m (y, z)",
    )

    @model_validator(mode="after")
    def _one_name_each(self) -> Tables:
        names = dict[str, str]()
        for ours, theirs in self.columns.items():
            if (other := names.setdefault(theirs, ours)) != ours:
                raise ValueError(f"columns reads {other} and {ours} from {theirs!r}: each needs a column of its own")
        if repeated := next((name for i, name in enumerate(self.state) if name in self.state[:i]), None):
            raise ValueError(f"state names the column {repeated!r} twice: each quantity needs a column of its own")
        return self

    def named(self, ours: str) -> str:
        """The file's name of a column."""
        return self.columns.get(ours, ours)

    def our_names(self, columns: Iterable[str]) -> dict[str, str]:
        """Our name of each column that counts. A mapped column overrides a column of that name."""
        renamed = {theirs: name for name, theirs in self.columns.items()}
        return {c: renamed.get(c, c) for c in columns if c in renamed or c not in self.columns}

    def unused(self, file: str, columns: Iterable[str]) -> tuple[str, ...]:
        """A sentence for each column whose name is mapped to another column of the same file."""
        present = list(columns)
        return tuple(
            f"the column {ours!r} of {file} is not used, because {ours} is read from {theirs!r}"
            for ours, theirs in self.columns.items()
            if ours != theirs and ours in present and theirs in present and ours not in self.columns.values()
        )


class Mcap(Record):
    """Trials as MCAP files of ROS 2 messages, one file per trial."""

    files: str = Field("*.mcap", description="which files, each one trial")
    trajectory: str = Field(description="topic of the object's state")
    state: tuple[str, ...] = Field(description="fields of its messages, in the order of the task's track")
    clock: Literal["header", "log", "publish"] = Field(
        "header", description="the time of a message: its header's stamp, or when it was logged or published"
    )
    late_s: float = Field(0.0, description="delay of the trajectory's times after the motion, s")
    start: str = Field("", description="topic whose first message is time 0; empty: the first state")
    fields: dict[str, str] = Field(
        default_factory=dict,
        description="name = topic:field of the first message, for outcome, reward, every context and action",
    )


class LeRobot(Record):
    """Trials as episodes of a LeRobot data set; names are columns, with an index in brackets: `action[0]`."""

    files: str = Field("data/**/*.parquet", description="which files")
    state: tuple[str, ...] = Field(description="columns of a trajectory, in the order of the task's track")
    fields: dict[str, str] = Field(
        default_factory=dict, description="name = column in an episode's first row, for every context and action"
    )


class Robomimic(Record):
    """Trials as demonstrations of robomimic's HDF5 files; names are data sets of one: `obs/object[0]`, `attrs/yaw`."""

    files: str = Field("*.hdf5", description="which files")
    rate_hz: float = Field(gt=0, description="steps in a second, which the files do not say")
    state: tuple[str, ...] = Field(description="data sets of a trajectory, in the order of the task's track")
    fields: dict[str, str] = Field(
        default_factory=dict, description="name = data set in the first step, for every context and action"
    )


class Manifest(Record):
    """The whole file."""

    task: str = Field(description="the task of the trials")
    outcome: Outcome | None = Field(None, description="how every trial ended; without it each trial says so")
    tables: Tables | None = Field(None, description="trials in CSV or Parquet files")
    mcap: Mcap | None = Field(None, description="trials in MCAP files")
    lerobot: LeRobot | None = Field(None, description="trials as episodes of a LeRobot data set")
    robomimic: Robomimic | None = Field(None, description="trials as demonstrations of robomimic files")
    sessions: tuple[str, ...] = Field((), description="folders of sessions of this program")
    as_written: bool = Field(
        False, description="true: use the trials as written, although another reading of them fits the simulator better"
    )

    @model_validator(mode="after")
    def _one_source(self) -> Manifest:
        sources = (self.tables, self.mcap, self.lerobot, self.robomimic, self.sessions or None)
        if sum(source is not None for source in sources) != 1:
            raise ValueError("name one source: tables, mcap, lerobot, robomimic or sessions")
        return self


def read_manifest(path: Path) -> Manifest:
    """Read it. Raises RecordingsRefused naming the key."""
    try:
        return Manifest.model_validate(read_table(path))
    except FileNotFoundError as error:
        raise RecordingsRefused(
            f"{path} is missing: it says where the recorded trials are (docs/guide/recorded-trials.md)"
        ) from error
    except Unreadable as error:
        raise RecordingsRefused(f"{path} {error}") from error
    except ValidationError as error:
        raise RecordingsRefused(f"{path}: {explained(error)}") from error


REWARD, OUTCOME, TRIAL, TIME = "reward", "outcome", "trial", "t_s"
END = ("end_in_tool_x_m", "end_in_tool_y_m", "end_in_tool_z_m")
"""The object's last position in the tool's frame, for a task whose successes end there (`LabReport.ends_in_tool`)."""
AGREES = 0.02
"""How far a recorded reward may be from that of the task."""


@dataclass(frozen=True, eq=False)
class RawTrial:
    """The values of a trial by name; unknown ones are kept and not used."""

    name: str
    values: Mapping[str, float | str]
    t_s: Array  # (N,)
    state: Array  # (N, d)
    end_in_tool_m: Array = field(default_factory=lambda: np.full(3, np.nan))


def checked(
    task: Task,
    raw: Sequence[RawTrial],
    outcome: Outcome | None,
    notes: tuple[str, ...] = (),
    *,
    as_written: bool = True,
) -> RecordedTrials:
    """The trials as the task knows them, with `notes` about their reading. Raises RecordingsRefused."""
    named = set(raw[0].values) if raw else set()
    has_context = set(task.context.names) <= named
    trials = RecordedTrials(
        task,
        tuple(trial.name for trial in raw),
        np.array([_point(trial, task.context) for trial in raw]) if has_context else None,
        np.array([_point(trial, task.action) for trial in raw]).reshape(len(raw), len(task.action)),
        tuple(_track(trial, outcome) for trial in raw),
        notes,
        as_written,
    )
    _require_ends(trials)
    if trials.contexts is not None and REWARD in named:
        _require_rewards(trials, raw)
    return trials


def _point(trial: RawTrial, space: Space) -> Array:
    return np.array([_number(trial, name) for name in space.names])


def _number(trial: RawTrial, name: str) -> float:
    try:
        value = float(trial.values[name])
    except KeyError as error:
        listing = ", ".join(sorted(trial.values))
        raise RecordingsRefused(f"trial {trial.name}: {name} is missing; there are {listing}") from error
    except (TypeError, ValueError) as error:
        cell = trial.values[name]
        raise RecordingsRefused(f"trial {trial.name}: {name} = {cell!r} is not a number{number_hint(cell)}") from error
    if not math.isfinite(value):
        raise RecordingsRefused(f"trial {trial.name}: {name} = {value:g} is not finite")
    return value


def _track(trial: RawTrial, outcome: Outcome | None) -> ObjectTrack:
    n = len(trial.t_s)
    if trial.state.shape[:1] != (n,):
        raise RecordingsRefused(f"trial {trial.name}: it has {n} times and {len(trial.state)} states")
    end_m = trial.end_in_tool_m
    if any(name in trial.values and trial.values[name] not in ("", None) for name in END):
        end_m = np.array([_number(trial, name) for name in END])
    try:
        return ObjectTrack(trial.t_s, trial.state, outcome or _outcome(trial), end_m, np.ones(n))
    except ValueError as error:
        raise RecordingsRefused(f"trial {trial.name}: {error}") from error


def _require_ends(trials: RecordedTrials) -> None:
    """Raises RecordingsRefused for a success whose reward needs an end that was not recorded."""
    for name, track in zip(trials.names, trials.tracks, strict=True):
        ending = trials.task.end_of(track)
        if ending is not None and not np.isfinite(ending).all():
            raise RecordingsRefused(
                f"trial {name}: it ended {track.outcome.value}, and its reward needs the object's last position in "
                f"the tool's frame: give {', '.join(END)} in m, as columns of the trials (empty for other outcomes)"
            )


def _outcome(trial: RawTrial) -> Outcome:
    listing = ", ".join(Outcome)
    if OUTCOME not in trial.values:
        raise RecordingsRefused(
            f"trial {trial.name}: its outcome is missing: name its column, or one outcome for all, of {listing}"
        )
    try:
        return Outcome(str(trial.values[OUTCOME]))
    except ValueError as error:
        raise RecordingsRefused(
            f"trial {trial.name}: outcome {trial.values[OUTCOME]!r} is not known: it must be one of {listing}"
        ) from error


def _require_rewards(trials: RecordedTrials, raw: Sequence[RawTrial]) -> None:
    """Raises RecordingsRefused if the task computes another reward than the one in the recording."""
    for trial, track, context in zip(
        raw, trials.tracks, [] if trials.contexts is None else trials.contexts, strict=True
    ):
        reward, scored = _number(trial, REWARD), trials.task.score(track, context)
        if not abs(reward - scored) <= AGREES:  # so that NaN does not pass
            raise RecordingsRefused(
                f"trial {trial.name}: its recorded reward is {reward:.3f}, and the task scores it {scored:.3f}: "
                "check columns and units, or leave the rewards out"
            )
