"""What the rest of the program asks of devices; real and simulated ones are siblings behind these.

Devices are context managers: constructing one touches nothing, entering connects.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, Self

from hw.types import ArmState, Array, CameraModel, Execution, Frame, JointPath


class Arm(Protocol):
    """A seven-joint arm that plays one checked path at a time."""

    @property
    def model(self) -> str:
        """The row of `hw.limits.LIMITS` that applies: "panda" or "fr3"."""
        ...

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...

    def state(self) -> ArmState:
        """The present state. Raises DeviceUnavailable."""
        ...

    def execute(self, path: JointPath) -> Execution:
        """Play `path` and return at rest. Raises MotionRefused (nothing moved) or ArmFault (stopped)."""
        ...

    def recover(self) -> None:
        """Clear a fault. Never resumes a motion."""
        ...


class Camera(Protocol):
    """A fixed RGB-D camera at 30 FPS."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...

    def model(self) -> CameraModel: ...

    def snapshot(self) -> Frame:
        """One frame, now. Raises CameraError."""
        ...

    def start_recording(self) -> None: ...

    def stop_recording(self) -> Sequence[Frame]:
        """All frames since `start_recording`, in order of time. Raises CameraError."""
        ...


class Bench(Protocol):
    """Whoever puts the object on the table: a person, or the simulated lab."""

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """Ask for the object at `xy_m` (2,) in the base frame, for `trial` (numbered from 1 in a session).

        `attempt` counts the operator's redos of that trial, from 0. The object ends up near there;
        the camera says where. A simulated bench derives all its randomness from (seed, trial, attempt).
        """
        ...
