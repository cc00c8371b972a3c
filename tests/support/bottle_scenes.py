"""A bottle pushed by a plate, a hand, and an arm above the table, seen by the lab's camera, with everything known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from table_scenes import TABLE, at, box, solid

from hw.types import Array, CameraModel, Frame
from perception.arm_mask import ArmShape, ToolMask
from perception.cylinder import Cylinder
from sim.lab.kinect import default_X_BC, kinect_model
from sim.render.bodies import Body
from sim.render.depth import DepthView
from sim.render.renderer import Renderer
from sim.render.sensor import SensorNoise, sense_depth
from sim.types import Visual

BODY = Cylinder(0.03, 0.10)
AREA = (0.42, 1.22, -0.36, 0.36)
MARK = np.array([0.56, 0.0])
BOTTLE_RGB, HAND_RGB, PLATE_RGB = (0.70, 0.68, 0.62), (0.55, 0.32, 0.22), (0.02, 0.05, 0.16)
GONE = at(0.5, 0.0, -3.0)
Pose = Callable[[float], Array]


def bottle(body: str = "bottle", rgb: tuple[float, float, float] = BOTTLE_RGB) -> Visual:
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    rings = [np.c_[0.03 * np.cos(turn), 0.03 * np.sin(turn), np.full(64, z)] for z in (-0.05, 0.05)]
    return solid(body, np.concatenate(rings), rgb)


HAND = box("hand", (-0.04, -0.05, -0.03), (0.04, 0.05, 0.03), HAND_RGB)
PLATE = box("plate", (-0.005, -0.06, 0.0), (0.0, 0.06, 0.08), PLATE_RGB)


def up(x: float, y: float) -> Array:
    """A bottle that stands there."""
    return BODY.upright(np.array([x, y]))


def leaning(xy: Array, tilt_rad: float, heading_rad: float = 0.0) -> Array:
    """A bottle that stands on the rim of its bottom, tilted towards a heading."""
    X = np.eye(4)
    X[:3, :3] = (
        cv2.Rodrigues(np.array([0.0, 0.0, heading_rad]))[0]
        @ cv2.Rodrigues(np.array([0.0, tilt_rad, 0.0]))[0]
        @ cv2.Rodrigues(np.array([0.0, 0.0, -heading_rad]))[0]
    )
    lowest = 0.05 * abs(X[2, 2]) + 0.03 * np.hypot(X[2, 0], X[2, 1])
    X[:3, 3] = xy[0], xy[1], lowest
    return X


@dataclass(frozen=True, eq=False)
class Stage:
    """The lab's camera over a table with things that move. Frames are of depth alone: tracking reads nothing else."""

    visuals: tuple[Visual, ...]  # of what moves
    noise: SensorNoise
    rng: np.random.Generator
    model: CameraModel = field(default_factory=kinect_model)
    X_BC: Array = field(default_factory=default_X_BC)

    def shot(self, t_s: float, **poses: Pose | Array) -> Frame:
        """One frame; whatever is not named is out of sight."""
        moving = [(self._bodies[name], X(t_s) if callable(X) else X) for name, X in poses.items()]
        return Frame(t_s, _DARK, sense_depth(*self._view.render(moving), self.noise, self.rng))

    def film(self, t_s: Array, **poses: Pose | Array) -> list[Frame]:
        return [self.shot(float(t), **poses) for t in t_s]

    def photo(self, **poses: Array) -> Frame:
        """One frame with colour, all bodies named."""
        renderer = Renderer(self.model, self.X_BC, [TABLE, *self.visuals])
        given = {name: X[None] for name, X in (dict.fromkeys(self._bodies, GONE) | poses).items()}
        return Frame(0.0, *renderer.render(given, self.noise, self.rng))

    @cached_property
    def _bodies(self) -> dict[str, Body]:
        return {v.body: Body([v]) for v in self.visuals}

    @cached_property
    def _view(self) -> DepthView:
        return DepthView(self.model.depth, self.X_BC @ self.model.X_CD, Body([TABLE]))


_DARK = np.zeros((720, 1280, 3), np.uint8)


def stage(*visuals: Visual, seed: int = 0) -> Stage:
    rng = np.random.default_rng(seed)
    return Stage(visuals or (bottle(), HAND, PLATE), SensorNoise.draw(rng), rng)


def plate_arm(plate: Pose) -> Callable[[float], ArmShape]:
    mask = ToolMask(PLATE.vertices_m, PLATE.triangles)
    return lambda t: ArmShape(tool=mask, X_BT=plate(t))
