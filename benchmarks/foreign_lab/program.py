"""The `adaptsim` program in the foreign lab: its camera has another driver, and no real-time kernel is required.

    python program.py FOLDER run-iteration --hw fr3 ...

The arm and its hand are reached as a real FR3's are: with the maker's library, over the network.
"""

from __future__ import annotations

import json
import socket
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.bench.devices import drivers
from adaptsim_cli.commands import app
from hw.errors import DeviceUnavailable
from hw.franka.arm import FrankaArm, franka
from hw.franka.playback import Timing
from hw.types import CameraModel, Frame, Intrinsics
from hw.workcell import Workcell

PATIENT = Timing(realtime=False, silence_s=5.0, start_s=60.0, unwatched_s=60.0, overrun_s=600.0)


class SocketCamera:
    """`hw.ports.Camera` behind the socket of the foreign lab."""

    def __init__(self, path: Path, *, infrared: bool) -> None:
        self._path, self._infrared = path, infrared
        self._file: Any = None
        self._model: CameraModel | None = None

    def __enter__(self) -> Self:
        line = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            line.connect(str(self._path))
        except OSError as error:
            raise DeviceUnavailable(f"the camera at {self._path} does not answer ({error})") from error
        self._file = line.makefile("rwb")
        line.close()
        told = self._ask("model")
        colour, depth = (Intrinsics(t["width"], t["height"], np.array(t["K"])) for t in (told["colour"], told["depth"]))
        self._model = CameraModel(told["serial"], colour, depth, np.array(told["X_CD"]))
        return self

    def __exit__(self, *exc: object) -> None:
        self._file.close()
        self._file = None

    def model(self) -> CameraModel:
        if self._model is None:
            raise DeviceUnavailable("the camera is not connected: use it inside a `with` block")
        return self._model

    def snapshot(self) -> Frame:
        return self._frames("snapshot")[0]

    def start_recording(self) -> None:
        self._ask("start")

    def stop_recording(self) -> Sequence[Frame]:
        return self._frames("stop")

    def newest(self) -> NDArray[np.uint8] | None:
        return None  # its socket answers one question at a time

    def _ask(self, what: str) -> Any:
        if self._file is None:
            raise DeviceUnavailable("the camera is not connected: use it inside a `with` block")
        self._file.write(json.dumps({"do": what, "infrared": self._infrared}).encode() + b"\n")
        self._file.flush()
        return json.loads(self._file.readline())

    def _frames(self, what: str) -> list[Frame]:
        return [self._frame(head) for head in self._ask(what)]

    def _frame(self, head: dict[str, Any]) -> Frame:
        size = (self.model().depth.height, self.model().depth.width)
        bgr = cv2.imdecode(np.frombuffer(self._file.read(head["jpeg"]), np.uint8), cv2.IMREAD_COLOR)
        assert bgr is not None
        depth = np.frombuffer(self._file.read(head["depth"]), "<u2").reshape(size).astype(np.uint16)
        grey = self._file.read(head["infrared"])
        infrared = np.frombuffer(grey, "<u2").reshape(size).astype(np.uint16) if grey else None
        return Frame(head["t"], np.ascontiguousarray(bgr[..., ::-1]), depth, infrared)


def main(folder: str, *arguments: str) -> int:
    def arm(cell: Workcell, settings: Any, pedal: Any) -> FrankaArm:
        return franka(cell, settings, PATIENT, pedal=pedal)

    def camera(part: Any, infrared: bool) -> SocketCamera:
        return SocketCamera(Path(folder) / "camera.sock", infrared=infrared)

    devices = replace(drivers.makers_drivers(), arm=arm, camera=camera)
    drivers.makers_drivers = lambda: devices
    return app.run(arguments)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
