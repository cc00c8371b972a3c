"""A live camera behind `hw.ports.Camera`, in a process of its own (`hw.camera.served`): every answer has a deadline.

Colour and depth at 30 FPS, exposed together, with the device's own time, which is mapped to the arm's clock (the host's
monotonic clock).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from threading import RLock
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hw.camera.grabber import CameraRecording, TimedCapture, decode_jpeg
from hw.camera.k4a_device import ColourSettings
from hw.camera.served import END_FILM, OPEN
from hw.child import Call, Child, ChildGone
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame

ANSWER_S = 3.0
"""The longest silence of a running camera. While it connects, a message reports such a silence."""
STEP_S = 20.0
"""The longest time for one step of connecting: the library, the depth engine, the first images."""
MOST_LOST = 0.25
"""A recording that misses a larger share of its images is refused: it shows too little of the motion."""
_END_S = 1.0

_log = logging.getLogger(__name__)


def served(make: str) -> Callable[[], Child]:
    """Starts the process of a camera; `make` is its `hw.camera.served.Make` as module:function."""
    return partial(Child, "hw.camera.served", make, end_s=_END_S)


KINECT = served("hw.camera.served:kinect")


class CameraProcess:
    """The camera with a serial number, or the only one of its kind.

    Entering starts the process and connects. A process that hangs is ended; entering again starts another.
    """

    def __init__(
        self,
        serial: str | None = None,
        settings: ColourSettings | None = None,
        *,
        infrared: bool = False,
        latency_s: float = 0.0,
        start: Callable[[], Child] = KINECT,
        answer_s: float = ANSWER_S,
        step_s: float = STEP_S,
    ) -> None:
        """`start` starts the process of a kind of camera.

        `latency_s` is the time from the end of an exposure to its arrival at the host, as the calibration's swing
        measures it; half of the exposure is known and subtracted automatically. With `infrared` every frame carries
        the depth camera's infrared image, for calibrating. Raises ValueError.
        """
        if latency_s < 0.0:
            raise ValueError(f"a camera latency of {latency_s:g} s: it must be 0 or more")
        self._asked = Call(OPEN, (serial, settings or ColourSettings(), infrared, latency_s))
        self._start, self._answer_s, self._step_s = start, answer_s, step_s
        self._child: Child | None = None
        self._model: CameraModel | None = None
        self._facts: dict[str, Any] = {}
        self._ended = ""  # why the process ended
        self._film: CameraRecording | None = None
        self._line = RLock()  # one question at a time; `newest` is asked from other threads

    def __enter__(self) -> Self:
        """Raises DeviceUnavailable without library or camera, CameraError if the camera does not start."""
        with self._line:
            self._ended = ""
            self._child = self._start()
            try:
                self._send(self._asked)
                self._model, self._facts = self._connecting(self._child)
            except BaseException:
                self.__exit__()
                raise
        return self

    def __exit__(self, *exc: object) -> None:
        if self._child is not None:
            self._child.close()
            self._child = None

    def model(self) -> CameraModel:
        """The factory calibration, known once the camera was entered. Raises DeviceUnavailable before that."""
        if self._model is None:
            raise _closed()
        return self._model

    @property
    def film(self) -> CameraRecording | None:
        """The last recording: images, dropped images, longest gap, clock."""
        return self._film

    def facts(self) -> dict[str, Any]:
        """Facts for a session's record: the camera, its settings, the quality of its last recording. Asks no device."""
        return self._facts | ({"ended": self._ended} if self._ended else {})

    def snapshot(self) -> Frame:
        """The first frame exposed from now on. Raises CameraError."""
        with self._line:
            self._send(Call("shot"))
            shot: TimedCapture = self._receive(self._answer_s)
        return _decoded(shot)

    def start_recording(self) -> None:
        """Raises CameraError if a recording runs already, or the camera is gone."""
        with self._line:
            self._send(Call("start_recording"))
            self._receive(self._answer_s)

    def stop_recording(self) -> Sequence[Frame]:
        """Everything exposed since `start_recording`, decoded.

        Raises CameraError, also if too many images were lost.
        """
        with self._line:
            self._send(Call(END_FILM))
            head, facts, count = self._receive(self._answer_s)
            shots: tuple[TimedCapture, ...] = tuple(self._receive(self._answer_s) for _ in range(count))
        self._facts, self._film = facts, replace(head, shots=shots)
        _require_whole(self._film, self.model().serial)
        with ThreadPoolExecutor(max_workers=2) as pool:  # OpenCV releases the interpreter while it decodes
            return tuple(pool.map(_decoded, shots))

    def newest(self) -> NDArray[np.uint8] | None:
        """See `hw.ports.Camera`. This also notices a driver that hangs, and the session's next call reports it."""
        if not self._line.acquire(blocking=False):
            return None
        try:
            if self._child is None:
                return None
            self._send(Call("newest"))
            jpeg = self._receive(self._answer_s)
            return decode_jpeg(jpeg) if isinstance(jpeg, bytes) else None
        except (CameraError, DeviceUnavailable, OSError):
            return None
        finally:
            self._line.release()

    def _connecting(self, child: Child) -> Any:
        """The answer to `open`: model and facts. Each of its steps may take `step_s`."""
        doing = "it starts"
        while True:
            began_s = time.monotonic()
            if not child.answers(self._answer_s):
                _log.warning(
                    "the camera is silent for %g s while %s; waiting up to %g s", self._answer_s, doing, self._step_s
                )
            left_s = max(self._step_s - (time.monotonic() - began_s), 0.0)
            answer = self._receive(left_s, f"{self._step_s:g} s while {doing}")
            if not isinstance(answer, str):
                return answer
            doing = answer

    def _send(self, call: Call) -> None:
        try:
            self._running.send(call)
        except ChildGone as how:
            raise self._gone(f"the camera's process was {how}") from how

    def _receive(self, within_s: float, silent: str = "") -> Any:
        child = self._running
        try:
            if not child.answers(within_s):
                child.kill()
                raise self._gone(
                    f"the camera's driver has not answered for {silent or f'{within_s:g} s'}, and was ended"
                )
            answer = child.receive()
        except ChildGone as how:
            raise self._gone(f"the camera's process was {how}") from how
        if isinstance(answer, CameraError | DeviceUnavailable):
            raise answer
        return answer

    def _gone(self, why: str) -> CameraError:
        self._ended = why
        self.__exit__()
        return CameraError(
            f"{why}. Unplug the camera, wait ten seconds, plug it into a USB 3 port of its own, and run the command "
            "again"
        )

    @property
    def _running(self) -> Child:
        if self._ended:
            raise CameraError(f"{self._ended}; run the command again")
        if self._child is None:
            raise _closed()
        return self._child


def _decoded(shot: TimedCapture) -> Frame:
    return shot.captured.frame(shot.t_s)


def _require_whole(film: CameraRecording, serial: str) -> None:
    """Raises CameraError if too many images of a recording are missing; a few give only a warning."""
    every = film.dropped + len(film.shots)
    if film.dropped:
        _log.warning("camera %s dropped %d of %d frames", serial, film.dropped, every)
    if not film.shots or film.lost > MOST_LOST:
        raise CameraError(
            f"{film.dropped} of {every} frames of the recording are missing ({film.lost:.0%}, limit {MOST_LOST:.0%}; "
            f"longest gap {film.longest_gap_s:.2f} s): give the camera a USB controller of its own, close "
            "other programs, and repeat the trial"
        )


def _closed() -> DeviceUnavailable:
    return DeviceUnavailable("the camera is not connected: use it inside a `with` block")
