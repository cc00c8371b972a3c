"""How many trials a session will need, as it is kept beside a checkpoint (`trials_needed` computes it)."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from hw.records import Record, from_any_version
from sim.storage.files import read_toml, write_toml

FILE = "trials.toml"
"""The forecast in the folder of its checkpoint."""


MOST_PAIRS = 60
"""The most pairs that are considered."""


class SessionShare(Record):
    """The share of the imagined sessions that need no more trials, or pairs."""

    most: int | None = Field(default=None, description="trials or pairs; null: more than were played")
    share: float = Field(description="share of the imagined sessions that need no more")


class TrialsNeeded(Record):
    """Trials until something happens in a session."""

    half: SessionShare = Field(description="at least half of the imagined sessions")
    four_of_five: SessionShare = Field(description="at least four of five of them")


class PairsNeeded(TrialsNeeded):
    """Pairs of trials until a gain over UDR is shown."""

    difference: float = Field(description="true gain of reward over UDR")


class TrialsForecast(Record):
    """How many trials the sessions of the default method need, by sessions in imagined worlds."""

    task: str = Field(description="which task")
    checkpoint_sha256: str = Field(description="weights of the checkpoint")
    particles: int = Field(description="particles of a session")
    sessions: int = Field(description="imagined sessions")
    trials: int = Field(description="trials of each")
    seed: int = Field(description="seed of worlds and trials")
    first_success: TrialsNeeded = Field(
        description="trials until the end of the iteration with the first reward above 0.05"
    )
    stop: TrialsNeeded | None = Field(
        default=None, description="trials until the verdict says stop, in files of earlier versions; else null"
    )
    shown: tuple[PairsNeeded, ...] = Field(description="pairs of trial and control trial until a gain is shown")


def save(forecast: TrialsForecast, folder: Path) -> None:
    """Keep it in the folder of its checkpoint. Raises OSError."""
    write_toml(folder / FILE, forecast.model_dump(exclude_none=True))


def load(folder: Path, checkpoint_sha256: str) -> TrialsForecast | None:
    """The forecast of the checkpoint in `folder`; None if it is missing, unreadable, or made with other weights."""
    try:
        forecast = from_any_version(TrialsForecast, read_toml(folder / FILE))
    except (OSError, ValueError):
        return None
    return forecast if forecast.checkpoint_sha256 == checkpoint_sha256 else None
