"""Reads folders of views, and gives the files of a view.

`setup.toml` holds everything that all views share; `view-NAME.json` with its images is one view. Nothing is written
here: `view_files` returns names and bytes in the order in which they have to be written, the JSON last.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from numpy.typing import NDArray

from calib.errors import ViewFolderError
from calib.projection import project
from calib.records import IntrinsicsRecord, SetupRecord, TouchRecord, ViewRecord, read
from calib.target_records import BoardRecord, PointsRecord
from calib.types import WORK_BOX_M, Forward, Mounting, Setup, corners_of_box
from hw.bounded import IMAGE_BYTES, Unreadable, decode_image, encode_image, read_bytes
from hw.kinematics import JOINTS, forward
from hw.types import Array, CameraModel, Frame, Intrinsics
from perception.board.types import Board, CalibrationTarget, Corners

_GRID_MM = (0.0, 50.0, 100.0)
"""Points that stand for a target of which only poses are known."""
SETUP, TOUCH, TOUCH_IMAGE = "setup.toml", "touch.json", "touch.png"
PREFIX = "view-"


@dataclass(frozen=True, eq=False)
class StoredView:
    """One stored view with its images."""

    name: str
    record: ViewRecord
    colour: NDArray[np.uint8] | None  # (H, W, 3) RGB; None if the view gives corners instead
    infrared: NDArray[np.uint16] | None
    depth_mm: NDArray[np.uint16] | None
    sha256: str  # of the record's file, which contains the hashes of the images


@dataclass(frozen=True, eq=False)
class Folder:
    """A folder of views, and the damaged views that were left out."""

    setup: SetupRecord
    views: tuple[StoredView, ...]  # sorted by name
    damaged: tuple[str, ...]  # sentences that name an unusable view and the reason
    forward: Forward | None  # of the views' arm; None if the views give poses


def setup_record(model: CameraModel, board: Board, arm: str, X_FM: Array | None = None) -> SetupRecord:
    """The setup of a fixed RGB-D camera and an arm with known joints; `X_FM` (4, 4) is the planned pose of the board in
    the flange.
    """
    return SetupRecord.model_validate(
        {
            "camera": "fixed",
            "arm": arm,
            "serial": model.serial,
            "board": BoardRecord.from_board(board),
            "work_box_m": WORK_BOX_M[Mounting.FIXED],
            "colour": IntrinsicsRecord.from_camera(model.colour),
            "depth": IntrinsicsRecord.from_camera(model.depth),
            "X_CD": tuple(tuple(map(float, row)) for row in model.X_CD),
            "X_HM": None if X_FM is None else tuple(tuple(map(float, row)) for row in X_FM),
        }
    )


def setup_file(record: SetupRecord) -> bytes:
    """The bytes of setup.toml."""
    return tomli_w.dumps(record.model_dump(exclude_none=True)).encode()


def as_setup(record: SetupRecord) -> Setup:
    """The setup for the solver."""
    return Setup(
        mounting=Mounting(record.camera),
        board=record.board.board(),
        colour=record.colour.intrinsics(),
        infrared=record.depth.intrinsics() if record.depth else None,
        X_CD=np.array(record.X_CD) if record.X_CD else None,
        size_known=record.board.size_known,
        work_points_m=None if record.work_box_m is None else corners_of_box(record.work_box_m),
    )


def known_arm(record: SetupRecord, folder: Path) -> tuple[Forward | None, int]:
    """Forward kinematics of the views' arm and its number of joints; None and 0 for an arm that we do not know."""
    return (None, 0) if record.arm == "other" else (forward, JOINTS)


def view_files(
    name: str,
    frame: Frame,
    q_rad: Array,
    t_arm_s: float,
    pose: int | None,
    temperatures_C: Mapping[str, float] | None = None,
) -> Mapping[str, bytes]:
    """File name -> content of one view, in the order in which they must be written."""
    stem = f"{PREFIX}{name}"
    files = {f"{stem}.png": _png(frame.colour[..., ::-1]), f"{stem}.depth.png": _png(frame.depth_mm)}
    if frame.infrared is not None:
        files[f"{stem}.infrared.png"] = _png(frame.infrared)
    record = ViewRecord(
        image=f"{stem}.png",
        depth=f"{stem}.depth.png",
        infrared=f"{stem}.infrared.png" if frame.infrared is not None else None,
        q_rad=tuple(float(q) for q in q_rad),
        t_camera_s=frame.t_s,
        t_arm_s=t_arm_s,
        pose=pose,
        temperatures_C=dict(temperatures_C or {}),
        sha256={file: hashlib.sha256(content).hexdigest() for file, content in files.items()},
    )
    content = json.dumps(record.model_dump(exclude_none=True), indent=1) + "\n"
    return {**files, f"{stem}.json": content.encode()}


