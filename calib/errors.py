"""What can go wrong in calibration.

CalibrationError
└── CalibrationMissing   no calibration for this rig
"""


class CalibrationError(Exception):
    """Base of everything that calibration raises."""


class CalibrationMissing(CalibrationError):
    """There is no calibration for this camera and arm."""
