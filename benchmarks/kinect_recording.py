"""Recordings of an Azure Kinect: Matroska files with colour as JPEG, depth and infrared as 16-bit grey, and the
device's factory calibration attached. Needs PyAV (`pip install av`).

The calibration gives lengths as shares of a reference image; each mode is a part of it. The tables below are those of
the maker's SDK.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from hw.bounded import IMAGE_PIXELS, Unreadable, parse_table, require_file
from hw.errors import CameraError, DeviceUnavailable
from hw.types import Array, CameraModel, Frame, Intrinsics

if TYPE_CHECKING:
    import av.container
    import av.video

VIDEO_BYTES = 64 * 2**30
_MODELS = ("CALIBRATION_LensDistortionModelBrownConrady", "CALIBRATION_LensDistortionModel6KT")


@dataclass(frozen=True)
class Mode:
    """The part of the reference image that a mode keeps."""

    reference: tuple[int, int]  # width, height
    offset: tuple[int, int]
    size: tuple[int, int]


COLOUR_MODES: Mapping[str, Mode] = {
    "720P": Mode((1280, 960), (0, 120), (1280, 720)),
    "1080P": Mode((1920, 1440), (0, 180), (1920, 1080)),
    "1440P": Mode((2560, 1920), (0, 240), (2560, 1440)),
    "1536P": Mode((2048, 1536), (0, 0), (2048, 1536)),
    "2160P": Mode((3840, 2880), (0, 360), (3840, 2160)),
    "3072P": Mode((4096, 3072), (0, 0), (4096, 3072)),
}
DEPTH_MODES: Mapping[str, Mode] = {
    "NFOV_2X2BINNED": Mode((512, 512), (96, 90), (320, 288)),
    "NFOV_UNBINNED": Mode((1024, 1024), (192, 180), (640, 576)),
    "WFOV_2X2BINNED": Mode((512, 512), (0, 0), (512, 512)),
    "WFOV_UNBINNED": Mode((1024, 1024), (0, 0), (1024, 1024)),
}


def camera_model(calibration: bytes, colour_mode: str, depth_mode: str) -> CameraModel:
    """The camera model from the device's JSON; the modes are keys of the tables above.

    Raises CameraError naming the missing or unknown field.
    """
    try:
        content = parse_table(calibration.partition(b"\0")[0], is_toml=False)["CalibrationInformation"]
        cameras = {camera["Purpose"].removeprefix("CALIBRATION_CameraPurpose"): camera for camera in content["Cameras"]}
        colour, depth = cameras["PhotoVideo"], cameras["Depth"]
        return CameraModel(
            serial=str(content["Metadata"]["SerialId"]),
            colour=_intrinsics(colour, _mode(COLOUR_MODES, colour_mode)),
            depth=_intrinsics(depth, _mode(DEPTH_MODES, depth_mode)),
            X_CD=_pose(colour) @ np.linalg.inv(_pose(depth)),
        )
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        raise CameraError(f"the camera's factory calibration cannot be read: {error!r}; record again") from error


MOST_M = 2.0
"""No two cameras of one device are farther apart, and no element of a rotation is larger."""


def _mode(modes: Mapping[str, Mode], name: str) -> Mode:
    if name not in modes:
        raise CameraError(f"camera mode {name!r} is not known: choose one of {', '.join(modes)}")
    return modes[name]


def _intrinsics(camera: dict[str, Any], mode: Mode) -> Intrinsics:
    if camera["Intrinsics"]["ModelType"] not in _MODELS:
        raise ValueError(f"lens model {camera['Intrinsics']['ModelType']}")
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = camera["Intrinsics"]["ModelParameters"]
    width, height = mode.reference
    # in the file, pixel centres lie at + 0.5
    K = [[fx * width, 0, cx * width - mode.offset[0] - 0.5], [0, fy * height, cy * height - mode.offset[1] - 0.5]]
    return Intrinsics(*mode.size, np.array([*K, [0, 0, 1]]), np.array([k1, k2, p1, p2, k3, k4, k5, k6]))


def _pose(camera: dict[str, Any]) -> Array:
    """(4, 4) of the reference in this camera. Raises ValueError if that is no pose within one device."""
    X = np.eye(4)
    X[:3, :3] = np.reshape(camera["Rt"]["Rotation"], (3, 3))
    X[:3, 3] = camera["Rt"]["Translation"]
    within = np.isfinite(X).all() and np.abs(X).max() < MOST_M
    if not within or not np.allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-3):
        raise ValueError(f"the pose {X[:3].tolist()} is no pose within one device")
    return X


_LAYOUTS = re.compile(r"^(MJPG|NV12|YUY2|BGRA)_")
"""How the pixels of a colour mode are laid out; its size follows."""
_TOGETHER_S = 0.010  # colour and depth of one instant differ by less
MOST_ALONE = 300
"""Most images (about 1 GB) that may wait for their partner in another track."""
_PIXELS = {"gray16be": ">u2", "gray16le": "<u2"}


class KinectRecording:
    """Frames and calibration of one file. Opens on entering; frames are timed on the device's clock."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._container: av.container.InputContainer | None = None

    def __enter__(self) -> Self:
        """Raises DeviceUnavailable without PyAV, CameraError for a file that is not such a recording."""
        try:
            import av  # noqa: PLC0415 an optional extra
        except ImportError as error:
            raise DeviceUnavailable("recordings need PyAV: install it with pip install av") from error
        try:
            require_file(self._path, VIDEO_BYTES)
            # Matroska only: a playlist under this name could make FFmpeg open other files.
            self._container = av.open(str(self._path), format="matroska", options={"protocol_whitelist": "file"})
            self._require_bounds(self._container)
        except Unreadable as error:
            raise CameraError(f"{self._path} {error}") from error
        except (OSError, ValueError, av.error.FFmpegError) as error:
            raise CameraError(f"{self._path} cannot be opened as a recording: {error}") from error
        return self

    def __exit__(self, *exc: object) -> None:
        if self._container is not None:
            self._container.close()
            self._container = None

    def _require_bounds(self, container: av.container.InputContainer) -> None:
        """Raises CameraError on images or attachments too large for any camera."""
        for stream in container.streams.video:
            width, height = getattr(stream, "width", 0), getattr(stream, "height", 0)  # an unknown codec has none
            if width * height > IMAGE_PIXELS:
                self.__exit__()
                raise CameraError(f"{self._path} claims images of {width} x {height} pixels: too many")

    def model(self) -> CameraModel:
        """Factory calibration, for the modes that were recorded. Raises CameraError."""
        colour, depth = self._tag("COLOR", "K4A_COLOR_MODE"), self._tag("DEPTH", "K4A_DEPTH_MODE")
        return camera_model(self._attached("calibration.json"), _LAYOUTS.sub("", colour), depth)

    def frames(self) -> Iterator[Frame]:
        """Every instant with both a colour and a depth image, in time order.

        With the infrared image if it was recorded. Raises CameraError.
        """
        container = self._open
        tracks = [self._track(title) for title in ("COLOR", "DEPTH")]
        tracks += [stream for stream in container.streams.video if stream.metadata.get("title") == "IR"]
        start_s = 1e-9 * self._offset_ns(container.metadata.get("K4A_START_OFFSET_NS", "0"))
        waiting: dict[int, deque[tuple[float, Any]]] = {track.index: deque() for track in tracks}
        queues = tuple(waiting.values())
        for index, images in self._packets(container, tracks):
            for image in images:
                waiting[index].append((start_s + float(image.time or 0.0), image))
                if len(waiting[index]) > MOST_ALONE:
                    raise CameraError(
                        f"{self._path}: {MOST_ALONE} images of one track in a row have no partner in the "
                        "other; record colour and depth together"
                    )
            while all(queues):
                stamps_s = [queue[0][0] for queue in queues]
                if max(stamps_s) - min(stamps_s) < _TOGETHER_S:
                    colour, depth, *infrared = (queue.popleft()[1] for queue in queues)
                    dark = grey16(infrared[0]) if infrared else None
                    yield Frame(stamps_s[0], _rgb(colour), grey16(depth), dark)
                else:  # the oldest has no partner
                    queues[stamps_s.index(min(stamps_s))].popleft()

    def _packets(
        self, container: av.container.InputContainer, tracks: Sequence[Any]
    ) -> Iterator[tuple[int, Sequence[Any]]]:
        """(index of the track, its images), packet by packet. Raises CameraError on a damaged packet."""
        import av  # noqa: PLC0415 an optional extra

        try:
            container.seek(0)
            for packet in container.demux(*tracks):
                yield packet.stream.index, packet.decode()
        except (OSError, ValueError, av.error.FFmpegError) as error:
            raise CameraError(f"{self._path} is cut short or damaged ({error})") from error

    def _offset_ns(self, text: str) -> int:
        if not re.fullmatch(r"-?[0-9]{1,18}", text):
            raise CameraError(
                f"{self._path}: its tag K4A_START_OFFSET_NS is {text[:40]!r}, which is not a whole number"
            )
        return int(text)

    @property
    def _open(self) -> av.container.InputContainer:
        if self._container is None:
            raise DeviceUnavailable(f"the recording {self._path} is not open: use it inside a `with` block")
        return self._container

    def _track(self, title: str) -> Any:
        for stream in self._open.streams.video:
            if stream.metadata.get("title") == title:
                return stream
        raise CameraError(f"{self._path} has no track {title}: record colour and depth together")

    def _tag(self, title: str, key: str) -> str:
        tags = self._track(title).metadata
        if key not in tags:
            raise CameraError(f"track {title} of {self._path} has no {key}: it is not a recording of an Azure Kinect")
        return str(tags[key])

    def _attached(self, name: str) -> bytes:
        for stream in self._open.streams:
            if stream.type == "attachment" and stream.metadata.get("filename") == name:
                return bytes(stream.data)  # type: ignore[attr-defined]
        raise CameraError(f"{self._path} has no {name}: it is not a recording of an Azure Kinect")


def _rgb(image: av.video.VideoFrame) -> np.ndarray[Any, np.dtype[np.uint8]]:
    return np.ascontiguousarray(image.to_ndarray(format="rgb24"), dtype=np.uint8)


def grey16(image: av.video.VideoFrame) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """(H, W) of a 16-bit grey image, in the byte order of this machine. Raises CameraError for any other."""
    if image.format.name not in _PIXELS:
        raise CameraError(
            f"a depth or infrared track contains {image.format.name} instead of 16-bit grey: record with k4arecorder"
        )
    plane = image.planes[0]
    rows = np.frombuffer(plane, dtype=_PIXELS[image.format.name]).reshape(image.height, -1)  # type: ignore[call-overload]
    return np.ascontiguousarray(rows[:, : image.width], dtype=np.uint16)
