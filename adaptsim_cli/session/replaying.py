"""A completed trial whole: as one MCAP file with everything, in the Rerun viewer with the moving arm, or as a video.

A recording is stored before it is tracked and never edited. So these files are made on request, from the recording and
the trial's record.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from adaptsim_cli.bench.rig import Image, Recording
from adaptsim_cli.errors import SessionError
from adaptsim_cli.session import recording, topics
from adaptsim_cli.session.film import draw_way, way_px, write
from adaptsim_cli.session.records import SessionFacts, TrialRecord
from adaptsim_cli.session.retracking import tool_poses
from adaptsim_cli.session.store import SessionStore
from hw.extras import missing
from hw.joint_limits import LIMITS
from hw.types import Array
from sim.errors import ExtraMissing
from sim.panda.shapes import PRIMITIVES, mesh

REAL_ARMS = tuple(LIMITS)


@dataclass(frozen=True, eq=False)
class WholeTrial:
    """A completed trial with its recording read."""

    facts: SessionFacts
    record: TrialRecord
    stored: Recording
    file: Path

    @property
    def start_s(self) -> float:
        """Arm clock at the start of the tool's motion."""
        return self.stored.execution.t_start_s

    @property
    def arm(self) -> str:
        """The model of the arm; the simulated lab has a Panda."""
        return self.facts.hw if self.facts.hw in REAL_ARMS else "panda"

    @property
    def title(self) -> str:
        """Title of a file or a viewer's window."""
        return f"{self.facts.name}-trial-{self.record.trial:03d}"

    def events(self) -> Iterator[tuple[float, str, bool]]:
        """The events in time order: (arm clock in s, event, whether it is a warning)."""
        record, start_s = self.record, self.start_s
        yield self.stored.before.t_s, f"the {self.facts.object_name} was detected", False
        yield start_s, "the motion started", False
        for moment in record.moments:
            yield start_s + moment.t_s, f"key moment: {moment.label}", False
        end_s = start_s + record.track.t_s[-1]
        for flag in record.track.flags:
            yield end_s, flag, True
        yield (
            end_s,
            f"outcome: {record.outcome_words}, reward {record.reward:.2f}, predicted {record.predicted_reward:.2f}",
            False,
        )
        if record.overruled_from is not None:
            yield end_s, f"the operator set the outcome; tracked: {record.overruled_from.value}", True

    def outcome(self) -> dict[str, object]:
        """The trial's result, by name, in units."""
        shown = {"outcome", "reward", "predicted_reward", "context", "action"}
        return self.record.model_dump(mode="json", include=shown)

    def metadata(self) -> dict[str, str]:
        """The file's metadata for a viewer."""
        facts, record = self.facts, self.record
        units = {d.name: d.unit for space in (facts.context, facts.action, facts.parameters) for d in space if d.unit}
        return {
            "task": facts.task,
            "title": facts.title,
            "session": facts.name,
            "hardware": "recorded trials" if facts.recorded else "simulated lab" if facts.world else facts.hw,
            "world": facts.world,
            "method": facts.method,
            "seed": str(facts.seed),
            "iteration": str(record.iteration),
            "trial": str(record.trial),
            "attempt": str(record.attempt),
            "started": record.started,
            "units": ", ".join(f"{name} in {unit}" for name, unit in units.items()),
            "velocity": "differentiated from the positions",
            **{one.name: one.meaning for one in topics.reported(self.stored.execution.measured)},
        }


def open_trial(store: SessionStore, record: TrialRecord) -> WholeTrial:
    """Read a trial. Raises UsageError if nothing filmed it, SessionError if its recording is pruned or corrupt."""
    file = recording.file_of(store, record)
    return WholeTrial(store.facts, record, recording.read(file), file)


