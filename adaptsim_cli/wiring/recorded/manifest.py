"""`recorded.toml`: where the trials of a folder are, and the names of their columns or topics."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from adaptsim_cli.storage.validation import explained
from hw.bounded import Unreadable, read_table
from perception.types import Outcome
from sim.errors import RecordingsRefused

MANIFEST = "recorded.toml"


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Tables(_Table):
    """Trials as rows of CSV or Parquet files."""

    trials: str = Field("trials.csv", description="file with one row a trial")
    trajectories: str = Field("trajectories.csv", description="file with one row a sample")
    state: tuple[str, ...] = Field(description="columns of a trajectory, in the order of the task's track")
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="our name = theirs, for trial, t_s, outcome, reward, and every context and action",
    )

    def named(self, ours: str) -> str:
        """The file's name of a column."""
        return self.columns.get(ours, ours)


class Mcap(_Table):
    """Trials as MCAP files of ROS 2 messages, one file a trial."""

    files: str = Field("*.mcap", description="which files, each one trial")
    trajectory: str = Field(description="topic of the object's state")
    state: tuple[str, ...] = Field(description="fields of its messages, in the order of the task's track")
    clock: Literal["header", "log", "publish"] = Field(
        "header", description="the time of a message: its header's stamp, or when it was logged or published"
    )
    late_s: float = Field(0.0, description="how much later than the motion the trajectory's times are, s")
    start: str = Field("", description="topic whose first message is time 0; empty: the first state")
    fields: dict[str, str] = Field(
        default_factory=dict,
        description="name = topic:field of the first message, for outcome, reward, every context and action",
    )


class Manifest(_Table):
    """The whole file."""

    task: str = Field(description="the task of the trials")
    outcome: Outcome | None = Field(None, description="how every trial ended; without it each trial says so")
    tables: Tables | None = Field(None, description="trials in CSV or Parquet files")
    mcap: Mcap | None = Field(None, description="trials in MCAP files")
    sessions: tuple[str, ...] = Field((), description="folders of sessions of this program")

    @model_validator(mode="after")
    def _one_source(self) -> Manifest:
        if sum((self.tables is not None, self.mcap is not None, bool(self.sessions))) != 1:
            raise ValueError("name one source: tables, mcap or sessions")
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
