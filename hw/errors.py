"""Errors of devices.

HardwareError
├── MotionRefused        before a motion: nothing has moved
├── ArmFault             during a motion: the arm has stopped
│   └── StoppedByPedal   because the operator released the enabling pedal
├── Rehearsed            a motion came to its end at a slower pace, and counts for nothing
├── HandError            the hand did not carry out its command
│   └── FingersMoved     it accepted a stop, and its fingers went on or cannot be watched
├── CameraError          no frame, or not in time
├── BalanceError         the balance gives no stable mass
└── DeviceUnavailable    a device is not there or not answering
"""


class HardwareError(Exception):
    """Base of everything that devices raise."""


class MotionRefused(HardwareError):
    """A path breaks a limit; nothing has moved. The message names joint, time, value and limit."""


class ArmFault(HardwareError):
    """The arm stopped during a motion; it is at rest and needs an explicit recovery."""


class StoppedByPedal(ArmFault):
    """The operator released the enabling pedal; the arm has braked along its path."""


class Rehearsed(HardwareError):
    """A motion was played at a slower pace to its end; it counts for nothing."""


class HandError(HardwareError):
    """The hand could not do its task, because it was not homed, held nothing, or lost the tool."""


class FingersMoved(HandError):
    """The hand accepted a stop, but its fingers moved on or may have; no motion is allowed without a recovery."""


class CameraError(HardwareError):
    """The camera gave no frame, or not in time."""


class BalanceError(HardwareError):
    """The balance gave no stable mass: an unexpected answer, or it was unplugged."""


class DeviceUnavailable(HardwareError):
    """A device cannot be reached."""
