"""What stands in the files of a calibration: `setup.toml`, `view-*.json`, `calibration.json`. Checked on reading.

`docs/guide/calibrate.md` describes the same for whoever writes such files on another robot.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from calib.errors import ViewFolderError
from hw.bounded import Unreadable, read_table
from hw.types import Array, Intrinsics
from perception.board.types import Board

FORMAT = 1


def _plain(values: Any) -> Any:
    return values.tolist() if isinstance(values, np.ndarray) else values


def _told(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Numbers = Annotated[tuple[float, ...], BeforeValidator(_plain)]
Matrix = Annotated[tuple[Numbers, ...], BeforeValidator(_plain)]
Measured = Annotated[float | None, BeforeValidator(_told)]
"""JSON knows no NaN: what was not measured is null."""


class Record(BaseModel):
    """Base of everything that a calibration stores: frozen, finite, and unknown keys are an error.

    It can be validated from the value that it stores, whose further attributes are left out.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, from_attributes=True)


AnyRecord = TypeVar("AnyRecord", bound=Record)


class BoardRecord(Record):
    """The board as printed; its square as measured on the print."""

    squares_across: int
    squares_down: int
    square_mm: float = Field(gt=2.0, lt=500.0)
    marker_mm: float = Field(gt=1.0, lt=500.0)
    dictionary: str

    @classmethod
    def from_board(cls, board: Board) -> Self:
        """As it is stored: lengths in mm, to a nanometre."""
        return cls(
            squares_across=board.squares_across,
            squares_down=board.squares_down,
            square_mm=round(1e3 * board.square_m, 6),
            marker_mm=round(1e3 * board.marker_m, 6),
            dictionary=board.dictionary,
        )

    @model_validator(mode="after")
    def _possible(self) -> Self:
        self.board()  # its own checks: a ValueError becomes part of the message
        return self

    def board(self) -> Board:
        """The value. Raises ValueError for a board that cannot be."""
        return Board(
            self.squares_across, self.squares_down, 1e-3 * self.square_mm, 1e-3 * self.marker_mm, self.dictionary
        )


class IntrinsicsRecord(Record):
    """A camera in OpenCV's terms; pixel centres lie at whole numbers."""

    width: int = Field(ge=32, le=20000)
    height: int = Field(ge=32, le=20000)
    K: Matrix  # three rows of three
    distortion: Numbers = ()  # k1 k2 p1 p2 [k3 [k4 k5 k6]]

    @classmethod
    def from_camera(cls, camera: Intrinsics) -> Self:
        """As it is stored, with all eight numbers of the distortion."""
        rows = tuple(tuple(map(float, row)) for row in camera.K)
        return cls(width=camera.width, height=camera.height, K=rows, distortion=tuple(map(float, camera.distortion)))

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if np.shape(self.K) != (3, 3) or self.K[2] != (0.0, 0.0, 1.0) or min(self.K[0][0], self.K[1][1]) <= 0:
            raise ValueError("K is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels")
        if len(self.distortion) not in (0, 4, 5, 8):
            raise ValueError(f"distortion has {len(self.distortion)} numbers; OpenCV's are 0, 4, 5 or 8")
        if not (0 < self.K[0][2] < self.width and 0 < self.K[1][2] < self.height):
            raise ValueError("the principal point lies outside of the image: K is of another resolution")
        return self

    def intrinsics(self) -> Intrinsics:
        """The value, its distortion filled up with zeros."""
        return Intrinsics(
            self.width, self.height, np.array(self.K), np.array([*self.distortion, *[0.0] * (8 - len(self.distortion))])
        )


class SetupRecord(Record):
    """setup.toml: what stays the same in all views of a folder."""

    format: int = FORMAT
    camera: Literal["fixed", "wrist"]
    arm: Literal["panda", "fr3", "other"] = "other"  # of "other", views give flange poses
    serial: str = ""  # of the camera
    board: BoardRecord
    colour: IntrinsicsRecord
    depth: IntrinsicsRecord | None = None  # of depth and infrared images
    X_CD: Matrix | None = None  # 4 rows: the depth camera in the colour camera
    X_HM: Matrix | None = None  # 4 rows: the board as it is meant to be held, for saying so where it is not