def touch_files(colour: NDArray[np.uint8], corner: int, q_rad: Array) -> Mapping[str, bytes]:
    """File name -> content of a touched corner, in the order in which they must be written; `q_rad` (N, 7)."""
    image = _png(colour[..., ::-1])
    rows = tuple(tuple(float(q) for q in row) for row in q_rad)
    record = TouchRecord(
        image=TOUCH_IMAGE, corner=corner, q_rad=rows, sha256={TOUCH_IMAGE: hashlib.sha256(image).hexdigest()}
    )
    content = json.dumps(record.model_dump(exclude_none=True), indent=1) + "\n"
    return {TOUCH_IMAGE: image, TOUCH: content.encode()}


def read_touch(folder: Path) -> tuple[TouchRecord, NDArray[np.uint8]] | None:
    """The touched corner of a folder and its colour image (H, W, 3) RGB; None if none was touched.

    Raises ViewFolderError.
    """
    path = folder / TOUCH
    if not path.exists():
        return None
    record = read(TouchRecord, path)
    colour = _image(path, record.sha256, record.image, cv2.IMREAD_COLOR)
    return record, np.ascontiguousarray(colour[..., ::-1], dtype=np.uint8)


def read_folder(folder: Path, arm_of: Callable[[SetupRecord, Path], tuple[Forward | None, int]] = known_arm) -> Folder:
    """All views of a folder. A damaged view is left out and named in `damaged`.

    `arm_of` gives the arm's forward kinematics and number of joints; `foreign.chains.any_arm` knows those of other
    robots, too.

    Raises ViewFolderError if the folder or its setup cannot be read, or every view is damaged.
    """
    if not folder.is_dir():
        raise ViewFolderError(f"there is no folder {folder}")
    setup = read(SetupRecord, folder / SETUP)
    arm, joints = arm_of(setup, folder)
    views: list[StoredView] = []
    damaged: list[str] = []
    for path in sorted(folder.glob(f"{PREFIX}*.json")):
        try:
            views.append(_read_view(path, setup, joints))
        except ViewFolderError as error:
            damaged.append(str(error))
    if not views:
        why = f"; {damaged[0]}" if damaged else f": a view is a file {PREFIX}NAME.json with its image"
        raise ViewFolderError(f"{folder} holds no usable view{why}")
    return Folder(_with_points(setup, views), tuple(views), tuple(damaged), arm)


def _with_points(setup: SetupRecord, views: Sequence[StoredView]) -> SetupRecord:
    """Take the points of the views as those of the target: each place once, sorted."""
    if not isinstance(setup.board, PointsRecord):
        return setup
    places = {tuple(row) for view in views for row in as_millimetres(view.record.points())}
    if not places:  # pairs of poses alone
        places = {(x, y, 0.0) for x in _GRID_MM for y in _GRID_MM}
    return setup.model_copy(update={"board": setup.board.model_copy(update={"points_mm": tuple(sorted(places))})})


def as_millimetres(points_m: Array | None) -> list[tuple[float, float, float]]:
    """Places (K, 3) in mm, rounded to 1 µm, so that the same point in two views is equal."""
    rows = [] if points_m is None else np.round(1e3 * points_m, 3).tolist()
    return [(float(x), float(y), float(z)) for x, y, z in rows]


def posed_corners(X_CM: Array, target: CalibrationTarget, camera: Intrinsics) -> Corners:
    """All corners of a target where its stated pose puts them in the picture."""
    px = project(camera, X_CM[None], target.p_MK_m[None])[0]
    return Corners(np.arange(len(px)), px)


