"""The process that speaks to the camera: `python -m hw.camera.served`. A driver that hangs hangs here alone.

It ends with the program: at once if idle, within a second if the driver blocks it.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from multiprocessing.connection import Connection

from hw.camera.k4a import KinectCamera
from hw.child import Call
from hw.errors import CameraError, DeviceUnavailable

ORPHAN_S = 1.0
"""How long a driver may block the process after the program has ended."""

CONNECT, END_FILM = "connect", "end_film"
"""The two calls with answers of their own: the steps of connecting (text), then (model, facts); and (number of images,
`Film` without them, facts), then each image. Others are methods of `KinectCamera`. An answer may be an error instead.
"""


def serve(program: Connection, make: Callable[..., KinectCamera]) -> None:
    """Answer calls until the program hangs up; `make` takes the arguments of `KinectCamera`."""
    camera: KinectCamera | None = None
    try:
        with suppress(EOFError, OSError):
            while True:
                call: Call = program.recv()
                try:
                    if call.method == CONNECT:
                        serial, settings, infrared, latency_s = call.arguments
                        camera = make(serial, settings, infrared=infrared, latency_s=latency_s)
                        camera.connect(program.send)
                        program.send((camera.model(), camera.facts()))
                    elif camera is None:
                        program.send(DeviceUnavailable("the camera is not connected"))
                    elif call.method == END_FILM:
                        film = camera.end_film()
                        program.send((len(film.shots), replace(film, shots=()), camera.facts()))
                        for shot in film.shots:
                            program.send(shot)
                    else:
                        program.send(getattr(camera, call.method)(*call.arguments))
                except (CameraError, DeviceUnavailable) as error:
                    program.send(error)
    finally:
        if camera is not None:
            camera.__exit__()


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
