"""The records in the files of a calibration: `setup.toml`, `view-*.json`, `touch.json`. Checked on reading.

`docs/guide/foreign-views.md` describes them for people who write such files on another robot.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from calib.errors import ViewFolderError
from calib.pose_records import LARGEST, PoseKeys, PosesRecord
from calib.target_records import AnyTargetRecord
from calib.types import FORMAT, Matrix, Numbers, StoredRecord
from hw.bounded import Unreadable, read_table
from hw.records import AnyRecord, Record, from_any_version, number_hint
from hw.types import Array, Intrinsics


class IntrinsicsRecord(Record):
    """A camera in OpenCV's terms; pixel centres lie at integers."""

    width: int = Field(ge=32, le=20000)
    height: int = Field(ge=32, le=20000)
    K: Matrix  # three rows of three
    distortion: Numbers = ()  # k1 k2 p1 p2 [k3 [k4 k5 k6]]

    @classmethod
    def from_camera(cls, camera: Intrinsics) -> Self:
        """The record of a camera, with all eight distortion coefficients."""
        rows = tuple(tuple(map(float, row)) for row in camera.K)
        return cls(width=camera.width, height=camera.height, K=rows, distortion=tuple(map(float, camera.distortion)))

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if np.shape(self.K) != (3, 3) or self.K[2] != (0.0, 0.0, 1.0) or min(self.K[0][0], self.K[1][1]) <= 0:
            raise ValueError("K is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels")
        if self.K[0][1] != 0.0 or self.K[1][0] != 0.0:
            skew = self.K[0][1] or self.K[1][0]
            raise ValueError(
                f"K has the skew {skew:g}: calibrate the lens without it; K is [[fx, 0, cx], [0, fy, cy], …]"
            )
        if len(self.distortion) not in (0, 4, 5, 8):
            raise ValueError(f"distortion has {len(self.distortion)} numbers; OpenCV has 0, 4, 5 or 8")
        if not (0 < self.K[0][2] < self.width and 0 < self.K[1][2] < self.height):
            raise ValueError("the principal point lies outside of the image: K is for another resolution")
        return self

    def intrinsics(self) -> Intrinsics:
        """The camera, its distortion padded with zeros."""
        return Intrinsics(
            self.width, self.height, np.array(self.K), np.array([*self.distortion, *[0.0] * (8 - len(self.distortion))])
        )


class KinematicsRecord(Record):
    """`[kinematics]` of setup.toml: an arm that the program does not know, as a Denavit-Hartenberg table or a URDF."""

    dh: tuple[Numbers, ...] | None = None  # rows of a in m, alpha in rad, d in m, theta in rad
    dh_convention: Literal["craig", "classic"] | None = None  # never assumed
    urdf: str | None = None  # file beside setup.toml
    base: str | None = None  # link of the URDF; by default its root
    tip: str | None = None  # link of the URDF; by default its only end

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.dh is None) == (self.urdf is None):
            raise ValueError("give either dh, a table, or urdf, a file")
        if self.dh is not None and self.dh_convention is None:
            raise ValueError(
                'say dh_convention: "craig" (modified, a and alpha of the link before) or "classic" (of the link after)'
            )
        for row in self.dh or ():
            if len(row) not in (4, 5):
                raise ValueError("a row of dh is [a m, alpha rad, d m, theta rad], and 0 after it where nothing moves")
            if abs(row[0]) > 10 or abs(row[2]) > 10:
                raise ValueError(f"dh holds a length of {max(abs(row[0]), abs(row[2])):g}: lengths are in m, not in mm")
            if abs(row[1]) > 6.3 or abs(row[3]) > 6.3:
                raise ValueError(
                    f"dh holds an angle of {max(abs(row[1]), abs(row[3])):g}: angles are in rad, not in degrees"
                )
        if self.urdf is not None and ("/" in self.urdf or self.urdf.startswith(".")):
            raise ValueError("name the URDF without a folder: it must lie beside setup.toml")
        return self


class SetupRecord(Record):
    """setup.toml: everything that is the same in all views of a folder."""

    format: int = FORMAT
    camera: Literal["fixed", "wrist"]
    arm: Literal["panda", "fr3", "fr3v2", "other"] = (
        "other"  # for "other", views give flange poses, or [kinematics] is given
    )
    serial: str = ""  # of the camera
    kinematics: KinematicsRecord | None = None  # of an arm that the program does not know
    poses: PosesRecord = PosesRecord()  # convention of poses whose keys do not state it
    board: AnyTargetRecord  # the target in the views
    work_box_m: Matrix | None = None  # x, y and z from and to, in the camera's carrier; else where the target was
    colour: IntrinsicsRecord
    depth: IntrinsicsRecord | None = None  # of depth and infrared images
    X_CD: Matrix | None = None  # 4 rows: the depth camera in the colour camera
    X_HM: Matrix | None = None  # 4 rows: planned pose of the board in its holder; a deviation gives a warning

    @model_validator(mode="after")
    def _one_arm(self) -> Self:
        box = self.work_box_m
        if box is not None and (len(box) != 3 or any(len(row) != 2 or row[0] >= row[1] for row in box)):
            raise ValueError("work_box_m must have three rows, of x, y and z, each from a smaller to a larger number")
        if self.kinematics is not None and self.arm != "other":
            raise ValueError(f"the kinematics of the {self.arm} are known: leave out either arm or [kinematics]")
        return self


