"""A table, a blade and a piece, seen by the lab's camera, with everything known: what tracking is tested on.

The image is cut to the work area at full resolution, so a frame costs little.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from hw.poses import pose
from hw.types import Array, CameraModel, Frame, Intrinsics
from sim.lab.kinect import default_X_BC, kinect_model
from sim.render.renderer import Renderer
from sim.render.sensor import SensorNoise
from sim.types import Visual

AREA = (0.63, 0.73, -0.05, 0.05)
FOOD_RGB, BLADE_RGB, TABLE_RGB = (0.55, 0.13, 0.03), (0.02, 0.02, 0.02), (0.55, 0.53, 0.50)
Motion = Callable[[float], Array]


def close_up() -> CameraModel:
    """The lab's camera with its images cut to the work area: 360 x 300 and 220 x 220 pixels."""
    full = kinect_model()
    return CameraModel("close-up", cut(full.colour, 460, 230, 360, 300), cut(full.depth, 240, 180, 220, 220), full.X_CD)


def cut(camera: Intrinsics, left: int, top: int, width: int, height: int) -> Intrinsics:
    K = camera.K.copy()
    K[:2, 2] -= [left, top]
    return Intrinsics(width, height, K, camera.distortion)


def solid(body: str, points_m: Array, rgb: tuple[float, float, float]) -> Visual:
    """The convex hull of `points_m` (N, 3)."""
    return Visual(body, points_m, ConvexHull(points_m).simplices.astype(np.int32), rgb)


def box(body: str, low_m: tuple[float, ...], high_m: tuple[float, ...], rgb: tuple[float, float, float]) -> Visual:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    return solid(body, np.array(low_m) + corners * np.subtract(high_m, low_m), rgb)


def food(shape: str, half_m: tuple[float, float, float], body: str = "piece") -> Visual:
    """A piece of food; its frame is at its centre."""
    if shape == "box":
        return box(body, tuple(-h for h in half_m), half_m, FOOD_RGB)
    elevations = np.deg2rad(np.arange(-85, 90, 10)) if shape == "ellipsoid" else np.array([0.0, 0.0])
    heights = np.sin(elevations) if shape == "ellipsoid" else np.array([-1.0, 1.0])
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    rings = [
        np.c_[np.cos(e) * np.cos(angle), np.cos(e) * np.sin(angle), np.full(40, z)]
        for e, z in zip(elevations, heights, strict=True)
    ]
    return solid(body, np.concatenate(rings) * half_m, FOOD_RGB)


TABLE = box("world", (0.30, -0.60, -0.03), (1.20, 0.60, 0.0), TABLE_RGB)
BLADE = box("tool", (-0.10, -0.04, -0.0012), (0.0, 0.04, 0.0), BLADE_RGB)


def tool_mesh() -> tuple[Array, NDArray[np.int32]]:
    return BLADE.vertices_m, BLADE.triangles


def at(x: float, y: float, z: float, pitch: float = 0.0) -> Array:
    """Pose with `pitch` about Y; positive holds the X end down."""
    c, s = np.cos(pitch), np.sin(pitch)
    return pose([[c, 0, s], [0, 1, 0], [-s, 0, c]], [x, y, z])


AWAY = at(0.3, 0.0, 0.25)


@dataclass(frozen=True, eq=False)
class Studio:
    """One piece under the camera."""

    model: CameraModel
    X_BC: Array
    renderer: Renderer
    noise: SensorNoise | None
    rng: np.random.Generator

    def shot(self, t_s: float, piece: Motion, tool: Motion) -> Frame:
        slices = t_s + np.array([-0.003, -0.001, 0.001, 0.003])
        poses = {"piece": np.stack([piece(t) for t in slices]), "tool": np.stack([tool(t) for t in slices])}
        return Frame(t_s, *self.renderer.render(poses, self.noise, self.rng))

    def still(self, X_BO: Array, X_BT: Array = AWAY) -> Frame:
        return self.shot(0.0, lambda _: X_BO, lambda _: X_BT)


def studio(*pieces: Visual, seed: int = 0, noisy: bool = True, model: CameraModel | None = None) -> Studio:
    model, rng = model or close_up(), np.random.default_rng(seed)
    noise = SensorNoise.draw(rng) if noisy else None
    return Studio(model, default_X_BC(), Renderer(model, default_X_BC(), [TABLE, BLADE, *pieces]), noise, rng)