class ViewRecord(Record):
    """view-NAME.json: one look at the board, arm at rest. Written last, so it exists only with its images."""

    format: int = FORMAT
    image: str  # file beside this one, PNG or JPEG
    infrared: str | None = None  # 16-bit PNG
    depth: str | None = None  # 16-bit PNG, mm
    q_rad: Numbers | None = None
    X_BF: Matrix | None = None
    position_m: Numbers | None = None  # of the flange in the base, with `quaternion_wxyz`: another way to give X_BF
    quaternion_wxyz: Numbers | None = None
    t_camera_s: float | None = None
    t_arm_s: float | None = None
    pose: int | None = None  # number of the planned pose, to continue after an interruption
    temperatures_C: dict[str, float] = {}  # of those devices that tell theirs: "arm", "camera"
    sha256: dict[str, str] = {}  # file -> hash

    @model_validator(mode="after")
    def _one_pose(self) -> Self:
        given = [self.q_rad is not None, self.X_BF is not None, self.position_m is not None]
        if sum(given) != 1:
            raise ValueError("give exactly one of q_rad, X_BF, or position_m with quaternion_wxyz")
        if (self.position_m is None) != (self.quaternion_wxyz is None):
            raise ValueError("position_m and quaternion_wxyz go together")
        if any("/" in name or name.startswith(".") for name in (self.image, self.infrared or "", self.depth or "")):
            raise ValueError("images are named without a folder: they lie beside the view")
        self.flange()
        return self

    def flange(self) -> Array | None:
        """X_BF (4, 4) where given. Raises ValueError for what is no pose, or looks like millimetres or degrees."""
        if self.q_rad is not None:
            if max(map(abs, self.q_rad)) > 7.0:
                raise ValueError(f"q_rad holds {max(map(abs, self.q_rad)):g}: joints are in rad, not in degrees")
            return None
        X = np.eye(4)
        if self.X_BF is not None:
            if np.shape(self.X_BF) != (4, 4) or self.X_BF[3] != (0.0, 0.0, 0.0, 1.0):
                raise ValueError("X_BF is four rows of four, the last one 0 0 0 1")
            X = np.array(self.X_BF, dtype=np.float64)
        else:
            X[:3, :3], X[:3, 3] = _rotation(self.quaternion_wxyz or ()), _vector(self.position_m or ())
        if np.abs(X[:3, :3] @ X[:3, :3].T - np.eye(3)).max() > 1e-3 or np.linalg.det(X[:3, :3]) < 0:
            raise ValueError("the rotation is not one: its axes are not of length 1, at right angles, right-handed")
        if np.linalg.norm(X[:3, 3]) > 10.0:
            raise ValueError(
                f"the flange is {np.linalg.norm(X[:3, 3]):g} m from the base: positions are in metres, not mm"
            )
        u, _, vt = np.linalg.svd(X[:3, :3])
        X[:3, :3] = u @ vt
        return X


class TouchRecord(Record):
    """touch.json: one corner of the board, lying still in view, touched with the tip from several directions."""

    format: int = FORMAT
    image: str  # colour image of the board as it lies, beside this file
    corner: int = Field(ge=0)  # id of the inner corner: along X first, from 0
    q_rad: Matrix | None = None  # a row a touch, as the arm reports it
    X_BF: tuple[Matrix, ...] | None = None  # four rows of four a touch, where joints are not known
    sha256: dict[str, str] = {}

    @model_validator(mode="after")
    def _one_pose(self) -> Self:
        if (self.q_rad is None) == (self.X_BF is None):
            raise ValueError("give exactly one of q_rad and X_BF, one entry a touch")
        if "/" in self.image or self.image.startswith("."):
            raise ValueError("the image is named without a folder: it lies beside this file")
        for q in self.q_rad or ():
            ViewRecord(image=self.image, q_rad=q)  # its own checks: rad, metres, a rotation
        for X in self.X_BF or ():
            ViewRecord(image=self.image, X_BF=X)
        return self

    def flanges(self) -> Array | None:
        """(N, 4, 4) X_BF where given."""
        if self.X_BF is None:
            return None
        found = [ViewRecord(image=self.image, X_BF=X).flange() for X in self.X_BF]
        return np.stack([X for X in found if X is not None])


def _vector(values: Numbers) -> Array:
    if len(values) != 3:
        raise ValueError("position_m has three numbers")
    return np.array(values)


def _rotation(wxyz: Numbers) -> Array:
    if len(wxyz) != 4 or abs(np.linalg.norm(wxyz) - 1) > 1e-2:
        raise ValueError("quaternion_wxyz has four numbers, w first, of length 1")
    w, x, y, z = np.array(wxyz) / np.linalg.norm(wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def read(kind: type[AnyRecord], path: Path) -> AnyRecord:
    """A TOML or JSON file as a record. Raises ViewFolderError naming the file, the key and what is wrong."""
    try:
        data = read_table(path)
    except FileNotFoundError as error:
        raise ViewFolderError(f"{path} is missing") from error
    except Unreadable as error:
        raise ViewFolderError(f"{path} {error}; restore it, or remove it with its images") from error
    version = data.get("format", FORMAT)
    if isinstance(version, int) and version > FORMAT:
        raise ViewFolderError(f"{path} is of format {version}; this version reads up to {FORMAT}")
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "the whole file"
        known = f"; known keys: {', '.join(kind.model_fields)}" if first["type"] == "extra_forbidden" else ""
        raise ViewFolderError(
            f"{path}: {where}: {first['msg']}{known}. docs/guide/calibrate.md describes the file"
        ) from error
