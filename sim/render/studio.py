"""Renders the pictures of a film at the same time, one per process.

Threads of one process take turns, because most of the work is Python's: two are no faster than one.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import cached_property
from queue import SimpleQueue
from typing import Protocol

from hw.child import Child, ChildGone
from hw.errors import CameraError
from sim.render.renderer import Renderer
from sim.render.served import Moment, Picture, Scene


class Studio(Protocol):
    """Renders pictures of one scene in the background."""

    def render(self, moment: Moment) -> Future[Picture]:
        """The picture, soon. Its result may raise CameraError."""
        ...

    def close(self, *, finish: bool) -> None:
        """End, with all pictures rendered that were asked for, or else with the rest of them cancelled."""
        ...


class ThreadStudio:
    """One picture after another in this process: no start-up time."""

    def __init__(self, scene: Callable[[], Scene]) -> None:
        """`scene` is called for the first picture."""
        self._make = scene
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="rendering")

    def render(self, moment: Moment) -> Future[Picture]:
        """See `Studio`."""
        return self._thread.submit(self._render, moment)

    def close(self, *, finish: bool) -> None:
        """See `Studio`."""
        self._thread.shutdown(cancel_futures=not finish)

    def _render(self, moment: Moment) -> Picture:
        scene, renderer = self._built
        return renderer.render(moment.poses, scene.noise, moment.rng)

    @cached_property
    def _built(self) -> tuple[Scene, Renderer]:
        scene = self._make()
        return scene, scene.renderer()


class ProcessStudio:
    """A picture per process at a time. The processes start at once and prepare the scene in the background."""

    def __init__(self, scene: Scene, processes: int) -> None:
        self._scene = scene
        self._idle: SimpleQueue[Child] = SimpleQueue()
        self._threads = ThreadPoolExecutor(processes, thread_name_prefix="rendering")
        self._children: set[Child] = set()
        for _ in range(processes):
            self._threads.submit(self._open, self._started())

    def render(self, moment: Moment) -> Future[Picture]:
        """See `Studio`."""
        return self._threads.submit(self._render, moment)

    def close(self, *, finish: bool) -> None:
        """See `Studio`."""
        self._threads.shutdown(cancel_futures=not finish)
        for child in self._children:
            child.kill()
            child.close()

    def _started(self) -> Child:
        child = Child("sim.render.served")
        self._children.add(child)
        return child

    def _open(self, child: Child) -> None:
        with suppress(ChildGone):  # the first picture will say so
            child.send(self._scene)
        self._idle.put(child)

    def _render(self, moment: Moment) -> Picture:
        child = self._idle.get()
        try:
            child.send(moment)
            picture: Picture = child.receive()
        except ChildGone as error:
            self._children.discard(child)
            child.close()
            self._open(self._started())
            raise CameraError(
                f"the process that renders the lab's pictures was lost: {error}; redo the trial"
            ) from error
        self._idle.put(child)
        return picture
