"""Renders the pictures of a film at the same time, one per process.

Threads of one process take turns, because most of the work is Python's, so two threads are no faster than one.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw.child import Child, ChildGone
from hw.computer import trim
from hw.errors import CameraError
from hw.types import Array, CameraModel
from sim.render.renderer import Renderer
from sim.render.sensor import SensorNoise
from sim.types import Visual

Picture = tuple[NDArray[np.uint8], NDArray[np.uint16]]
"""Colour and depth, as `Renderer.render` returns them."""
Poses = Mapping[str, Array]
"""(S, 4, 4) of every moving body, as `Renderer.render` takes them."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that the pictures of a camera depend on, except the moment."""

    model: CameraModel
    X_BC: Array  # (4, 4)
    visuals: Sequence[Visual]
    noise: SensorNoise | None

    def renderer(self) -> Renderer:
        """Its renderer, which takes a second to build."""
        return Renderer(self.model, self.X_BC, self.visuals)


def serve(program: Connection) -> None:
    """Receive a scene, then answer the poses and the generator of each exposure with its picture, until the program
    hangs up.
    """
    with suppress(EOFError, OSError):
        scene: Scene = program.recv()
        renderer = scene.renderer()
        trim()
        while True:
            poses, rng = program.recv()
            program.send(renderer.render(poses, scene.noise, rng))


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as connection:
        serve(connection)


class RenderPool(Protocol):
    """Renders pictures of one scene in the background."""

    def render(self, poses: Poses, rng: np.random.Generator) -> Future[Picture]:
        """Start the picture of one exposure, and return its future; `rng` draws its noise. The result may raise
        CameraError.
        """

    def close(self, *, finish: bool) -> None:
        """End: with `finish`, after all requested pictures are rendered; otherwise the remaining ones are cancelled."""


class ThreadPool:
    """Renders one picture after another in this process, without start-up time."""

    def __init__(self, scene: Callable[[], Scene]) -> None:
        """`scene` is called for the first picture."""
        self._make = scene
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="rendering")

    def render(self, poses: Poses, rng: np.random.Generator) -> Future[Picture]:
        """See `RenderPool`."""
        return self._thread.submit(self._render, poses, rng)

    def close(self, *, finish: bool) -> None:
        """See `RenderPool`."""
        self._thread.shutdown(cancel_futures=not finish)

    def _render(self, poses: Poses, rng: np.random.Generator) -> Picture:
        scene, renderer = self._built
        return renderer.render(poses, scene.noise, rng)

    @cached_property
    def _built(self) -> tuple[Scene, Renderer]:
        scene = self._make()
        return scene, scene.renderer()


class ProcessPool:
    """Renders one picture per process. The processes start at once and prepare the scene in the background."""

    def __init__(self, scene: Scene, processes: int) -> None:
        self._scene = scene
        self._idle: SimpleQueue[Child] = SimpleQueue()
        self._threads = ThreadPoolExecutor(processes, thread_name_prefix="rendering")
        self._children: set[Child] = set()
        for _ in range(processes):
            self._threads.submit(self._open, self._started())

    def render(self, poses: Poses, rng: np.random.Generator) -> Future[Picture]:
        """See `RenderPool`."""
        return self._threads.submit(self._render, poses, rng)

    def close(self, *, finish: bool) -> None:
        """See `RenderPool`."""
        self._threads.shutdown(cancel_futures=not finish)
        for child in self._children:
            child.kill()
            child.close()

    def _started(self) -> Child:
        child = Child("sim.render.pool")
        self._children.add(child)
        return child

    def _open(self, child: Child) -> None:
        with suppress(ChildGone):  # the first picture will say so
            child.send(self._scene)
        self._idle.put(child)

    def _render(self, poses: Poses, rng: np.random.Generator) -> Picture:
        child = self._idle.get()
        try:
            child.send((poses, rng))
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
