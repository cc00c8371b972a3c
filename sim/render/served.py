"""The process that renders: `python -m sim.render.served CONNECTION`. It ends when the program hangs up."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, CameraModel
from sim.render.renderer import Renderer
from sim.render.sensor import SensorNoise
from sim.types import Visual

Picture = tuple[NDArray[np.uint8], NDArray[np.uint16]]
"""Colour and depth, as `Renderer.render` returns them."""


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


@dataclass(frozen=True, eq=False)
class Moment:
    """One exposure."""

    poses: Mapping[str, Array]  # (S, 4, 4) of every moving body, as `Renderer.render` takes them
    rng: np.random.Generator  # of its noise


def serve(program: Connection) -> None:
    """Receive a scene, then answer each moment with its picture, until the program hangs up."""
    with suppress(EOFError, OSError):
        scene: Scene = program.recv()
        renderer = scene.renderer()
        while True:
            moment: Moment = program.recv()
            program.send(renderer.render(moment.poses, scene.noise, moment.rng))


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as connection:
        serve(connection)
