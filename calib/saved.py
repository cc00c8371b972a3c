"""A finished calibration as stored: result, uncertainty, acceptance, origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from pydantic import Field

from calib.records import IntrinsicsRecord
from calib.target_records import AnyTargetRecord
from calib.types import (
    FORMAT,
    TIME_OFFSET,
    Check,
    ClosedForm,
    Grade,
    HandEye,
    Matrix,
    Measured,
    Numbers,
    Solution,
    StoredRecord,
    ViewFit,
    reasons,
)
from hw.records import Record
from hw.types import Array

FILE = "calibration.json"


class OffsetsRecord(Record):
    """The estimated joint offsets, and whether the calibration uses them."""

    adopted: bool
    reason: str
    offsets_rad: Numbers
    suspected_rad: Numbers
    sigma_rad: tuple[Measured, ...]


class UncertaintyRecord(Record):
    """The possible error of the camera's pose; the `_95` values are 95 % bounds."""

    sigma_mm: float
    sigma_deg: float
    position_95_mm: float
    rotation_95_deg: float
    worst_95_mm: float
    arm_worst_95_mm: float
    points_m: Matrix  # (P, 3) corners of the work volume
    work_95_mm: Numbers  # (P,) error at these points
    arm_work_95_mm: Numbers


class SavedCalibration(StoredRecord):
    """calibration.json: a finished calibration."""

    format: int = FORMAT
    mounting: Literal["fixed", "wrist"]
    X_AC: Matrix  # the camera in its carrier: in the base if fixed, in the flange on the wrist
    X_HM: Matrix  # the board in its holder
    joint_offsets: OffsetsRecord | None
    uncertainty: UncertaintyRecord
    fit_px: float
    held_out_px: Measured
    corner_px: float
    joint_rad: Measured  # spread of the joints from view to view
    square_scale: float
    views: tuple[ViewFit, ...]
    methods: tuple[ClosedForm, ...]
    checks: tuple[Check, ...]
    gates: tuple[Check, ...]  # further conditions of acceptance
    accepted: bool
    created: str  # ISO 8601
    source: str
    folder: str  # of the views
    hw: str
    arm: str
    camera: str  # serial
    board: AnyTargetRecord
    refined_intrinsics: IntrinsicsRecord | None = None  # estimated from the views, used instead of the stated ones
    temperatures_C: dict[str, float | None] = Field(default_factory=dict)  # median over the views; null: not reported
    versions: dict[str, str]

    def hand_eye(self) -> HandEye:
        """The camera's pose for perception. Raises ValueError for a camera on the wrist."""
        if self.mounting != "fixed":
            raise ValueError("a camera on the wrist has no constant pose in the base")
        u = self.uncertainty
        return HandEye(np.array(self.X_AC), u.sigma_mm, u.sigma_deg, self.source, self.created, self.camera_late_s())

    def camera_late_s(self) -> float:
        """Delay of the camera's stamps on the arm's clock, s, measured by swinging the board; 0 if not measured."""
        values = (c.value for c in self.checks if c.name == TIME_OFFSET and c.verdict != Grade.NOT_MEASURED)
        return 1e-3 * (next(values, None) or 0.0)

    def offsets_rad(self) -> Array:
        """(7,) true minus reported joint positions; zeros if not estimated or not adopted."""
        offsets = self.joint_offsets
        return np.array(offsets.offsets_rad) if offsets and offsets.adopted else np.zeros(7)


def record_calibration(
    solution: Solution,
    points_m: Array,
    checks: Sequence[Check],
    gates: Sequence[Check],
    view_sha256: Mapping[str, str],
    **origin: Any,
) -> SavedCalibration:
    """The record of a calibration. `points_m` (P, 3) are the corners of the work volume.

    `origin` are the fields from `created` on; `view_sha256` is by the view's name.
    """
    named = {check.name for check in checks}
    shared = {name: value for name, value in vars(solution).items() if name in SavedCalibration.model_fields}
    sigmas = {name: getattr(solution.uncertainty, name, points_m) for name in UncertaintyRecord.model_fields}
    return SavedCalibration.model_validate(
        shared
        | origin
        | {
            "joint_offsets": solution.joints,
            "uncertainty": sigmas,
            "corner_px": solution.noise.corner_px,
            "joint_rad": solution.noise.joint_rad,
            "views": [view.model_copy(update={"sha256": view_sha256.get(view.name, "")}) for view in solution.views],
            "checks": checks,
            "gates": [gate for gate in gates if gate.name not in named],
            "accepted": not reasons(gates),
        }
    )
