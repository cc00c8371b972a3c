"""What all records of a calibration have in common."""

from __future__ import annotations

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
"""JSON knows no NaN: what was not measured is null."""


class Record(BaseModel):
    """Base of everything that a calibration stores: frozen, finite, and unknown keys are an error.

    It can be validated from the value that it stores, whose further attributes are left out.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, from_attributes=True)
