"""A camera without a device: a test shows it captures one by one, and nothing waits for real time."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from clocks import FakeClock

from hw.camera.process import CameraProcess

DELAY_S = 0.030  # from the middle of an exposure to its arrival, at least
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Shown:
    """One capture: grey value of the colour image, millimetres of the depth image, host time of the exposure."""

    t_s: float
    late_s: float = 0.0
    grey: int = 100
    depth_mm: int = 700
    has_colour: bool = True
    has_infrared: bool = True
    stamped: bool = True  # with the host's time of arrival, as Microsoft's library does


class TellingClock(FakeClock):
    """Tells when somebody else than the camera's thread has looked at it."""

    def __init__(self, t_s: float) -> None:
        super().__init__(t_s)
        self.asked = threading.Event()

    def now_s(self) -> float:
        now_s = super().now_s()
        if threading.current_thread().name != "camera":
            self.asked.set()
        return now_s

    def advance_to(self, t_s: float) -> None:
        self.sleep(max(t_s - super().now_s(), 0.0))


class Stage:
    """What a camera is shown, capture by capture, and the clock that goes along."""

    def __init__(self) -> None:
        self.clock = TellingClock(100.0)
        self._waiting: queue.Queue[Shown | str] = queue.Queue()
        self._taken = self._over = False

    def show(self, *shown: Shown) -> None:
        """Hand these captures to the camera, one after the other, each at its time; returns when all were taken."""
        for one in shown:
            self.clock.advance_to(one.t_s + DELAY_S + one.late_s)
            self._waiting.put(one)
            self._waiting.join()

    def fail(self, how: str) -> None:
        """The next call for a capture ends with "unplugged" or "timeout"."""
        self._waiting.put(how)

    def end(self) -> None:
        """From now on there is nothing but timeouts."""
        self._over = True
        self._waiting.put("timeout")

    def next_shown(self) -> Shown | str:
        """For the camera's thread, which has dealt with the one before: the next capture, or how it fails."""
        if self._taken:
            self._waiting.task_done()
        self._taken = not self._over
        return "timeout" if self._over else self._waiting.get()


def enter(camera: CameraProcess, show: Callable[[], None]) -> None:
    with ThreadPoolExecutor(1) as pool:
        entering = pool.submit(camera.__enter__)
        show()
        entering.result()


def while_shown(stage: Stage, ask: Callable[[], Answer], show: Callable[[], None]) -> Answer:
    """`ask` something of the camera, and show it captures after it has looked at the clock; none where it refused."""
    asked = stage.clock.asked
    asked.clear()
    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(ask)
        answer.add_done_callback(lambda _: asked.set())
        asked.wait()
        if not answer.done():
            show()
        return answer.result()


def meanwhile(stage: Stage, ask: Callable[[], Answer], *shown: Shown) -> Answer:
    """The same with these captures."""
    return while_shown(stage, ask, lambda: stage.show(*shown))
