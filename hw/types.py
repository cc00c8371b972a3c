"""Values that cross the boundary to the devices: frames, paths, states.

Frames of reference: B is the robot base (X forward, Z up, table top at z = 0), C the
colour camera, D the depth camera, F the flange, T the tool. `X_AB` is the 4 x 4 pose of
frame B in frame A; `p_AB_m` is a position in metres.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hw.quantities import QUANTITIES

Array = NDArray[np.float64]

PATH_RATE_HZ = 1000.0
"""Sampling rate of every `JointPath`: the rate at which the Franka interfaces accept set points."""


REACH_M = 10.0
"""No place in a lab is farther from the arm's base."""
LARGEST_N = 1000.0
LONGEST_S = 3600.0
WIDEST_M = 0.1
"""No hand of these arms opens wider."""


def number(value: float, name: str, low: float, high: float, unit: str = "", *, above: bool = False) -> float:
    """`value`, which has to be finite, at least `low` (or more than `above`), and at most `high`. Raises ValueError.

    Every number that decides about a motion, or that a device reports, passes through here when its value is made.
    """
    inside = isinstance(value, Real) and math.isfinite(value) and low <= value <= high and not (above and value == low)
    if not inside:
        allowed = f"above {low:g} and at most {high:g}" if above else f"{low:g} to {high:g}"
        shown = f"{value:g}" if isinstance(value, Real) else repr(value)
        raise ValueError(f"{name} is {shown} {unit}".rstrip() + f": it must be {allowed}")
    return float(value)


