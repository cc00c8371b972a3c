"""Colour and depth images of moving bodies in a static scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hw.types import Array, CameraModel
from sim.render.bodies import Body
from sim.render.colour import SAMPLES, ColourView
from sim.render.depth import DepthView, InfraredView
from sim.render.rays import within_exposure
from sim.render.sensor import SensorNoise, sense_colour, sense_depth, sense_infrared
from sim.types import Visual

WORLD = "world"
FLOOR_M = -0.75
"""A floor under the table, in the base frame: part of every scene."""


class Renderer:
    """A fixed RGB-D camera that sees `visuals`.

    Visuals of the body "world" never move and are rendered once. Other bodies are cast only in the part of the image
    that they can cover. Equal input gives equal images in any process.
    """

    def __init__(self, model: CameraModel, X_BC: Array, visuals: Sequence[Visual]) -> None:
        """`X_BC` (4, 4) is the true pose of the colour camera in the base frame."""
        names = [name for name in dict.fromkeys(visual.body for visual in visuals) if name != WORLD]
        self._bodies = {name: Body([v for v in visuals if v.body == name]) for name in names}
        self._world = Body([*(v for v in visuals if v.body == WORLD), _floor()])
        X_BC = np.asarray(X_BC, dtype=np.float64)
        self._model, self._X_BD = model, X_BC @ model.X_CD
        self._colour = ColourView(model.colour, X_BC, self._world)
        self._depth = DepthView(model.depth, self._X_BD, self._world)

    def render(
        self, poses: Mapping[str, Array], noise: SensorNoise | None, rng: np.random.Generator
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
        """Render with `poses` (S, 4, 4) of every moving body in the base frame, at the middles of S equal slices of the
        exposure.

        Returns colour (Hc, Wc, 3) RGB with motion blur, and depth (Hd, Wd) in mm at the middle of the exposure. Without
        `noise` both are exact up to rounding. Raises ValueError if the pose of a body is missing.
        """
        spread = (np.arange(SAMPLES) + 0.5) / SAMPLES
        placed_bodies = self._given(poses)
        colour = self._colour.render([(body, within_exposure(X, spread)) for body, X in placed_bodies])
        depth = self._depth.render([(body, within_exposure(X, np.array([0.5]))[0]) for body, X in placed_bodies])
        return sense_colour(colour, noise, rng), sense_depth(*depth, noise, rng)

    def render_infrared(
        self, poses: Mapping[str, Array], noise: SensorNoise | None, rng: np.random.Generator
    ) -> NDArray[np.uint16]:
        """The depth camera's own picture (Hd, Wd) at the middle of the exposure; `poses` as for `render`."""
        placed_bodies = [(body, within_exposure(X, np.array([0.5]))[0]) for body, X in self._given(poses)]
        return sense_infrared(self._infrared.render(placed_bodies), noise, rng)

    @cached_property
    def _infrared(self) -> InfraredView:
        return InfraredView(self._model.depth, self._X_BD, self._world)

    def _given(self, poses: Mapping[str, Array]) -> list[tuple[Body, Array]]:
        lacking = [name for name in self._bodies if name not in poses]
        if lacking:
            raise ValueError(f"no pose for the visible bodies {lacking}; poses name {sorted(poses)}")
        return [(body, np.asarray(poses[name], dtype=np.float64)) for name, body in self._bodies.items()]


def _floor() -> Visual:
    reach = 6.0
    vertices = np.array([[x, y, FLOOR_M] for x in (-reach, reach) for y in (-reach, reach)])
    return Visual(WORLD, vertices, np.array([[0, 2, 3], [0, 3, 1]], dtype=np.int32), (0.16, 0.17, 0.18))