def given_corners(view: StoredView, setup: SetupRecord) -> Corners:
    """The corners stated by a view of kind "points"."""
    assert isinstance(setup.board, PointsRecord)
    assert view.record.corners_px is not None
    numbers = {place: k for k, place in enumerate(setup.board.points_mm)}
    ids = np.array([numbers[place] for place in as_millimetres(view.record.points())])
    order = np.argsort(ids)
    return Corners(ids[order], np.array(view.record.corners_px)[order])


def _read_view(path: Path, setup: SetupRecord, joints: int) -> StoredView:
    record = read(ViewRecord, path)
    q = record.joints or record.q_rad or record.q_deg
    if q is not None and not joints:
        raise ViewFolderError(
            f"{path} gives joints of an unknown arm: give poses, or state the arm or its [kinematics] in {SETUP}"
        )
    if q is not None and len(q) != joints:
        raise ViewFolderError(f"{path} gives {len(q)} joints; this arm has {joints}")
    if record.target() is None and isinstance(setup.board, PointsRecord) != (record.corners_px is not None):
        raise ViewFolderError(
            f'{path}: corners_px needs kind = "points" under [board] of {SETUP}, and that needs corners_px'
        )
    return StoredView(
        name=path.stem.removeprefix(PREFIX),
        record=record,
        colour=_colour(path, record, setup),
        infrared=_sensor_image(path, record, record.infrared),
        depth_mm=_sensor_image(path, record, record.depth),
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
    )


def _colour(path: Path, record: ViewRecord, setup: SetupRecord) -> NDArray[np.uint8] | None:
    if record.image is None:
        return None
    colour = _image(path, record.sha256, record.image, cv2.IMREAD_COLOR)
    width, height = setup.colour.width, setup.colour.height
    if colour.shape[:2] != (height, width):
        raise ViewFolderError(
            f"{path.parent / record.image} is {colour.shape[1]} x {colour.shape[0]}, the intrinsics in {SETUP} are for "
            f"{width} x {height}: give the intrinsics for this "
            f"resolution{_by_factor(colour.shape[1], colour.shape[0], setup)}"
        )
    return np.ascontiguousarray(colour[..., ::-1], dtype=np.uint8)


def _by_factor(width: int, height: int, setup: SetupRecord) -> str:
    """A hint at the intrinsics of a scaled picture of the same camera; "" if the aspect ratio differs."""
    factor = width / setup.colour.width
    if abs(factor * setup.colour.height - height) > 1.0:
        return ""
    (fx, _, cx), (_, fy, cy) = setup.colour.K[0], setup.colour.K[1]
    cx, cy = (factor * (c + 0.5) - 0.5 for c in (cx, cy))
    return (
        f". The pictures are those of the same camera scaled by {factor:.4g}: width = {width}, height = {height}, "
        f"K = [[{factor * fx:.3f}, 0.0, {cx:.3f}], [0.0, {factor * fy:.3f}, {cy:.3f}], [0.0, 0.0, 1.0]]"
    )


def _sensor_image(path: Path, record: ViewRecord, name: str | None) -> NDArray[np.uint16] | None:
    if name is None:
        return None
    image = _image(path, record.sha256, name, cv2.IMREAD_UNCHANGED)
    if image.ndim != 2:
        raise ViewFolderError(f"{path.parent / name} is not a grey image")
    return np.asarray(image, dtype=np.uint16)


def _image(path: Path, sha256: Mapping[str, str], name: str, flags: int) -> NDArray[np.generic]:
    file = path.parent / name
    try:
        data = read_bytes(file, IMAGE_BYTES)
    except FileNotFoundError as error:
        raise ViewFolderError(f"{file}, named by {path.name}, is missing") from error
    except Unreadable as error:
        raise ViewFolderError(f"{file}, named by {path.name}, {error}") from error
    digest = sha256.get(name)
    if digest is not None and hashlib.sha256(data).hexdigest() != digest:
        raise ViewFolderError(f"{file} does not match {path.name}: it was truncated or changed after it was taken")
    try:
        return decode_image(data, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except Unreadable as error:
        raise ViewFolderError(f"{file} {error}") from error


def _png(image: NDArray[np.generic]) -> bytes:
    return encode_image(image, ".png", 3)
