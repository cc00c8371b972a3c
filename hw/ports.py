"""The interfaces of all devices; real and simulated devices implement the same ones.

Devices are context managers: constructing one touches nothing, entering connects.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from hw.types import ArmState, Array, CameraModel, Execution, Frame, HandState, JointPath


class Arm(Protocol):
    """A seven-joint arm that plays one checked path at a time."""

    @property
    def model(self) -> str:
        """The row of `hw.joint_limits.LIMITS` that applies: "panda", "fr3" or "fr3v2"."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...

    def state(self) -> ArmState:
        """The present state. Raises DeviceUnavailable."""

    def execute(self, path: JointPath) -> Execution:
        """Play `path` and return at rest. Raises MotionRefused (nothing moved) or ArmFault (stopped)."""

    def recover(self) -> None:
        """Clear a fault. Never resumes a motion."""


class Hand(Protocol):
    """A parallel gripper with two fingers."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...

    def state(self) -> HandState:
        """The present state. Raises DeviceUnavailable."""

    def home(self) -> None:
        """Find the fingers' ends of travel; the hand must be empty. Raises HandError."""

    def move(self, width_m: float) -> None:
        """Move the fingers slowly, with almost no force, to `width_m`. Raises HandError."""

    def grasp(self, width_m: float, force_N: float) -> None:
        """Close on an object about `width_m` wide and hold it with `force_N`.

        Raises HandError if nothing of that width is between the fingers.
        """


class Camera(Protocol):
    """A fixed RGB-D camera at 30 FPS. Leaving it ends a recording. Before entering, images raise DeviceUnavailable."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...

    def model(self) -> CameraModel:
        """The factory calibration, known once the camera was entered."""

    def snapshot(self) -> Frame:
        """One frame, now. Raises CameraError."""

    def start_recording(self) -> None:
        """Keep every frame from now on. Raises CameraError if a recording runs."""

    def stop_recording(self) -> Sequence[Frame]:
        """All frames since `start_recording`, in time order.

        Raises CameraError if no recording runs, or too many images were lost; the recording is over either way.
        """

    def newest(self) -> NDArray[np.uint8] | None:
        """(H, W, 3) RGB, the newest picture, without waiting for another; also while a recording runs.

        None if there is none, or the camera is busy. Any thread may call it; it never raises.
        """


class ObjectPlacer(Protocol):
    """Whoever puts the object on the table: a person, or the simulated lab."""

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """Ask for the object at `xy_m` (2,) in the base frame, for `trial` (numbered from 1 in a session).

        `attempt` counts the operator's redos of that trial, from 0. The object ends up nearby; the camera measures
        where. A simulated bench derives all its randomness from (seed, trial, attempt). Raises ValueError for a trial
        under 1, an attempt under 0, or a place that is not two finite numbers.
        """


class Pedal(Protocol):
    """The enabling pedal: the arm moves while it is held. Before entering it enables nothing."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...

    def enabled(self) -> bool:
        """Whether the arm may move now."""

    def why_not(self) -> str:
        """Why the arm may not move, in words for a person."""


class Balance(Protocol):
    """A balance for the object. Entering raises DeviceUnavailable if nothing answers."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *exc: object) -> None: ...

    def mass_kg(self) -> float:
        """The mass on the pan, at rest. Raises BalanceError."""


Inner = TypeVar("Inner", bound=Arm)


class ArmWrapper(ABC, Generic[Inner]):
    """`hw.ports.Arm`: the inner arm connects, reports and recovers; the subclass decides how it moves."""

    def __init__(self, arm: Inner) -> None:
        self._arm = arm

    @property
    def model(self) -> str:
        """See `hw.ports.Arm`."""
        return self._arm.model

    def __enter__(self) -> Self:
        self._arm.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self._arm.__exit__(*exc)

    def state(self) -> ArmState:
        """See `hw.ports.Arm`."""
        return self._arm.state()

    def recover(self) -> None:
        """See `hw.ports.Arm`."""
        self._arm.recover()

    @abstractmethod
    def execute(self, path: JointPath) -> Execution:
        """See `hw.ports.Arm`."""
