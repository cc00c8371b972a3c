"""What all records of a calibration have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

FORMAT = 1

Numbers = tuple[float, ...]
Matrix = tuple[Numbers, ...]


class Record(BaseModel):
    """Base of everything that a calibration stores: frozen, finite, and unknown keys are an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