def frozen_array(
    value: ArrayLike, shape: tuple[int | None, ...] | None = None, name: str = "array", *, most: float = math.inf
) -> Array:
    """A read-only float64 copy of `value`; None in `shape` allows any size.

    Raises ValueError if the shape differs, or a value is not finite or its size is above `most`.
    """
    array = np.array(value, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has values that are not finite")
    if array.size and np.abs(array).max() > most:
        largest = array.flat[int(np.abs(array).argmax())]
        raise ValueError(f"{name} has the value {largest:g}: its size is above {most:g}")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """A pinhole camera with OpenCV's rational distortion (pixel centres at integers)."""

    width: int
    height: int
    K: Array  # (3, 3)
    distortion: Array = field(default_factory=lambda: np.zeros(8))  # (8,) k1 k2 p1 p2 k3 k4 k5 k6

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", frozen_array(self.K, (3, 3), "K"))
        if self.K[0, 1] or self.K[1, 0]:
            raise ValueError(f"K has the skew {self.K[0, 1] or self.K[1, 0]:g}: lenses are calibrated without one")
        object.__setattr__(self, "distortion", frozen_array(self.distortion, (8,), "distortion"))


@dataclass(frozen=True, eq=False)
class CameraModel:
    """Factory calibration of an RGB-D camera."""

    serial: str
    colour: Intrinsics
    depth: Intrinsics
    X_CD: Array  # (4, 4) depth camera in the colour camera

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_CD", frozen_array(self.X_CD, (4, 4), "X_CD"))


@dataclass(frozen=True, eq=False)
class Frame:
    """One synchronised colour and depth image, each in its own camera's geometry."""

    t_s: float  # middle of the exposure, on the arm's clock
    colour: NDArray[np.uint8]  # (Hc, Wc, 3) RGB
    depth_mm: NDArray[np.uint16]  # (Hd, Wd) distance along the depth camera's optical axis; 0 = no reading
    infrared: NDArray[np.uint16] | None = None  # (Hd, Wd) image of the depth camera; None: not requested


@dataclass(frozen=True, eq=False)
class ContactWindow:
    """The only part of a path in which the tool may be commanded to touch the table."""

    start_s: float
    end_s: float
    depth_m: float  # deepest commanded position below the table top, 0 or more
    force_N: float  # largest predicted normal force, 0 or more

    def __post_init__(self) -> None:
        number(self.start_s, "start of the contact window", 0.0, LONGEST_S, "s")
        number(self.end_s, "end of the contact window", self.start_s, LONGEST_S, "s")
        number(self.depth_m, "depth of the contact window", 0.0, REACH_M, "m")
        number(self.force_N, "force of the contact window", 0.0, LARGEST_N, "N")


@dataclass(frozen=True, eq=False)
class JointPath:
    """A motion the arm may be asked to make, sampled at 1 kHz, at rest at both ends."""

    t_s: Array  # (N,) from 0, every 1 ms
    q_rad: Array  # (N, 7)
    contact: ContactWindow | None = None

    def __post_init__(self) -> None:
        t_s = frozen_array(self.t_s, (None,), "t_s")
        q_rad = frozen_array(self.q_rad, (len(t_s), 7), "q_rad", most=2.0 * math.pi)
        if len(t_s) < 2 or abs(t_s[0]) > 1e-12 or not np.allclose(np.diff(t_s), 1.0 / PATH_RATE_HZ, atol=1e-9):
            raise ValueError("a joint path must start at t = 0 and have a sample every millisecond")
        object.__setattr__(self, "t_s", t_s)
        object.__setattr__(self, "q_rad", q_rad)

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.t_s[-1])

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that an arm plays of it: times, joints and contact."""
        content = hashlib.sha256(repr(self.contact).encode())
        for values in (self.t_s, self.q_rad):
            content.update(np.ascontiguousarray(values).tobytes())
        return content.hexdigest()


@dataclass(frozen=True, eq=False)
class ArmState:
    """The state that the arm reports."""

    t_s: float
    q_rad: Array  # (7,)
    dq_rad_s: Array  # (7,)
    fault: str | None = None
    by_hand: bool = False  # a person causes the fault now; it ends by itself, without recovery

    def __post_init__(self) -> None:
        object.__setattr__(self, "q_rad", frozen_array(self.q_rad, (7,), "q_rad"))
        object.__setattr__(self, "dq_rad_s", frozen_array(self.dq_rad_s, (7,), "dq_rad_s"))


@dataclass(frozen=True, eq=False)
class Execution:
    """The execution of a path: commanded and measured joints on one clock."""

    t_start_s: float  # arm clock at the path's t = 0
    t_s: Array  # (M,) since t_start_s
    q_commanded_rad: Array  # (M, 7)
    q_measured_rad: Array  # (M, 7)
    control_success_rate: float  # share of 1 kHz cycles answered in time, 0 to 1
    measured: Mapping[str, Array] = field(default_factory=dict)
    """(M, K) by the names of `hw.quantities.QUANTITIES`: those that the arm reported, and no others."""

    def __post_init__(self) -> None:
        t_s = frozen_array(self.t_s, (None,), "t_s")
        object.__setattr__(self, "t_s", t_s)
        sizes = {quantity.name: quantity.size for quantity in QUANTITIES}
        values = {name: frozen_array(log, (len(t_s), sizes[name]), name) for name, log in self.measured.items()}
        object.__setattr__(self, "measured", values)
        for name in ("q_commanded_rad", "q_measured_rad"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (len(t_s), 7), name))
        number(self.control_success_rate, "control success rate", 0.0, 1.0)

    def q_at(self, t_s: float) -> Array:
        """Arm clock -> measured joints (7,), held beyond the ends."""
        since_s = t_s - self.t_start_s
        return np.array([np.interp(since_s, self.t_s, joint) for joint in self.q_measured_rad.T])


@dataclass(frozen=True)
class HandState:
    """The state that the hand reports."""

    width_m: float  # between the fingers
    holds: bool  # something was grasped, and is still there
    homed: bool  # since it was switched on

    def __post_init__(self) -> None:
        number(self.width_m, "width between the fingers", 0.0, WIDEST_M, "m")


@dataclass(frozen=True, eq=False)
class Placing:
    """The wanted place of the object, for an attempt of a trial. Raises ValueError."""

    xy_m: Array  # (2,) in the base frame
    trial: int  # from 1
    attempt: int  # from 0: how often the operator has redone the trial

    def __post_init__(self) -> None:
        object.__setattr__(self, "xy_m", frozen_array(self.xy_m, (2,), "xy_m"))
        if self.trial < 1 or self.attempt < 0:
            raise ValueError(f"trial {self.trial}, attempt {self.attempt}: trials are numbered from 1, attempts from 0")