class ViewRecord(PoseKeys):
    """view-NAME.json: one view of the board with the arm at rest. Written last, so it exists only with its images."""

    format: int = FORMAT
    image: str | None = None  # file beside this one, PNG or JPEG
    infrared: str | None = None  # 16-bit PNG
    depth: str | None = None  # 16-bit PNG, mm
    corners_px: Matrix | None = None  # (K, 2) found by another program, for kind = "points"
    points_m: Matrix | None = None  # (K, 3) places on the target; or
    points_mm: Matrix | None = None  # the same in mm
    X_CM: Matrix | None = None  # or the target in the camera by another program, four rows of four, metres; or
    target_position_m: Numbers | None = None  # its position, with a rotation
    target_quaternion_wxyz: Numbers | None = None  # w first
    target_quaternion_xyzw: Numbers | None = None  # w last
    t_camera_s: float | None = None
    t_arm_s: float | None = None
    pose: int | None = None  # number of the planned pose, to continue after an interruption
    temperatures_C: dict[str, float] = Field(default_factory=dict)  # by device ("arm", "camera"), if reported
    sha256: dict[str, str] = Field(default_factory=dict)  # file -> hash

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if any(
            "/" in name or name.startswith(".") for name in (self.image or "", self.infrared or "", self.depth or "")
        ):
            raise ValueError("name images without a folder: they must lie beside the view")
        if self.target() is None and self.image is None and self.corners_px is None:
            raise ValueError(
                "give an image, or corners_px with points_m, or the target's pose (X_CM, or target_position_m with "
                "target_quaternion_xyzw)"
            )
        for rows in (self.corners_px or (), self.points_m or (), self.points_mm or ()):
            if (most := max((abs(value) for row in rows for value in row), default=0.0)) > LARGEST:
                raise ValueError(f"corners_px or points hold {most:g}: no picture or target is so large")
        if self.corners_px is not None:
            places = self.points_m if self.points_mm is None else self.points_mm
            if (self.points_m is None) == (self.points_mm is None) or places is None:
                raise ValueError("corners_px needs exactly one of points_m and points_mm")
            if {len(row) for row in self.corners_px} != {2} or {len(row) for row in places} != {3}:
                raise ValueError("corners_px must have rows of two numbers, points_m rows of three")
            if len(places) != len(self.corners_px) or len(set(places)) < len(places):
                raise ValueError(
                    f"{len(self.corners_px)} corners_px and {len(places)} points: there must be as many, each point "
                    "once"
                )
        return self

    def target(self) -> Array | None:
        """X_CM (4, 4), the target in the camera, if the view states it. Raises ValueError for an invalid pose."""
        names = ("target_position_m", "target_quaternion_wxyz", "target_quaternion_xyzw")
        stated = {name.removeprefix("target_"): value for name in names if (value := getattr(self, name)) is not None}
        if self.X_CM is None and not stated:
            return None
        try:
            X = PoseKeys.model_validate(stated if self.X_CM is None else {"X_BF": self.X_CM, **stated}).flange()
        except ValueError as error:
            raise ValueError(f"the target's pose cannot be used: {explained(error)}") from error
        assert X is not None
        if X[2, 3] <= 0.0:
            raise ValueError(
                f"the target is {X[2, 3]:g} m before the camera: give its pose in the camera, whose Z looks ahead"
            )
        return X

    def points(self) -> Array | None:
        """(K, 3) in m, in the order of `corners_px`; None if the view does not give them."""
        if self.points_mm is not None:
            return 1e-3 * np.array(self.points_mm)
        return None if self.points_m is None else np.array(self.points_m)


def explained(error: ValueError) -> str:
    """The first defect of a record in words."""
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors(include_url=False)[0]
    return f"{'.'.join(str(part) for part in first['loc'])} {first['msg']}{number_hint(first['input'])}".strip()


class TouchRecord(Record):
    """touch.json: one corner of a still board in view, touched with the tip from several directions."""

    format: int = FORMAT
    image: str  # colour image of the lying board, beside this file
    corner: int = Field(ge=0)  # id of the inner corner: along X first, from 0
    q_rad: Matrix | None = None  # one row per touch, reported joints
    X_BF: tuple[Matrix, ...] | None = None  # four rows of four per touch, if joints are unknown
    sha256: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_pose(self) -> Self:
        if (self.q_rad is None) == (self.X_BF is None):
            raise ValueError("give exactly one of q_rad and X_BF, with one entry per touch")
        if "/" in self.image or self.image.startswith("."):
            raise ValueError("name the image without a folder: it must lie beside this file")
        for q in self.q_rad or ():
            ViewRecord(image=self.image, q_rad=q)  # checks rad, metres and rotation
        for X in self.X_BF or ():
            ViewRecord(image=self.image, X_BF=X)
        return self

    def flanges(self) -> Array | None:
        """(N, 4, 4) X_BF if given, else None."""
        if self.X_BF is None:
            return None
        flanges = [ViewRecord(image=self.image, X_BF=X).flange() for X in self.X_BF]
        return np.stack([X for X in flanges if X is not None])


def read(kind: type[AnyRecord], path: Path) -> AnyRecord:
    """Read a TOML or JSON file as a record. Raises ViewFolderError naming file, key and defect."""
    try:
        data = read_table(path)
    except FileNotFoundError as error:
        raise ViewFolderError(f"{path} is missing") from error
    except Unreadable as error:
        raise ViewFolderError(f"{path} {error}; restore it, or remove it with its images") from error
    version = data.get("format", FORMAT)
    if isinstance(version, int) and version > FORMAT:
        raise ViewFolderError(f"{path} is of format {version}; this version reads up to {FORMAT}: update adaptsim")
    try:
        return from_any_version(kind, data) if issubclass(kind, StoredRecord) else kind.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the whole file"
        hint = f"; known keys: {', '.join(kind.model_fields)}" if first["type"] == "extra_forbidden" else ""
        raise ViewFolderError(
            f"{path}: {where}: {first['msg']}{hint}. docs/guide/foreign-views.md describes the file"
        ) from error
