"""Errors of calibration.

CalibrationError
├── CalibrationMissing   no calibration for this rig
├── UnusableViews        the views as a whole cannot be solved
│   ├── TooFewViews      not enough of them, or not enough that agree
│   ├── DegenerateViews  all alike: some direction is not determined
│   └── BoardDisagrees   corners that do not belong to the stated board
├── CalibrationRejected  solved, but a gate says no; the message lists the reasons
└── ViewFolderError      a folder of views, or a stored calibration, is malformed, truncated or incomplete
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np


class CalibrationError(Exception):
    """Base of everything that calibration raises."""


class CalibrationMissing(CalibrationError):
    """There is no calibration for this camera and arm."""


class UnusableViews(CalibrationError):
    """The views cannot be solved."""


class TooFewViews(UnusableViews):
    """Not enough views, or not enough that agree with one another."""


class DegenerateViews(UnusableViews):
    """The board's poses are too similar to determine the result."""


class BoardDisagrees(UnusableViews):
    """Corners that the stated board does not have, or that no pose of the board explains."""


@contextmanager
def determined() -> Iterator[None]:
    """Raise DegenerateViews where a matrix of the views cannot be inverted. Rounding decides whether one can."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise DegenerateViews(
            "the views leave some direction undetermined: check that each view has its own picture and pose, and tilt "
            "the board left, right, up and down"
        ) from error


class CalibrationRejected(CalibrationError):
    """An acceptance gate rejects the calibration; the message lists the reasons."""


class ViewFolderError(CalibrationError):
    """A folder of views, or a stored calibration, is malformed, truncated or incomplete."""
