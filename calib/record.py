"""The common base of all records of a calibration."""

from __future__ import annotations

import hashlib
import json
import math
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict

FORMAT = 1


def _plain(values: Any) -> Any:
    return values.tolist() if isinstance(values, np.ndarray) else values


def _told(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Numbers = Annotated[tuple[float, ...], BeforeValidator(_plain)]
Matrix = Annotated[tuple[Numbers, ...], BeforeValidator(_plain)]
Measured = Annotated[float | None, BeforeValidator(_told)]
"""JSON has no NaN, so a missing measurement is null."""


class Record(BaseModel):
    """Base of all stored records: frozen, finite, and unknown keys are an error.

    It can be validated from the object that it stores; further attributes of that object are ignored.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, from_attributes=True)


class StoredRecord(Record):
    """A record that is the whole of a file."""

    def content(self) -> bytes:
        """The bytes of its file, as JSON."""
        return (json.dumps(self.model_dump(), indent=1, allow_nan=False) + "\n").encode()

    def sha256(self) -> str:
        """SHA-256 of `content`, which a session records."""
        return hashlib.sha256(self.content()).hexdigest()
