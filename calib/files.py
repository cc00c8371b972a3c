"""Folders of views: what one look at the board is on disk, and back.

`setup.toml` holds what all views share; `view-NAME.json` with the images beside it is one view. Nothing is written
here: `view_files` gives names and bytes in the order in which they have to reach the disk, the JSON last.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tomli_w
from numpy.typing import NDArray

from calib.errors import ViewFolderError
from calib.records import BoardRecord, IntrinsicsRecord, SetupRecord, TouchRecord, ViewRecord, read
from calib.types import Mounting, Setup
from hw.bounded import IMAGE_BYTES, Unreadable, decode_image, read_bytes
from hw.types import Array, CameraModel, Frame
from perception.board.types import Board

SETUP, TOUCH, TOUCH_IMAGE = "setup.toml", "touch.json", "touch.png"
PREFIX = "view-"


@dataclass(frozen=True, eq=False)
class StoredView:
    """One view as it was stored, images included."""

    name: str
    record: ViewRecord
    colour: NDArray[np.uint8]  # (H, W, 3) RGB
    infrared: NDArray[np.uint16] | None
    depth_mm: NDArray[np.uint16] | None
    sha256: str  # of the record's file, which holds the hashes of the images

    @property
    def q_rad(self) -> Array | None:
        """(7,) as the arm reports them; None where the view gives the flange's pose."""
        return None if self.record.q_rad is None else np.array(self.record.q_rad)

    @property
    def X_BF(self) -> Array | None:
        """(4, 4); None where the view gives joints."""
        return self.record.flange()


@dataclass(frozen=True, eq=False)
class Folder:
    """A folder of views, with what had to be left out of it."""

    setup: SetupRecord
    views: tuple[StoredView, ...]  # in order of their names
    damaged: tuple[str, ...]  # sentences: which view cannot be used, and why


def setup_record(model: CameraModel, board: Board, arm: str, X_FM: Array | None = None) -> SetupRecord:
    """Of a fixed RGB-D camera and an arm whose joints are known; `X_FM` (4, 4) is how the board is meant to be held."""
    return SetupRecord.model_validate(
        {
            "camera": "fixed",
            "arm": arm,
            "serial": model.serial,
            "board": BoardRecord.from_board(board),
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
    """What the solver needs of it."""
    return Setup(
        mounting=Mounting(record.camera),
        board=record.board.board(),
        colour=record.colour.intrinsics(),
        infrared=record.depth.intrinsics() if record.depth else None,
        X_CD=np.array(record.X_CD) if record.X_CD else None,
    )


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
    """The touched corner of a folder and its colour image (H, W, 3) RGB; None where none was touched.

    Raises ViewFolderError.
    """
    path = folder / TOUCH
    if not path.exists():
        return None
    record = read(TouchRecord, path)
    colour = _image(path, record.sha256, record.image, cv2.IMREAD_COLOR)
    return record, np.ascontiguousarray(colour[..., ::-1], dtype=np.uint8)


def read_folder(folder: Path) -> Folder:
    """All views of a folder. A single view that is damaged is left out and named in `damaged`.

    Raises ViewFolderError where the folder or its setup cannot be read, or no view is whole.
    """
    if not folder.is_dir():
        raise ViewFolderError(f"there is no folder {folder}")
    setup = read(SetupRecord, folder / SETUP)
    views: list[StoredView] = []
    damaged: list[str] = []
    for path in sorted(folder.glob(f"{PREFIX}*.json")):
        try:
            views.append(_read_view(path, setup))
        except ViewFolderError as error:
            damaged.append(str(error))
    if not views:
        why = f"; {damaged[0]}" if damaged else f": a view is a file {PREFIX}NAME.json with its image"
        raise ViewFolderError(f"{folder} holds no usable view{why}")
    return Folder(setup, tuple(views), tuple(damaged))


def _read_view(path: Path, setup: SetupRecord) -> StoredView:
    record = read(ViewRecord, path)
    if record.q_rad is not None and setup.arm == "other":
        raise ViewFolderError(f"{path} gives joints of an unknown arm: give X_BF, or name the arm in {SETUP}")
    if record.q_rad is not None and len(record.q_rad) != 7:
        raise ViewFolderError(f"{path} gives {len(record.q_rad)} joints; the {setup.arm} has 7")
    colour = _image(path, record.sha256, record.image, cv2.IMREAD_COLOR)
    size = (setup.colour.width, setup.colour.height)
    if (colour.shape[1], colour.shape[0]) != size:
        raise ViewFolderError(
            f"{path.parent / record.image} is {colour.shape[1]} x {colour.shape[0]}, the intrinsics in {SETUP} are for "
            f"{size[0]} x {size[1]}: give those of this resolution"
        )
    return StoredView(
        name=path.stem.removeprefix(PREFIX),
        record=record,
        colour=np.ascontiguousarray(colour[..., ::-1], dtype=np.uint8),
        infrared=_sensor_image(path, record, record.infrared),
        depth_mm=_sensor_image(path, record, record.depth),
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
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
    wanted = sha256.get(name)
    if wanted is not None and hashlib.sha256(data).hexdigest() != wanted:
        raise ViewFolderError(f"{file} is not what {path.name} says: truncated or changed since it was taken")
    try:
        return decode_image(data, flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except Unreadable as error:
        raise ViewFolderError(f"{file} {error}") from error


def _png(image: NDArray[np.generic]) -> bytes:
    done, data = cv2.imencode(".png", image, (cv2.IMWRITE_PNG_COMPRESSION, 3))
    if not done:
        raise ViewFolderError("an image could not be encoded as PNG")
    return data.tobytes()
