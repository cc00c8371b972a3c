"""The lab's rendered RGB-D camera, as `hw.ports.Camera`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hw.computer import usable_cores
from hw.errors import CameraError, DeviceUnavailable
from hw.types import Array, CameraModel, Frame
from sim.lab.film import Filming
from sim.lab.kinect import kinect_model
from sim.lab.rng_streams import camera_stream
from sim.lab.room import Room
from sim.render.pool import Picture, ProcessPool, RenderPool, Scene, ThreadPool
from sim.render.sensor import SensorNoise

STILL_S = 0.3  # duration of a recording without any motion
MOST_PROCESSES = 2  # that render; each takes 0.4 GB


class LabCamera:
    """A camera at `X_BC`, 30 FPS. The frames of a recording are rendered in the background."""

    def __init__(self, room: Room, X_BC: Array, pool: Callable[[Scene], RenderPool] | None = None) -> None:
        """`pool` starts what renders a scene; None: processes of this computer."""
        self._room, self._X_BC, self._pool = room, X_BC, pool
        self._studio: RenderPool | None = None
        self._latest: list[Sequence[Future[Picture]]] = []  # the latest single picture, and the recording after it

    def __enter__(self) -> Self:
        if self._studio is None:
            self._studio = self._started()
        return self

    def __exit__(self, *exc: object) -> None:
        if self._studio is not None:
            self._studio.close(finish=not any(exc))
            self._studio = None
        self._room.filming, self._latest = None, []

    def model(self) -> CameraModel:
        """See `hw.ports.Camera`."""
        return kinect_model(self._room.world.sensing.camera)

    def snapshot(self) -> Frame:
        """See `hw.ports.Camera`."""
        room = self._room
        poses = room.cell.poses(room.cell.positions[None])
        picture = self._connected().render(poses, room.chance.snapshot_stream(room.t_s))
        self._latest = [(picture,)]
        return Frame(room.world.sensing.stamped(room.t_s), *picture.result())

    def start_recording(self) -> None:
        """See `hw.ports.Camera`."""
        studio, room = self._connected(), self._room
        if room.filming is not None:
            raise CameraError("the camera is recording already: call stop_recording first")
        room.filming = Filming(studio, room.cell, room.world.sensing, room.chance, room.t_placed_s, room.t_s)
        self._latest = [*self._latest[:1], room.filming.pictures]

    def stop_recording(self) -> Sequence[Frame]:
        """See `hw.ports.Camera`. Some frames are still rendered afterwards, while the lab continues."""
        self._connected()
        room, filming = self._room, self._room.filming
        if filming is None:
            raise CameraError("the camera is not recording: call start_recording first")
        if room.t_s == filming.since_s:
            room.wait(STILL_S)
        room.filming = None
        if room.fault_comes("camera_timeout"):
            raise CameraError("no frame within 1 s; check the camera's cable and power, then redo the trial")
        return filming.film()

    def newest(self) -> NDArray[np.uint8] | None:
        """See `hw.ports.Camera`: the latest that is rendered. It renders nothing itself: no random number changes."""
        for picture in (one for pictures in reversed(self._latest) for one in reversed(pictures)):
            if picture.done() and not picture.cancelled() and picture.exception() is None:
                return picture.result()[0]
        return None

    def _started(self) -> RenderPool:
        if self._pool is not None:
            return self._pool(self._scene())
        if self._room.world.sensing.camera == "small":
            return ThreadPool(self._scene)  # such a film is ready before a process has started
        return ProcessPool(self._scene(), min(usable_cores(), MOST_PROCESSES))

    def _scene(self) -> Scene:
        room = self._room
        noise = SensorNoise.draw(camera_stream(room.seed), room.world.sensing.depth_noise_scale)
        return Scene(self.model(), self._X_BC, room.cell.visuals, noise)

    def _connected(self) -> RenderPool:
        if self._studio is None:
            raise DeviceUnavailable("the lab's camera is not connected: use it inside a `with` block")
        return self._studio