def encode(trial: WholeTrial) -> bytes:
    """The whole file in memory. Colour images stay bit-identical. Raises SessionError."""
    stored, track = trial.stored, trial.record.track.track()
    played, times_s = stored.execution, [frame.t_s for frame in stored.frames]
    start_ns = round(stored.before.t_s * 1e9)
    messages = [
        *_colours(trial.file),
        *recording.depths(stored),
        *topics.cameras(stored.model, start_ns),
        topics.description(trial.arm, start_ns),
        *topics.joints(played),
        *topics.transforms(times_s, played, tool_poses(trial.file), stored.model, stored.X_BC),
        *recording.track_messages(track, played.t_start_s),
        *(topics.event(t_s, text, is_warning=warns) for t_s, text, warns in trial.events()),
        topics.outcome(played.t_start_s + float(track.t_s[-1]), trial.outcome()),
    ]
    types = {**topics.quantity_types(played.measured), **recording.TOPICS, **topics.AFTERWARDS}
    return recording.as_mcap(types, messages, {}, trial.metadata())


def jpegs(trial: WholeTrial) -> list[tuple[float, bytes]]:
    """(arm clock in s, JPEG) of every image of the motion, as it is stored. Raises SessionError."""
    pictures = []
    for t_ns, topic, message in _colours(trial.file):
        if topic == recording.COLOURS[0]:
            pictures.append((1e-9 * t_ns, topics.decode(topics.PICTURE, message).data))
    return pictures


def _colours(file: Path) -> list[topics.Message]:
    """The colour images as they are stored."""
    with recording.opened(file) as reader:
        messages = reader.iter_messages(topics=list(recording.COLOURS))
        return [
            (message.log_time, channel.topic, message.data)  # the log time is the stamp, as we write it
            for _, channel, message in messages
        ]


TIMELINE = "arm_clock"
CAMERA, DEPTH = "base/camera", "base/camera/depth_camera"


def rerun_file(trial: WholeTrial) -> bytes:
    """The whole file in memory. Raises ExtraMissing without rerun-sdk, SessionError."""
    rr = _rerun()
    stream = rr.RecordingStream("adaptsim", recording_id=trial.title)
    memory = stream.memory_recording()
    stream.send_recording_name(trial.title)
    stream.log("about", rr.TextDocument(_about(trial), media_type="text/markdown"), static=True)
    _scene(rr, stream, trial)
    _motion(rr, stream, trial)
    _story(rr, stream, trial)
    stream.flush()
    return bytes(memory.drain_as_bytes())


def _rerun() -> Any:
    try:
        import rerun
    except ImportError as error:
        raise ExtraMissing(missing("this", "rerun-sdk", "rerun")) from error
    return rerun


def _scene(rr: Any, stream: Any, trial: WholeTrial) -> None:
    """The static parts: cameras, table, shapes of the links."""
    model = trial.stored.model
    stream.log("base", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for entity, X, camera in ((CAMERA, trial.stored.X_BC, model.colour), (DEPTH, model.X_CD, model.depth)):
        stream.log(entity, rr.Transform3D(translation=X[:3, 3], mat3x3=X[:3, :3]), static=True)
        stream.log(
            f"{entity}/image",
            rr.Pinhole(image_from_camera=camera.K, resolution=[camera.width, camera.height]),
            static=True,
        )
    stream.log("base/table", rr.Boxes3D(centers=[[0.5, 0.0, -0.01]], half_sizes=[[0.5, 0.5, 0.01]]), static=True)
    for index, primitive in enumerate(PRIMITIVES):
        vertices, triangles = mesh(primitive)
        colour = (*(round(255 * part) for part in primitive.rgb), 255)
        shape = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=colour)
        stream.log(f"base/{primitive.link}/shape-{index}", shape, static=True)


def _motion(rr: Any, stream: Any, trial: WholeTrial) -> None:
    """Images, the links, the tool and the joints over time."""
    played, tool_at = trial.stored.execution, tool_poses(trial.file)
    q_at = played.q_at
    for t_s, jpeg in jpegs(trial):
        _set_time(stream, t_s)
        stream.log(f"{CAMERA}/image", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))
    for frame in trial.stored.frames:
        _set_time(stream, frame.t_s)
        stream.log(f"{DEPTH}/image", rr.DepthImage(frame.depth_mm, meter=1000.0))
        for name, X in topics.link_frames(q_at(frame.t_s)):
            stream.log(f"base/{name}", _pose(rr, X))
        stream.log("base/tool", _pose(rr, tool_at(frame.t_s)), rr.TransformAxes3D(0.05))
    for i in range(0, len(played.t_s), 10):
        _set_time(stream, played.t_start_s + float(played.t_s[i]))
        stream.log("joints/measured", rr.Scalars(played.q_measured_rad[i]))
        for quantity in topics.reported(played.measured):
            stream.log(quantity.name, rr.Scalars(played.measured[quantity.name][i]))


