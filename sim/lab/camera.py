"""The lab's rendered RGB-D camera, as `hw.ports.Camera`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Self, overload

import numpy as np

from hw.errors import CameraError, DeviceUnavailable
from hw.types import Array, CameraModel, Frame
from sim.lab.chance import camera_stream
from sim.lab.kinect import EXPOSURE_S, SensorNoise, kinect_model
from sim.lab.room import Room
from sim.render.poses import held_still
from sim.render.served import Moment, Picture, Scene
from sim.render.studio import ProcessStudio, Studio, ThreadStudio

FRAME_RATE_HZ = 30.0
SLICES = 4  # per exposure
STILL_S = 0.3  # duration of a recording without any motion
MOST_PROCESSES = 4  # that render; each takes 0.6 GB


class _Film(Sequence[Frame]):
    """Frames that may still be rendering: reading one waits until it is ready."""

    def __init__(self, times_s: Sequence[float], pictures: Sequence[Future[Picture]]) -> None:
        self._times_s, self._pictures = times_s, pictures

    def __len__(self) -> int:
        return len(self._pictures)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | Sequence[Frame]:
        if isinstance(index, slice):
            return _Film(self._times_s[index], self._pictures[index])
        return Frame(self._times_s[index], *self._pictures[index].result())


class LabCamera:
    """A camera at `X_BC`, 30 FPS. The frames of a recording are rendered once it has ended."""

    def __init__(self, room: Room, X_BC: Array) -> None:
        self._room, self._X_BC = room, X_BC
        self._studio: Studio | None = None

    def __enter__(self) -> Self:
        if self._studio is None:
            self._studio = self._started()
        return self

    def __exit__(self, *exc: object) -> None:
        if self._studio is not None:
            self._studio.close(finish=not any(exc))
            self._studio = None
        self._room.recording_since_s, self._room.shots = None, []

    def model(self) -> CameraModel:
        """See `hw.ports.Camera`."""
        return kinect_model("small" if self._room.world.sensing.camera == "small" else "kinect")

    def snapshot(self) -> Frame:
        """See `hw.ports.Camera`."""
        room = self._room
        poses = room.cell.poses(room.cell.positions[None])
        picture = self._connected().render(Moment(poses, room.chance.snapshot_stream(room.t_s)))
        return Frame(self._stamped(room.t_s), *picture.result())

    def start_recording(self) -> None:
        """See `hw.ports.Camera`."""
        self._connected()
        if self._room.recording_since_s is not None:
            raise CameraError("the camera is recording already: call stop_recording first")
        self._room.recording_since_s, self._room.shots = self._room.t_s, []

    def stop_recording(self) -> Sequence[Frame]:
        """See `hw.ports.Camera`. The frames are rendered in the background from here on, while the lab goes on."""
        studio, room = self._connected(), self._room
        if room.recording_since_s is None:
            raise CameraError("the camera is not recording: call start_recording first")
        since_s = room.recording_since_s
        if room.t_s == since_s:
            room.wait(STILL_S)
        try:
            if "camera_timeout" in room.faults_due:
                room.faults_due.remove("camera_timeout")
                raise CameraError("no frame within 1 s; check the camera's cable and power, then redo the trial")
            numbers = [i for i in self._numbers(since_s) if not self._dropped(i)]
            return self._film(studio, numbers)
        finally:
            room.recording_since_s, room.shots = None, []

    def _numbers(self, since_s: float) -> range:
        """The numbers of frames exposed during the recording, counted from the placing of the object."""
        room, half_s = self._room, EXPOSURE_S / 2
        first, last = ((t_s - room.t_placed_s) * FRAME_RATE_HZ for t_s in (since_s + half_s, room.t_s - half_s))
        phase = room.chance.frame_phase
        return range(int(np.ceil(first - phase)), int(np.floor(last - phase)) + 1)

    def _dropped(self, number: int) -> bool:
        return bool(self._room.chance.frame_stream(number).uniform() < self._room.world.sensing.frame_drop)

    def _time_s(self, number: int) -> float:
        return self._room.t_placed_s + (number + self._room.chance.frame_phase) / FRAME_RATE_HZ

    def _poses(self, numbers: Sequence[int]) -> list[Mapping[str, Array]]:
        """For each frame, the poses (SLICES, 4, 4) of all visible bodies over the exposure."""
        slices_s = EXPOSURE_S * ((np.arange(SLICES) + 0.5) / SLICES - 0.5)
        times_s = np.add.outer([self._time_s(i) for i in numbers], slices_s).ravel()
        poses = self._room.cell.poses(self._room.positions_at(times_s))
        held = {name: held_still(X).reshape(len(numbers), SLICES, 4, 4) for name, X in poses.items()}
        return [{name: X[i] for name, X in held.items()} for i in range(len(numbers))]

    def _film(self, studio: Studio, numbers: Sequence[int]) -> Sequence[Frame]:
        return _Film(
            [self._stamped(self._time_s(i)) for i in numbers],
            [
                studio.render(Moment(poses, self._room.chance.frame_stream(i)))
                for i, poses in zip(numbers, self._poses(numbers), strict=True)
            ],
        )

    def _stamped(self, t_s: float) -> float:
        """A time of the arm's clock on the camera's own clock."""
        return t_s + 1e-3 * self._room.world.sensing.clock_offset_ms

    def _started(self) -> Studio:
        if self._room.world.sensing.camera == "small":
            return ThreadStudio(self._scene)  # such a film is ready before a process has started
        return ProcessStudio(self._scene(), min(os.cpu_count() or 1, MOST_PROCESSES))

    def _scene(self) -> Scene:
        room = self._room
        noise = SensorNoise.draw(camera_stream(room.seed), room.world.sensing.depth_noise_scale)
        return Scene(self.model(), self._X_BC, room.cell.visuals, noise)

    def _connected(self) -> Studio:
        if self._studio is None:
            raise DeviceUnavailable("the lab's camera is not connected: use it inside a `with` block")
        return self._studio
