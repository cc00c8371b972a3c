"""A live camera behind `hw.ports.Camera`, in a process of its own: every answer has a deadline."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from typing import Any, Self, TypeVar

from hw.camera.grabber import Film, TimedCapture
from hw.camera.k4a import decoded, frame_of, require_whole
from hw.camera.k4a_device import ColourSettings
from hw.camera.messages import (
    Answer,
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
from hw.child import Child, ChildGone
from hw.errors import CameraError, DeviceUnavailable
from hw.types import CameraModel, Frame

ANSWER_S = 3.0
"""The longest silence of a running camera; while it connects, a message reports a silence of this length."""
STEP_S = 20.0
"""The longest time for one step of connecting: the library, the depth engine, the first images."""
_END_S = 1.0
KINECT, REALSENSE = "hw.camera.served:kinect", "hw.camera.served:realsense"

_log = logging.getLogger(__name__)
_Kind = TypeVar("_Kind")


class CameraProcess:
    """Entering starts the process and connects. A process that hangs is ended; entering again starts another."""

    def __init__(
        self,
        serial: str | None,
        settings: ColourSettings,
        *,
        infrared: bool = False,
        latency_s: float = 0.0,
        maker: str = KINECT,
        answer_s: float = ANSWER_S,
        step_s: float = STEP_S,
    ) -> None:
        """As `hw.camera.k4a.LiveCamera`, which `maker` (module:function) makes in the process. Raises ValueError."""
        if latency_s < 0.0:
            raise ValueError(f"a camera latency of {latency_s:g} s: it must be 0 or more")
        self._asked, self._maker = Open(serial, settings, infrared, latency_s), maker
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
            self._send(self._asked)
            opened = _known(self._connecting(child), Opened)
        except BaseException:
            self.__exit__()
            raise
        self._model, self._facts = opened.model, opened.facts
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
        return frame_of(self._ask(Snapshot(), TimedCapture))

    def start_recording(self) -> None:
        """Raises CameraError when one runs, or the camera is gone."""
        self._ask(StartRecording(), Started)

    def stop_recording(self) -> Sequence[Frame]:
        """Everything exposed since `start_recording`, decoded.

        Raises CameraError, also if too many images were lost.
        """
        head = self._ask(StopRecording(), Recorded)
        shots = tuple(_known(self._receive(self._answer_s), TimedCapture) for _ in range(head.shots))
        self._facts = head.facts
        film = self._film = Film(shots, head.dropped, head.longest_gap_s, head.clock)
        require_whole(film, self.model().serial)
        return decoded(shots)

    def _ask(self, request: Request, kind: type[_Kind]) -> _Kind:
        self._send(request)
        return _known(self._receive(self._answer_s), kind)

    def _connecting(self, child: Child) -> Answer:
        """The answer to `Open`, step by step."""
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
            if not isinstance(answer, Step):
                return answer
            doing = answer.doing

    def _send(self, request: Request) -> None:
        try:
            self._running.send(request)
        except ChildGone as how:
            raise self._gone(f"the camera's process was {how}") from how

    def _receive(self, within_s: float, silent: str = "") -> Answer:
        child = self._running
        try:
            if not child.answers(within_s):
                child.kill()
                raise self._gone(
                    f"the camera's driver has not answered for {silent or f'{within_s:g} s'}, and was ended"
                )
            answer: Answer = child.receive()
        except ChildGone as how:
            raise self._gone(f"the camera's process was {how}") from how
        if isinstance(answer, Failed):
            raise (DeviceUnavailable if answer.unavailable else CameraError)(answer.text)
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


def open_camera(
    serial: str | None = None,
    settings: ColourSettings | None = None,
    *,
    maker: str = KINECT,
    infrared: bool = False,
    latency_s: float = 0.0,
) -> CameraProcess:
    """The camera with this serial number, or the only one of its kind (`maker`); connects on entering.

    `latency_s` is the time from the end of an exposure to its arrival at the host, as the calibration's swing measures
    it; half of the exposure is known and subtracted automatically. With `infrared` every frame carries the depth
    camera's infrared image, for calibrating.
    """
    return CameraProcess(serial, settings or ColourSettings(), infrared=infrared, latency_s=latency_s, maker=maker)


def _known(answer: Answer, kind: type[_Kind]) -> _Kind:
    if not isinstance(answer, kind):
        raise CameraError(f"the camera's process answered {type(answer).__name__} instead of {kind.__name__}")
    return answer


def _closed() -> DeviceUnavailable:
    return DeviceUnavailable("the camera is not connected: use it inside a `with` block")
