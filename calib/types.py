"""What calibration takes and gives.

Frames beside those of `hw.types`: M is the board. What carries the camera is called A, what holds the board H:

========  ============  ============  ==============
mounting  A             H             X_AH
========  ============  ============  ==============
fixed     B (base)      F (flange)    X_BF
wrist     F (flange)    B (base)      inverse of X_BF
========  ============  ============  ==============

So X_CM = inverse(X_AC) X_AH X_HM in both, and one solver serves both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from itertools import product

import numpy as np

from hw.types import Array, Intrinsics, frozen_array
from perception.board.types import Corners, Target

Forward = Callable[[Array], Array]
"""Forward kinematics: joints (..., n) in rad -> X_BF (..., 4, 4). `hw.kinematics.forward` is one."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """Where the fixed colour camera stands in the robot base frame, and how well that is known."""

    X_BC: Array  # (4, 4)
    sigma_mm: float  # one standard deviation of the position
    sigma_deg: float  # one standard deviation of the rotation
    source: str  # where it comes from, in words
    created: str  # ISO 8601 date, "" where not known
    camera_late_s: float = 0.0  # camera stamps less arm stamps of the same moment; 0 where it was not measured

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_BC", frozen_array(self.X_BC, (4, 4), "X_BC"))


class Mounting(StrEnum):
    """Which of camera and board moves with the arm."""

    FIXED = "fixed"  # camera fixed in the base, board on the flange
    WRIST = "wrist"  # camera on the flange, board fixed in the base


@dataclass(frozen=True, eq=False)
class Setup:
    """What stays the same in all views."""

    mounting: Mounting
    board: Target
    colour: Intrinsics
    infrared: Intrinsics | None = None  # the depth camera's infrared image, where the views have it
    X_CD: Array | None = None  # (4, 4) factory pose of the depth camera in the colour camera
    work_points_m: Array | None = None  # (P, 3) in A, where the stated error is evaluated; None: `default_work_points`
    size_known: bool = True  # False: only the target's proportions are, and the arm's motion gives its size
    lens_covariance: Array | None = None  # (6, 6) of X_AC's twist in C's axes, where intrinsics were found from views

    def __post_init__(self) -> None:
        if self.X_CD is not None:
            object.__setattr__(self, "X_CD", frozen_array(self.X_CD, (4, 4), "X_CD"))
        points = default_work_points(self.mounting) if self.work_points_m is None else self.work_points_m
        object.__setattr__(self, "work_points_m", frozen_array(points, (None, 3), "work_points_m"))

    @property
    def p_AP_m(self) -> Array:
        """(P, 3) `work_points_m`, never None."""
        assert self.work_points_m is not None
        return self.work_points_m


def default_work_points(mounting: Mounting) -> Array:
    """(8, 3) corners of the work volume in A: in front of the arm (fixed), or what a wrist camera looks at."""
    box = (
        ((0.45, 1.0), (-0.25, 0.25), (0.0, 0.25)) if mounting is Mounting.FIXED else ((-0.2, 0.2),) * 2 + ((0.3, 0.8),)
    )
    return np.array(list(product(*box)))


@dataclass(frozen=True, eq=False)
class View:
    """One look at the board with the arm at rest: image and joints of the same moment.

    Give `q_rad`, or `X_BF` where only poses are known (then joint offsets cannot be estimated); if both are given the
    joints count. All views of one calibration have the same of the two.
    """

    name: str  # unique; views are sorted by it, so that their order does not matter
    corners: Corners  # in the colour image
    q_rad: Array | None = None  # (n,) as the arm reports them
    X_BF: Array | None = None  # (4, 4)
    infrared: Corners | None = None  # the same board in the infrared image
    t_camera_s: float | None = None  # middle of the exposure, on the arm's clock as far as known
    t_arm_s: float | None = None  # when the joints were read

    def __post_init__(self) -> None:
        if self.q_rad is None and self.X_BF is None:
            raise ValueError(f"view {self.name}: neither joints nor a flange pose")
        if self.q_rad is not None:
            object.__setattr__(self, "q_rad", frozen_array(self.q_rad, (None,), "q_rad"))
        if self.X_BF is not None:
            object.__setattr__(self, "X_BF", frozen_array(self.X_BF, (4, 4), "X_BF"))


@dataclass(frozen=True)
class ViewFit:
    """What became of one view."""

    name: str
    used: bool
    reason: str  # why it was not used, with value and limit; "" if used
    rms_px: float  # distance between seen and predicted corners in the final fit, root mean square
    own_rms_px: float  # the same with the board's pose fitted to this view alone: how sharp its corners are
    off_mm: float  # how far the board's centre lies from where the final fit puts it
    off_deg: float
    held_out: bool  # one of every fifth, predicted by a fit without them
    held_out_px: float  # its error in that prediction, nan where not held out or not used
    mirrored: bool  # the other pose of a flat board fits the picture better; the arm's motion says this one


@dataclass(frozen=True, eq=False)
class JointOffsets:
    """Constant errors of the joint zeros, true joint = reported + offset, and what speaks for them.

    The first and last joint cannot be told from the camera's and the board's own turn; theirs stay 0.
    """

    offsets_rad: Array  # (n,) zeros where not adopted
    sigma_rad: Array  # (n,) one standard deviation, jackknife; nan where not observable
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
    """How wrong the solution may be: jackknife over views and the fit's covariance, by measured factors, with a floor.

    `*_95` are meant to be exceeded in one calibration of twenty. Those of the arm's own frame are what counts when
    the same arm acts on what the camera sees. The absolute ones add the turn of the base about joint 1's axis that no
    view can show (it is the offset of joint 1), taken to be as large as the other joints' offsets turned out to be.
    """

    sigma_mm: float  # one standard deviation of the camera's position, absolute
    sigma_deg: float  # one standard deviation of its rotation, absolute
    position_95_mm: float  # camera position, absolute
    rotation_95_deg: float
    work_95_mm: Array  # (P,) at each of `Setup.p_AP_m`, absolute
    worst_95_mm: float  # at the worst of them: the one number to quote
    arm_position_95_mm: float  # the same four in the arm's own frame
    arm_rotation_95_deg: float
    arm_work_95_mm: Array  # (P,)
    arm_worst_95_mm: float
    base_turn_deg: float  # one standard deviation of the turn that no view can show; 0 where joints are not known
    covariance: Array  # (6, 6) of X_AC in the arm's own frame: rotation rad, position m, in axes of A about C's origin


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """A closed form, for comparison."""

    name: str
    X_AC: Array  # (4, 4)
    from_solution_mm: float
    from_solution_deg: float


@dataclass(frozen=True, eq=False)
class Noise:
    """What the residuals say about the instruments."""

    corner_px: float  # one standard deviation of a corner along one axis
    joint_rad: float  # one standard deviation of a joint from view to view; nan where joints are not known
    flange_mm: float  # what that (or an error of the poses given) means at the board


@dataclass(frozen=True)
class Worth:
    """Of the views that were used. A share is of the error at the worst corner of the work volume."""

    without: tuple[tuple[str, float], ...]  # by how much the error grows without a view, the largest first
    more: tuple[str, ...]  # three more views like these lower the error most
    left: float  # share of the error that is then left
    to_halve: int | None  # how many such views halve it; None: more than a dozen

    @property
    def idle(self) -> tuple[str, ...]:
        """Without any one of these the error grows by less than a hundredth."""
        return tuple(sorted(name for name, share in self.without if share < 0.01))

    @property
    def sentences(self) -> tuple[str, ...]:
        """In words."""
        most = ", ".join(f"{name} (+{100 * share:.0f} %)" for name, share in self.without[:3])
        said = [f"The views that help most: {most} error without them"]
        if self.idle:
            said.append(f"Views that hardly matter: {', '.join(self.idle)}")
        halve = "" if self.to_halve is None else f"; {self.to_halve} such views would halve it"
        said.append(
            f"Three more views like {', '.join(self.more)} would lower the error that views can lower by "
            f"{100 * (1 - self.left):.0f} %{halve}"
        )
        return tuple(said)


@dataclass(frozen=True, eq=False)
class Solution:
    """A calibration. Independent of the order of the views, bit by bit."""

    mounting: Mounting
    X_AC: Array  # (4, 4) camera in its carrier: X_BC if fixed, X_FC on the wrist
    X_HM: Array  # (4, 4) board in its holder: X_FM if the camera is fixed, X_BM on the wrist
    joints: JointOffsets | None  # None where joints are not known
    views: tuple[ViewFit, ...]  # in order of their names
    fit_px: float  # root mean square distance of corners, views used
    held_out_px: float  # the same for every fifth view, predicted by a fit without those
    noise: Noise
    uncertainty: Uncertainty
    methods: tuple[ClosedForm, ...]
    square_scale: float  # board size that the arm's motion asks for, over the size given
    square_scale_sigma: float
    target: str  # what was seen, in words, with its size
    size_known: bool  # False: the target's size comes from the arm's motion, and the stated error counts that
    tilt_spread_deg: float  # rms of the board's rotations about the axis of second most variety; one axis is too few
    pose_span_m: float  # diagonal of the box of board centres in the camera
    worth: Worth  # of each view, and of more like them

    def __post_init__(self) -> None:
        for name in ("X_AC", "X_HM"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (4, 4), name))

    @property
    def used(self) -> tuple[str, ...]:
        """Names of the views that the fit rests on."""
        return tuple(view.name for view in self.views if view.used)

    @property
    def rejected(self) -> tuple[ViewFit, ...]:
        """The views that it does not rest on."""
        return tuple(view for view in self.views if not view.used)

    def hand_eye(self, source: str, created: str) -> HandEye:
        """The part that perception needs. Raises ValueError for a camera on the wrist."""
        if self.mounting is not Mounting.FIXED:
            raise ValueError("a camera on the wrist has no constant pose in the base")
        return HandEye(self.X_AC, self.uncertainty.sigma_mm, self.uncertainty.sigma_deg, source, created)


class Grade(StrEnum):
    """What a check says about a calibration."""

    GOOD = "good"
    SUSPECT = "suspect"  # said aloud, does not forbid
    BAD = "bad"  # forbids
    NOT_MEASURED = "not measured"


@dataclass(frozen=True)
class Check:
    """One check or gate: what was measured, against what, and what to do about it."""

    name: str
    verdict: Grade
    message: str  # what, the value, the limit, what to do next
    value: float = float("nan")
    limit: float = float("nan")
    unit: str = ""


@dataclass(frozen=True)
class Acceptance:
    """The gates. Accepted if none is bad."""

    gates: tuple[Check, ...]

    @property
    def accepted(self) -> bool:
        """Whether no gate forbids it."""
        return all(gate.verdict is not Grade.BAD for gate in self.gates)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why not, in words; empty if accepted."""
        return tuple(gate.message for gate in self.gates if gate.verdict is Grade.BAD)


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
    X_AC: Array  # (4, 4) where the camera seems to stand now
    message: str
