"""The process that speaks to the camera: `python -m hw.camera.served`. A driver that hangs hangs here alone.

It ends with the program: at once if idle, within a second if the driver blocks it.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from multiprocessing.connection import Connection

from hw.camera.grabber import Film
from hw.camera.k4a import LiveCamera
from hw.camera.messages import (
    Failed,
    Open,
    Opened,
    Recorded,
    Request,
    Snapshot,
    Started,
    StartRecording,
    Step,
    StopRecording,
)
from hw.camera.realsense import RealSenseDevice
from hw.errors import CameraError, DeviceUnavailable

ORPHAN_S = 1.0
"""How long a driver may block the process after the program has ended."""

Make = Callable[[Open], LiveCamera]


def kinect(asked: Open) -> LiveCamera:
    """The camera that is plugged in."""
    return LiveCamera(asked.serial, asked.settings, infrared=asked.infrared, latency_s=asked.latency_s)


def realsense(asked: Open) -> LiveCamera:
    """The RealSense that is plugged in."""
    return LiveCamera(
        asked.serial, asked.settings, infrared=asked.infrared, latency_s=asked.latency_s, device=RealSenseDevice
    )


def serve(program: Connection, make: Make) -> None:
    """Answer requests until the program hangs up."""
    camera: LiveCamera | None = None
    try:
        with suppress(EOFError, OSError):
            while True:
                request: Request = program.recv()
                try:
                    if isinstance(request, Open):
                        camera = make(request)
                        camera.connect(lambda doing: program.send(Step(doing)))
                        program.send(Opened(camera.model(), camera.settings, camera.facts()))
                    elif camera is None:
                        program.send(Failed("the camera is not connected", unavailable=True))
                    else:
                        _answer(program, camera, request)
                except (CameraError, DeviceUnavailable) as error:
                    program.send(Failed(str(error), isinstance(error, DeviceUnavailable)))
    finally:
        if camera is not None:
            camera.__exit__()


def _answer(program: Connection, camera: LiveCamera, request: Request) -> None:
    if isinstance(request, Snapshot):
        program.send(camera.shot())
    elif isinstance(request, StartRecording):
        camera.start_recording()
        program.send(Started())
    elif isinstance(request, StopRecording):
        film: Film = camera.end_film()
        facts = camera.facts()
        program.send(Recorded(len(film.shots), film.dropped, film.longest_gap_s, film.clock, facts))
        for one in film.shots:
            program.send(one)


def end_with(pipe: int) -> None:
    """End this process soon after the program has closed its end of the pipe, even if a driver blocks."""

    def watch() -> None:
        with suppress(OSError):
            while os.read(pipe, 64):
                pass
        threading.Event().wait(ORPHAN_S)
        os._exit(1)

    threading.Thread(target=watch, name="program", daemon=True).start()


def main(connection_fd: str, pipe_fd: str, maker: str) -> None:
    """Serve one program; the arguments are two file descriptors and the camera's maker as module:function."""
    end_with(int(pipe_fd))
    module, _, name = maker.partition(":")
    with Connection(int(connection_fd)) as program:
        serve(program, getattr(import_module(module), name))


if __name__ == "__main__":
    main(*sys.argv[1:])
