"""A Kinect behind `hw.ports.Camera`, in a process of its own: every answer has a deadline."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self, TypeVar

from hw.camera.grabber import Film, TimedCapture
from hw.camera.k4a import decoded, frame_of, require_whole
from hw.camera.k4a_device import ColourSettings
from hw.camera.served import CONNECT, END_FILM
from hw.child import Call, Child, ChildGone
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame

ANSWER_S = 3.0
"""The longest silence of a running camera; while it connects, a message reports a silence of this length."""
STEP_S = 20.0
"""The longest time for one step of connecting: the library, the depth engine, the first images."""
_END_S = 1.0
KINECT = "hw.camera.k4a:KinectCamera"

_log = logging.getLogger(__name__)
_Kind = TypeVar("_Kind")


class CameraProcess:
    """Entering starts the process and connects. A process that hangs is ended; entering again starts another."""

    def __init__(
        self,
        serial: str | None = None,
        settings: ColourSettings | None = None,
        *,
        infrared: bool = False,
        latency_s: float = 0.0,
        maker: str = KINECT,
        answer_s: float = ANSWER_S,
        step_s: float = STEP_S,
    ) -> None:
        """The camera with this serial number, or the only one, which `maker` (module:name) makes in the process.

        `latency_s` is the time from the end of an exposure to its arrival at the host, as the calibration's swing
        measures it; half of the exposure is known and subtracted. With `infrared` every frame carries the depth
        camera's infrared image, for calibrating. Raises ValueError.
        """
        if latency_s < 0.0:
            raise ValueError(f"a camera latency of {latency_s:g} s: it must be 0 or more")
        self._connect, self._maker = Call(CONNECT, (serial, settings or ColourSettings(), infrared, latency_s)), maker
        self._answer_s, self._step_s = answer_s, step_s
        self._child: Child | None = None
        self._model: CameraModel | None = None
        self._facts: dict[str, Any] = {}
        self._ended = ""  # why the process ended
        self._film: Film | None = None

    def __enter__(self) -> Self:
        """Raises DeviceUnavailable without library or camera, CameraError if the camera does not start."""
        self._ended = ""
        child = self._child = Child("hw.camera.served", self._maker, end_s=_END_S)
        try:
            self._send(self._connect)
            self._model, self._facts = _known(self._connecting(child), tuple)
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
    def film(self) -> Film | None:
        """The last recording: images, dropped images, longest gap, clock."""
        return self._film

    def facts(self) -> dict[str, Any]:
        """For a session's record: which camera, its settings, the quality of its last recording. Asks no device."""
        return self._facts | ({"ended": self._ended} if self._ended else {})

    def snapshot(self) -> Frame:
        """The first frame exposed from now on. Raises CameraError."""
        return frame_of(self._ask(Call("shot"), TimedCapture))

    def start_recording(self) -> None:
        """Raises CameraError when one runs, or the camera is gone."""
        self._ask(Call("start_recording"), type(None))

    def stop_recording(self) -> Sequence[Frame]:
        """Everything exposed since `start_recording`, decoded.

        Raises CameraError, also if too many images were lost.
        """
        count, film, facts = self._ask(Call(END_FILM), tuple)
        shots = tuple(_known(self._receive(self._answer_s), TimedCapture) for _ in range(count))
        self._facts, film = facts, replace(film, shots=shots)
        self._film = film
        require_whole(film, self.model().serial)
        return decoded(shots)

    def _ask(self, call: Call, kind: type[_Kind]) -> _Kind:
        self._send(call)
        return _known(self._receive(self._answer_s), kind)

    def _connecting(self, child: Child) -> object:
        """The last answer, after the names of the steps."""
        doing = "it starts"
        while True:
            began_s = time.monotonic()
            if not child.answers(self._answer_s):
                _log.warning(
                    "the camera is silent for %g s while %s; waiting up to %g s",
                    self._answer_s,
                    doing,
                    self._step_s,
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

    def _receive(self, within_s: float, silent: str = "") -> object:
        child = self._running
        try:
            if not child.answers(within_s):
                child.kill()
                raise self._gone(
                    f"the camera's driver has not answered for {silent or f'{within_s:g} s'}, and was ended"
                )
            answer: object = child.receive()
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


def _known(answer: object, kind: type[_Kind]) -> _Kind:
    if not isinstance(answer, kind):
        raise CameraError(f"the camera's process answered {type(answer).__name__} instead of {kind.__name__}")
    return answer


def _closed() -> DeviceUnavailable:
    return DeviceUnavailable("the camera is not connected: use it inside a `with` block")
