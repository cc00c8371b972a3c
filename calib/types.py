"""Inputs and results of calibration, and the base of its files.

Frames besides those of `hw.types`: M is the board, A the carrier of the camera, H the holder of the board:

========  ============  ============  ==============
mounting  A             H             X_AH
========  ============  ============  ==============
fixed     B (base)      F (flange)    X_BF
wrist     F (flange)    B (base)      inverse of X_BF
========  ============  ============  ==============

So X_CM = inverse(X_AC) X_AH X_HM in both, and one solver serves both.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from hw.records import Record, content_of
from hw.types import Array, Intrinsics, frozen_array
from perception.board.types import CalibrationTarget, Corners

FORMAT = 1


def _plain(values: Any) -> Any:
    return values.tolist() if isinstance(values, np.ndarray) else values


def _told(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Numbers = Annotated[tuple[float, ...], BeforeValidator(_plain)]
Matrix = Annotated[tuple[Numbers, ...], BeforeValidator(_plain)]
Measured = Annotated[float | None, BeforeValidator(_told)]
"""JSON has no NaN, so a missing measurement is null."""


class StoredRecord(Record):
    """A record that is the whole of a file."""

    def content(self) -> bytes:
        """The bytes of its file, as JSON."""
        return (json.dumps(content_of(self), indent=1, allow_nan=False) + "\n").encode()

    def sha256(self) -> str:
        """SHA-256 of `content`, which a session records."""
        return hashlib.sha256(self.content()).hexdigest()


Forward = Callable[[Array], Array]
"""Forward kinematics: joints (..., n) in rad -> X_BF (..., 4, 4). `hw.kinematics.forward` is one."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """The pose of the fixed colour camera in the robot's base frame, with its uncertainty."""

    X_BC: Array  # (4, 4)
    sigma_mm: float  # one standard deviation of the position
    sigma_deg: float  # one standard deviation of the rotation
    source: str  # its origin, in words
    created: str  # ISO 8601 date, "" if unknown
    camera_late_s: float = 0.0  # camera stamps minus arm stamps of the same moment; 0 if not measured

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_BC", frozen_array(self.X_BC, (4, 4), "X_BC"))


class Mounting(StrEnum):
    """Whether the camera or the board moves with the arm."""

    FIXED = "fixed"  # camera fixed in the base, board on the flange
    WRIST = "wrist"  # camera on the flange, board fixed in the base


@dataclass(frozen=True, eq=False)
class Setup:
    """Everything that is the same in all views."""

    mounting: Mounting
    board: CalibrationTarget
    colour: Intrinsics
    infrared: Intrinsics | None = None  # of the depth camera's infrared image, if the views have it
    X_CD: Array | None = None  # (4, 4) factory pose of the depth camera in the colour camera
    work_points_m: Array | None = (
        None  # (P, 3) in A, for evaluating the stated error; None: the corners of `WORK_BOX_M`
    )
    size_known: bool = True  # False: only its proportions are known, and the arm's motion gives the size
    lens_covariance: Array | None = None  # (6, 6) of X_AC's twist in C's axes, if intrinsics were estimated from views

    def __post_init__(self) -> None:
        if self.X_CD is not None:
            object.__setattr__(self, "X_CD", frozen_array(self.X_CD, (4, 4), "X_CD"))
        points = corners_of_box(WORK_BOX_M[self.mounting]) if self.work_points_m is None else self.work_points_m
        object.__setattr__(self, "work_points_m", frozen_array(points, (None, 3), "work_points_m"))

    @property
    def p_AP_m(self) -> Array:
        """(P, 3) `work_points_m`, never None."""
        assert self.work_points_m is not None
        return self.work_points_m


WORK_BOX_M = {
    Mounting.FIXED: ((0.45, 1.0), (-0.25, 0.25), (0.0, 0.25)),
    Mounting.WRIST: ((-0.2, 0.2), (-0.2, 0.2), (0.3, 0.8)),
}
"""x, y and z of the work volume in A, from and to: in front of our arm (fixed), or in view of a wrist camera."""


def corners_of_box(box_m: Sequence[Sequence[float]]) -> Array:
    """(8, 3) corners of a box: three rows, from and to."""
    return np.array(list(product(*box_m)))


@dataclass(frozen=True, eq=False)
class View:
    """One view of the board with the arm at rest: image and joints of the same moment.

    Give `q_rad`, or `X_BF` if only poses are known (then joint offsets cannot be estimated). If both are given, the
    joints count. Either all views of a calibration give joints, or all give poses.
    """

    name: str  # unique; views are sorted by name, so that their order does not matter
    corners: Corners  # in the colour image
    q_rad: Array | None = None  # (n,) as the arm reports them
    X_BF: Array | None = None  # (4, 4)
    infrared: Corners | None = None  # the same board in the infrared image
    t_camera_s: float | None = None  # middle of the exposure, on the arm's clock if known
    t_arm_s: float | None = None  # when the joints were read

    def __post_init__(self) -> None:
        if self.q_rad is None and self.X_BF is None:
            raise ValueError(f"view {self.name}: neither joints nor a flange pose")
        if self.q_rad is not None:
            object.__setattr__(self, "q_rad", frozen_array(self.q_rad, (None,), "q_rad"))
        if self.X_BF is not None:
            object.__setattr__(self, "X_BF", frozen_array(self.X_BF, (4, 4), "X_BF"))


