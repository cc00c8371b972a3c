"""The lab's rendered RGB-D camera, as `hw.ports.Camera`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from typing import Self, overload

import numpy as np

from hw.errors import CameraError, DeviceUnavailable
from hw.types import Array, CameraModel, Frame
from sim.lab.chance import camera_stream
from sim.lab.kinect import EXPOSURE_S, Renderer, SensorNoise, kinect_model
from sim.lab.room import Room
from sim.render.poses import held_still

FRAME_RATE_HZ = 30.0
SLICES = 4  # per exposure
STILL_S = 0.3  # duration of a recording without any motion


class _Film(Sequence[Frame]):
    """Frames that may still be rendering: reading one waits until it is ready."""

    def __init__(self, frames: Sequence[Future[Frame]]) -> None:
        self._frames = frames

    def __len__(self) -> int:
        return len(self._frames)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | Sequence[Frame]:
        return _Film(self._frames[index]) if isinstance(index, slice) else self._frames[index].result()


class LabCamera:
    """A camera at `X_BC`, 30 FPS. The frames of a recording are rendered once it has ended."""

    def __init__(self, room: Room, X_BC: Array) -> None:
        self._room, self._X_BC = room, X_BC
        self._connected = False

    def __enter__(self) -> Self:
        self._connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self._connected = False
        self._room.recording_since_s, self._room.shots = None, []

    def model(self) -> CameraModel:
        """See `hw.ports.Camera`."""
        return kinect_model("small" if self._room.world.sensing.camera == "small" else "kinect")

    def snapshot(self) -> Frame:
        """See `hw.ports.Camera`."""
        self._need_connection()
        room = self._room
        poses = room.cell.poses(room.cell.positions[None])
        colour, depth_mm = self._renderer.render(poses, self._noise, room.chance.snapshot_stream(room.t_s))
        return Frame(self._stamped(room.t_s), colour, depth_mm)

    def start_recording(self) -> None:
        """See `hw.ports.Camera`."""
        self._need_connection()
        if self._room.recording_since_s is not None:
            raise CameraError("the camera is recording already: call stop_recording first")
        self._room.recording_since_s, self._room.shots = self._room.t_s, []

    def stop_recording(self) -> Sequence[Frame]:
        """See `hw.ports.Camera`. The frames are rendered in the background from here on, while the lab goes on."""
        self._need_connection()
        room = self._room
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
            return self._film(numbers)
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

    def _film(self, numbers: Sequence[int]) -> Sequence[Frame]:
        renderer, noise, pool = self._renderer, self._noise, ThreadPoolExecutor(os.cpu_count())

        def frame(t_s: float, poses: Mapping[str, Array], rng: np.random.Generator) -> Frame:
            return Frame(t_s, *renderer.render(poses, noise, rng))

        film = [
            pool.submit(frame, self._stamped(self._time_s(i)), poses, self._room.chance.frame_stream(i))
            for i, poses in zip(numbers, self._poses(numbers), strict=True)
        ]
        pool.shutdown(wait=False)
        return _Film(film)

    def _stamped(self, t_s: float) -> float:
        """A time of the arm's clock on the camera's own clock."""
        return t_s + 1e-3 * self._room.world.sensing.clock_offset_ms

    @cached_property
    def _renderer(self) -> Renderer:
        return Renderer(self.model(), self._X_BC, self._room.cell.visuals)

    @cached_property
    def _noise(self) -> SensorNoise:
        return SensorNoise.draw(camera_stream(self._room.seed), self._room.world.sensing.depth_noise_scale)

    def _need_connection(self) -> None:
        if not self._connected:
            raise DeviceUnavailable("the lab's camera is not connected: use it inside a `with` block")
