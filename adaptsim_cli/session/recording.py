"""One motion as an MCAP file (images, joints, tool) for Foxglove and Rerun; read back, it gives `Frame`s."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.reader import McapReader, make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from numpy.typing import NDArray

from adaptsim_cli.bench.rig import Recording
from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.session import topics
from adaptsim_cli.session.mcap_errors import DAMAGED
from adaptsim_cli.session.records import TrialRecord, corrupt
from adaptsim_cli.session.store import PRUNED, SessionStore
from hw.bounded import decode_image, encode_image
from hw.types import Array, CameraModel, Execution, Frame, Intrinsics
from perception.types import ObjectTrack

FILE, OBJECT_FILE = "recording.mcap", "object.mcap"
_COLOUR, _DEPTH = "/camera/colour", "/camera/depth"
_BEFORE_COLOUR, _BEFORE_DEPTH = "/before/colour", "/before/depth"
_AFTER_COLOUR, _AFTER_DEPTH = "/after/colour", "/after/depth"
TOPICS = {
    _COLOUR: topics.PICTURE,
    _DEPTH: topics.DEPTH,
    _BEFORE_COLOUR: topics.PICTURE,
    _BEFORE_DEPTH: topics.DEPTH,
    _AFTER_COLOUR: topics.PICTURE,
    _AFTER_DEPTH: topics.DEPTH,
    **topics.TYPES,
}
"""Topic -> message type, for every recording."""
COLOURS = (_COLOUR, _BEFORE_COLOUR, _AFTER_COLOUR)
_IMAGES = (_COLOUR, _DEPTH, _BEFORE_COLOUR, _BEFORE_DEPTH, _AFTER_COLOUR, _AFTER_DEPTH)
_JPEG_QUALITY = 95

Bytes = NDArray[np.uint8]
Depth = NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class StoredFrame:
    """A frame as it is stored: its messages, and the frame that `read` makes of them."""

    colour: bytes
    depth: bytes
    frame: Frame


def stored(frame: Frame, *, lossless: bool = False) -> StoredFrame:
    """Compress a frame, and decode it again for the tracker, which sees only the stored pictures.

    Its colour as JPEG, or as PNG, so that a later search finds the object in exactly the same pixels.
    """
    t_ns, rgb = topics.ns(frame.t_s), frame.colour
    if lossless:
        layout, content = "png", encode_image(rgb[..., ::-1], ".png", 1)
    else:
        layout, content = "jpeg", encode_jpeg(rgb, _JPEG_QUALITY)
    colour = topics.compressed_image(t_ns, "camera_colour", layout, content)
    depth = topics.image(t_ns, "camera_depth", frame.depth_mm)
    pixels, depth_mm = topics.decode(topics.PICTURE, colour), topics.decode(topics.DEPTH, depth)
    return StoredFrame(colour, depth, Frame(_s(t_ns), _pixels(pixels), _depth_mm(depth_mm)))


@dataclass(frozen=True, eq=False)
class PartialRecording:
    """A recording in memory, complete except for the picture with the arm at home again."""

    recording: Recording
    _file: _Mcap

    def finish(self, after: StoredFrame | None) -> tuple[bytes, Recording]:
        """The whole file, and the recording that `read` gives. Call it once."""
        self._file.add(_pictures([] if after is None else [after], _AFTER_COLOUR, _AFTER_DEPTH))
        return self._file.finish(), replace(self.recording, after=None if after is None else after.frame)


def begin(
    before: StoredFrame,
    frames: Sequence[StoredFrame],
    model: CameraModel,
    X_BC: Array,
    execution: Execution,
    X_BT_at: Callable[[float], Array],
    camera_late_s: float = 0.0,
    arm: str = "panda",
) -> PartialRecording:
    """Encode all but the picture with the arm at home again, as soon as the motion has ended.

    Messages are in time order. An execution without samples has no tool poses: the arm stopped, and its joints are
    unknown. `camera_late_s` is already subtracted from the camera's stamps; it is stored to make that reversible.
    """
    times_s, start_ns = [one.frame.t_s for one in frames], topics.ns(before.frame.t_s)
    messages = [
        *_pictures([before], _BEFORE_COLOUR, _BEFORE_DEPTH),
        *_pictures(frames, _COLOUR, _DEPTH),
        *topics.cameras(model, start_ns),
        topics.description(arm, start_ns),
        *topics.joints(execution),
        *topics.transforms(times_s or [before.frame.t_s], execution, X_BT_at, model, X_BC),
    ]
    types = topics.quantity_types(execution.measured) | TOPICS
    file = _Mcap(types, {"camera.json": _camera_json(model, X_BC, execution, camera_late_s)})
    file.add(messages)
    t_s = np.array([_s(topics.ns(execution.t_start_s + t_s)) - execution.t_start_s for t_s in execution.t_s])
    played = replace(execution, t_s=t_s)
    return PartialRecording(Recording(before.frame, tuple(one.frame for one in frames), model, X_BC, played), file)


def encode_object(track: ObjectTrack, t_start_s: float) -> bytes:
    """The tracked centre, on the clock of the recording; the motion began at `t_start_s`."""
    return as_mcap({topics.OBJECT: topics.AFTERWARDS[topics.OBJECT]}, track_messages(track, t_start_s), {})


def track_messages(track: ObjectTrack, t_start_s: float) -> list[topics.Message]:
    """The tracked centre at every time of the track."""
    return [
        (topics.ns(t_s), topics.OBJECT, topics.point(topics.ns(t_s), "base", state[:3]))
        for t_s, state in zip(track.t_s + t_start_s, track.state, strict=True)
    ]


def depths(stored: Recording) -> list[topics.Message]:
    """Every depth image, unchanged."""
    after = [] if stored.after is None else [stored.after]
    return [
        (topics.ns(frame.t_s), topic, topics.image(topics.ns(frame.t_s), "camera_depth", frame.depth_mm))
        for topic, frames in ((_DEPTH, stored.frames), (_BEFORE_DEPTH, [stored.before]), (_AFTER_DEPTH, after))
        for frame in frames
    ]


def as_mcap(
    types: Mapping[str, str],
    messages: Sequence[topics.Message],
    attached: Mapping[str, bytes],
    metadata: Mapping[str, str] | None = None,
) -> bytes:
    """An MCAP file with topics (name -> type), `messages` in time order, JSON attachments by name, and metadata."""
    file = _Mcap(types, attached, metadata)
    file.add(messages)
    return file.finish()


class _Mcap:
    """An MCAP file in memory."""

    def __init__(
        self, types: Mapping[str, str], attached: Mapping[str, bytes], metadata: Mapping[str, str] | None = None
    ) -> None:
        """See `as_mcap`."""
        self._stream = io.BytesIO()
        writer = self._writer = McapWriter(self._stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="adaptsim")
        names = sorted(set(types.values()))
        schemas = {name: writer.register_schema(name, "ros2msg", topics.SCHEMAS[name].encode()) for name in names}
        self._channels = {t: writer.register_channel(t, "cdr", schemas[name]) for t, name in types.items()}
        for name, content in attached.items():
            writer.add_attachment(0, 0, name, "application/json", content)
        if metadata:
            writer.add_metadata("adaptsim", dict(metadata))

    def add(self, messages: Iterable[topics.Message]) -> None:
        """Add messages, in time order."""
        for t_ns, topic, message in sorted(messages, key=lambda m: m[0]):
            self._writer.add_message(self._channels[topic], log_time=t_ns, publish_time=t_ns, data=message)

    def finish(self) -> bytes:
        """The whole file; nothing can be added any more."""
        self._writer.finish()
        return self._stream.getvalue()


def file_of(store: SessionStore, record: TrialRecord) -> Path:
    """The recording of a completed trial; it may have been pruned. Raises UsageError if nothing filmed the trial."""
    folder = store.trial_folder(*record.position)
    if FILE not in record.checksums and not any((folder / name).exists() for name in (FILE, PRUNED)):
        raise UsageError(
            f"session {store.facts.name} has no recordings, because no camera of adaptsim filmed its trials; "
            f"adaptsim report {store.facts.name} shows their trajectories"
        )
    return folder / FILE


def read(path: Path) -> Recording:
    """Read a recording back. Raises SessionError naming the file if it is corrupt or was pruned."""
    if not path.exists() and path.with_name(PRUNED).exists():
        raise SessionError(
            f"{path} was removed with adaptsim sessions prune, to free disk space: the numbers and key moments of this "
            "trial are still there, its recording is not. Restore it from a copy"
        )
    with opened(path) as reader:
        return _read(reader)


@contextmanager
def opened(path: Path) -> Iterator[McapReader]:
    """A reader of an MCAP file that verifies its checksums. Raises SessionError naming the file if it is damaged."""
    try:
        with path.open("rb") as stream:
            yield make_reader(stream, validate_crcs=True)
    except DAMAGED as error:
        raise corrupt(path, str(error)) from error


def require_whole(path: Path) -> None:
    """Raises SessionError if a checksum inside an MCAP file is wrong; other files pass."""
    if path.suffix != ".mcap":
        return
    with opened(path) as reader:
        for _ in chain(reader.iter_attachments(), reader.iter_messages()):
            pass


def _read(reader: McapReader) -> Recording:
    camera = next((json.loads(one.data) for one in reader.iter_attachments() if one.name == "camera.json"), None)
    if camera is None:
        raise SessionError("the recording has no camera.json")
    images: dict[str, dict[int, Future[Any]]] = {topic: {} for topic in _IMAGES}
    joints: dict[str, list[tuple[int, tuple[float, ...]]]] = {topics.MEASURED: [], topics.COMMANDED: []}
    reported = topics.reported(camera.get("measured", ()))  # older recordings have a modelled effort
    types, measured = topics.quantity_types(camera.get("measured", ())), {one.name: list[Any]() for one in reported}
    with ThreadPoolExecutor(max_workers=2) as pool:  # OpenCV releases the interpreter while it decodes
        for schema, channel, message in reader.iter_messages():
            topic = channel.topic
            if topic in images:
                kind = TOPICS[topic] if schema is None else schema.name
                picture = topics.decode(kind, message.data)
                pixels = pool.submit(_pixels if topic in COLOURS else _DEPTHS[kind], picture)
                images[topic][topics.stamp_ns(picture.header)] = pixels
            elif topic in joints:
                state = topics.decode(topics.JOINTS, message.data)
                joints[topic].append((topics.stamp_ns(state.header), tuple(state.position)))
            if topic in types:
                values = topics.decode(types[topic], message.data)
                for one in reported:
                    if one.topic == topic:
                        measured[one.name].append(topics.quantity_values(one, values))
    (before,) = _frames(images[_BEFORE_COLOUR], images[_BEFORE_DEPTH])
    start_s = float(camera["t_start_s"])
    execution = Execution(
        t_start_s=start_s,
        t_s=np.array([_s(t_ns) - start_s for t_ns, _ in joints[topics.MEASURED]]),
        q_commanded_rad=np.array([q for _, q in joints[topics.COMMANDED]]).reshape(-1, 7),
        q_measured_rad=np.array([q for _, q in joints[topics.MEASURED]]).reshape(-1, 7),
        control_success_rate=float(camera["control_success_rate"]),
        measured={one.name: np.array(measured[one.name]).reshape(-1, one.size) for one in reported},
    )
    frames = _frames(images[_COLOUR], images[_DEPTH])
    after = _frames(images[_AFTER_COLOUR], images[_AFTER_DEPTH])
    X_BC = np.array(camera["X_BC"])
    return Recording(before, frames, _camera_model(camera), X_BC, execution, after[0] if after else None)


def _frames(colour: Mapping[int, Future[Bytes]], depth: Mapping[int, Future[Depth]]) -> tuple[Frame, ...]:
    return tuple(Frame(_s(t_ns), colour[t_ns].result(), depth[t_ns].result()) for t_ns in colour)


def _pictures(frames: Sequence[StoredFrame], colour_topic: str, depth_topic: str) -> Iterator[topics.Message]:
    for one in frames:
        t_ns = topics.ns(one.frame.t_s)
        yield t_ns, colour_topic, one.colour
        yield t_ns, depth_topic, one.depth


def encode_jpeg(rgb: Bytes, quality: int) -> bytes:
    """(H, W, 3) RGB as JPEG."""
    return encode_image(rgb[..., ::-1], ".jpg", quality)


def _pixels(message: Any) -> Bytes:
    """The colours of a decoded CompressedImage."""
    return np.ascontiguousarray(decode_image(message.data, cv2.IMREAD_COLOR)[..., ::-1], np.uint8)


def _depth_mm(message: Any) -> Depth:
    """The depth of a decoded Image. Raises ValueError for another encoding, or another length than stated."""
    if message.encoding != "16UC1":
        raise ValueError(f"a depth image of encoding {message.encoding!r}")
    return np.frombuffer(message.data, "<u2").reshape(message.height, message.width).astype(np.uint16)


def _compressed_depth_mm(message: Any) -> Depth:
    """The depth of a decoded CompressedImage, as sessions of formats 1 and 2 have it. Raises ValueError."""
    depth_mm = decode_image(message.data, cv2.IMREAD_UNCHANGED)
    if depth_mm.dtype != np.uint16 or depth_mm.ndim != 2:
        raise ValueError("a compressed depth image that is not of 16 bits")
    return np.asarray(depth_mm, np.uint16)


_DEPTHS = {topics.DEPTH: _depth_mm, topics.PICTURE: _compressed_depth_mm}
"""Message type -> reader of a depth image."""


def _s(t_ns: int) -> float:
    return t_ns * 1e-9


def _camera_json(model: CameraModel, X_BC: Array, execution: Execution, camera_late_s: float) -> bytes:
    def intrinsics(i: Intrinsics) -> dict[str, object]:
        return {"width": i.width, "height": i.height, "K": i.K.tolist(), "distortion": i.distortion.tolist()}

    content = {
        "serial": model.serial,
        "colour": intrinsics(model.colour),
        "depth": intrinsics(model.depth),
        "X_CD": model.X_CD.tolist(),
        "X_BC": np.asarray(X_BC).tolist(),
        "camera_late_s": camera_late_s,
        "t_start_s": execution.t_start_s,
        "control_success_rate": execution.control_success_rate,
        "measured": list(execution.measured),
    }
    return json.dumps(content).encode()


def _camera_model(camera: dict[str, object]) -> CameraModel:
    def intrinsics(raw: object) -> Intrinsics:
        if not isinstance(raw, dict):
            raise ValueError("camera.json has no intrinsics")
        return Intrinsics(int(raw["width"]), int(raw["height"]), np.array(raw["K"]), np.array(raw["distortion"]))

    X_CD = np.array(camera["X_CD"], dtype=np.float64)
    return CameraModel(str(camera["serial"]), intrinsics(camera["colour"]), intrinsics(camera["depth"]), X_CD)