class ViewFit(Record):
    """The result of one view, also as it is stored; values that were not measured are None."""

    name: str
    used: bool
    reason: str  # why it was not used, with value and limit; "" if used
    rms_px: Measured = None  # distance between seen and predicted corners in the final fit, root mean square
    own_rms_px: Measured = None  # the same with the pose fitted to this view alone: quality of its corners
    off_mm: Measured = None  # distance of the board's centre from the final fit's prediction
    off_deg: Measured = None
    held_out: bool = False  # one of the held-out fifth, predicted by a fit without them
    held_out_px: Measured = None  # error of that prediction
    mirrored: bool = False  # the mirror pose fits the picture better, but contradicts the arm's motion
    sha256: str = ""  # of the stored view's record, which holds the hashes of its images


@dataclass(frozen=True, eq=False)
class JointOffsets:
    """Constant errors of the joint zeros (true joint = reported + offset), and the evidence for them.

    Offsets of the first and last joint look the same as rotations of camera and board, so they stay 0.
    """

    offsets_rad: Array  # (n,) zeros if not adopted
    sigma_rad: Array  # (n,) one standard deviation, jackknife; nan if not observable
    adopted: bool  # the data support them: the solution uses them
    suspected_rad: Array  # (n,) the estimate, adopted or not
    delta_bic: float  # Bayesian information criterion with offsets minus without; under -10 is strong support
    reason: str  # in words

    def __post_init__(self) -> None:
        n = len(self.offsets_rad)
        for name in ("offsets_rad", "suspected_rad"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (n,), name))


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The possible error of the solution: jackknife over views and the fit's covariance, with measured factors and a
    floor.

    The `*_95` values are 95 % bounds. Those in the arm's own frame matter if the same arm acts on
    the camera's detections. The absolute ones add a rotation of the base about joint 1's axis, which no view can show
    (it is the offset of joint 1). It is assumed as large as the estimated offsets of the other joints.
    """

    sigma_mm: float  # one standard deviation of the camera's position, absolute
    sigma_deg: float  # one standard deviation of its rotation, absolute
    position_95_mm: float  # camera position, absolute
    rotation_95_deg: float
    work_95_mm: Array  # (P,) at each point of `Setup.p_AP_m`, absolute
    worst_95_mm: float  # at the worst point: the one number to quote
    arm_work_95_mm: Array  # (P,) the same two in the arm's own frame
    arm_worst_95_mm: float
    base_turn_deg: float  # one standard deviation of the unobservable rotation; 0 if joints are unknown
    covariance: Array  # (6, 6) of X_AC in the arm's own frame: rotation rad, position m, in axes of A about C's origin


class ClosedForm(Record):
    """The distance of a closed form from the solution, for comparison."""

    name: str
    from_solution_mm: float
    from_solution_deg: float


@dataclass(frozen=True, eq=False)
class Noise:
    """The noise of the instruments, from the residuals."""

    corner_px: float  # one standard deviation of a corner along one axis
    view_px: float  # of the smooth error common to a view's corners, along one axis
    joint_rad: float  # one standard deviation of a joint from view to view; nan if joints are unknown
    flange_mm: float  # effect of that (or of errors of the given poses) at the board


class Weights(StrEnum):
    """The errors by which the views of a fit are weighed."""

    ARM_AND_VIEWS = "errors of arm and views"
    PIXELS = "pixels alone"


@dataclass(frozen=True)
class Choice:
    """The choice between two fits, by the error with which each predicts views that it has not seen."""

    weights: tuple[Weights, ...]  # one of the two, or both: their mean
    errors_px: float  # held-out error of the fit weighed by errors of arm and views, every view without its fifth
    pixels_px: float  # the same of the fit over pixels
    held_out_px: float  # the same with the present calibration

    @property
    def sentence(self) -> str:
        """The choice in words."""
        errors_px = {Weights.ARM_AND_VIEWS: self.errors_px, Weights.PIXELS: self.pixels_px}
        labels = {by: f"{by} ({px:.2f} px held out)" for by, px in errors_px.items()}
        if len(self.weights) > 1:
            return f"the mean of two fits ({self.held_out_px:.2f} px held out): by {' and by '.join(labels.values())}"
        (only,) = self.weights
        (other,) = set(labels) - set(self.weights)
        return f"views are weighed by {labels[only]}, not by {labels[other]}"


@dataclass(frozen=True)
class ViewInfluence:
    """The value of the used views. Shares refer to the error at the worst corner of the work volume."""

    without: tuple[tuple[str, float], ...]  # (view, growth of the error without it), the largest first
    more: tuple[str, ...]  # three views; more like these lower the error most
    left: float  # remaining share of the error with those
    to_halve: int | None  # number of such views that halve it; None: more than a dozen

    @property
    def idle(self) -> tuple[str, ...]:
        """Views without which the error grows by less than a hundredth."""
        return tuple(sorted(name for name, share in self.without if share < 0.01))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The value of the views in words."""
        most = ", ".join(f"{name} (+{100 * share:.0f} %)" for name, share in self.without[:3])
        lines = [f"The views that help most: {most} error without them"]
        if self.idle:
            lines.append(f"Views that hardly matter: {', '.join(self.idle)}")
        halve = "" if self.to_halve is None else f"; {self.to_halve} such views would halve it"
        lines.append(
            f"Three more views like {', '.join(self.more)} would lower the error that views can lower by "
            f"{100 * (1 - self.left):.0f} %{halve}"
        )
        return tuple(lines)