def _story(rr: Any, stream: Any, trial: WholeTrial) -> None:
    """The track and the events."""
    track = trial.record.track.track()
    stream.log("base/track", rr.LineStrips3D([track.state[:, :3]], colors=[(255, 190, 40)]), static=True)
    for t_s, state in zip(track.t_s, track.state, strict=True):
        _set_time(stream, trial.start_s + float(t_s))
        stream.log("base/object", rr.Points3D([state[:3]], radii=[0.008], colors=[(255, 190, 40)]))
    for t_s, text, warns in trial.events():
        _set_time(stream, t_s)
        stream.log("events", rr.TextLog(text, level="WARN" if warns else "INFO"))


def _set_time(stream: Any, t_s: float) -> None:
    stream.set_time(TIMELINE, duration=t_s)


def _pose(rr: Any, X: Array) -> Any:
    return rr.Transform3D(translation=X[:3, 3], mat3x3=X[:3, :3])


def _about(trial: WholeTrial) -> str:
    facts = {**trial.metadata(), **{name: str(value) for name, value in trial.outcome().items()}}
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in facts.items() if value)])


VIDEO = ".webm"
_HEIGHT_PX, _FPS = 540, 30.0
_RING_PX = 9


def video(trial: WholeTrial) -> bytes:
    """The whole video in memory, at the speed of the camera. Raises SessionError without frames or an encoder."""
    if not trial.stored.frames:
        raise SessionError(f"{trial.file} holds no frames of the motion")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"video{VIDEO}"
        first = trial.stored.frames[0].colour
        size = (round(first.shape[1] * _HEIGHT_PX / first.shape[0]) // 2 * 2, _HEIGHT_PX)
        with _silent():  # OpenCV warns of the only tag that it takes for VP8
            writer = cv2.VideoWriter(os.fspath(file), cv2.VideoWriter.fourcc(*"VP80"), _fps(trial), size)
        if not writer.isOpened():
            raise SessionError("OpenCV has no VP8 encoder here, so no video can be written: try --rerun")
        try:
            for picture in _pictures(trial, size):
                writer.write(picture)
        finally:
            writer.release()
        return file.read_bytes()


def _pictures(trial: WholeTrial, size: tuple[int, int]) -> list[Image]:
    images, stored, track = list[Image](), trial.stored, trial.record.track.track()
    scale = size[1] / stored.frames[0].colour.shape[0]
    for frame in stored.frames:
        picture = np.array(cv2.resize(frame.colour, size, interpolation=cv2.INTER_AREA), np.uint8)
        since_s = frame.t_s - trial.start_s
        if track.t_s[0] <= since_s:
            draw_way(picture, scale * way_px(stored.model, stored.X_BC, track, since_s), _RING_PX)
        text = f"{since_s:5.2f} s"
        if since_s >= track.t_s[-1]:
            text += f"   {trial.record.outcome_words}, reward {trial.record.reward:.2f}"
        write(picture, text, (14, size[1] - 16), 0.7)
        images.append(np.ascontiguousarray(picture[..., ::-1]))
    return images


@contextmanager
def _silent() -> Iterator[None]:
    """Discard what libraries write to stderr."""
    descriptor = os.dup(2)
    with Path(os.devnull).open("wb") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(descriptor, 2)
        os.close(descriptor)


def _fps(trial: WholeTrial) -> float:
    times_s = np.array([frame.t_s for frame in trial.stored.frames])
    return float(1.0 / np.median(np.diff(times_s))) if len(times_s) > 1 else _FPS