@dataclass(frozen=True, eq=False)
class Solution:
    """A calibration. Bit-identical for every order of the views."""

    mounting: Mounting
    X_AC: Array  # (4, 4) camera in its carrier: X_BC if fixed, X_FC on the wrist
    X_HM: Array  # (4, 4) board in its holder: X_FM if the camera is fixed, X_BM on the wrist
    joints: JointOffsets | None  # None if joints are unknown
    views: tuple[ViewFit, ...]  # in order of their names
    fit_px: float  # root mean square distance of corners, views used
    held_out_px: float  # the same for every fifth view, predicted by a fit without those
    noise: Noise
    choice: Choice  # which fit was kept
    uncertainty: Uncertainty
    methods: tuple[ClosedForm, ...]
    square_scale: float  # board size by the arm's motion, over the stated size
    square_scale_sigma: float
    target: str  # the target in words, with its size
    size_known: bool  # False: the target's size comes from the arm's motion, and the stated error includes that
    tilt_spread_deg: float  # rms of the board's rotations about the axis of second most variety; one axis is too few
    distance_m: float  # of the board's centre from the camera, median over the views
    influence: ViewInfluence  # value of each view, and of further ones

    def __post_init__(self) -> None:
        for name in ("X_AC", "X_HM"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (4, 4), name))

    def offsets_rad(self, joints: int) -> Array:
        """(joints,) the offsets in use; zeros if joints are unknown."""
        return np.zeros(joints) if self.joints is None else self.joints.offsets_rad

    @property
    def used(self) -> tuple[str, ...]:
        """Names of the views used by the fit."""
        return tuple(view.name for view in self.views if view.used)

    @property
    def rejected(self) -> tuple[ViewFit, ...]:
        """The views that it does not use."""
        return tuple(view for view in self.views if not view.used)


class Grade(StrEnum):
    """The verdict of a check on a calibration."""

    GOOD = "good"
    SUSPECT = "suspect"  # reported, does not forbid
    BAD = "bad"  # forbids
    NOT_MEASURED = "not measured"


TIME_OFFSET = "time offset"
"""The name of the check that measures the delay of the camera's stamps."""


class Check(Record):
    """One check or gate, also as stored: measured value, limit and advice."""

    name: str
    verdict: Grade
    message: str  # quantity, value, limit, next step
    value: Measured = None
    limit: Measured = None
    unit: str = ""

    @classmethod
    def graded(
        cls, name: str, message: str, measured: tuple[float, float, str], advice: str, *, good: bool, worse: Grade
    ) -> Check:
        """A good check, or a `worse` one with the `advice` after the message. `measured` has value, limit and unit."""
        value, limit, unit = measured
        verdict, text = (Grade.GOOD, message) if good else (worse, message + advice)
        return cls(name=name, verdict=verdict, message=text, value=value, limit=limit, unit=unit)

    @classmethod
    def unmeasured(cls, name: str, why: str) -> Check:
        """A check without a measurement."""
        return cls(name=name, verdict=Grade.NOT_MEASURED, message=why)


def reasons(gates: Sequence[Check]) -> tuple[str, ...]:
    """The reasons for which the gates reject a calibration, in words; empty if they accept it."""
    return tuple(gate.message for gate in gates if gate.verdict is Grade.BAD)


@dataclass(frozen=True, eq=False)
class Drift:
    """`calibrate check`: has the camera moved since?"""

    moved: bool
    rms_px: float  # distance between seen and predicted corners, all views
    limit_px: float
    moved_mm: float  # estimated shift of the camera
    moved_deg: float
    sigma_mm: float  # one standard deviation of these
    sigma_deg: float
    X_BC_now: Array  # (4, 4) estimated present pose of the camera in its carrier
    message: str
