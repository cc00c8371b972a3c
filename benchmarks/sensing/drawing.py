"""The worlds of each condition. Under drawn light, a piece has any colour, and the camera may be good or bad."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.ports import Camera
from hw.types import CameraModel, Frame
from sensing.conditions import CONDITIONS, Condition, stamped
from sim.lab.drawn import drawn_world
from sim.lab.world import Sensing, World
from sim.tasks.task import Task

DARKEST, BRIGHTEST = 0.004, 0.70
"""Luminance of a piece, linear: from soot to white cheese. Drawn evenly in its logarithm: half are darker than a raisin
in its packet (0.05)."""
_READ_STD = 1.6  # grey levels, of the sensor at any light


@dataclass(frozen=True)
class Light:
    """The light of one world, relative to the lab's."""

    gain: float  # of the whole picture, linear
    red: float  # of red over green
    blue: float  # of blue over green
    flicker: float  # amplitude, share of the gain
    flicker_Hz: float
    sun: float  # share of the depth camera's readings that sunlight removes

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Light:
        """From a dim corner to a window; half of the rooms flicker, half have sun."""
        gain = float(np.exp(rng.uniform(np.log(0.25), np.log(1.8))))
        red, blue = (float(np.exp(rng.uniform(-0.16, 0.16))) for _ in range(2))
        flicker = float(rng.uniform(0.0, 0.25)) * float(rng.random() < 0.5)
        sun = float(rng.uniform(0.0, 0.4)) * float(rng.random() < 0.5)
        return cls(gain, red, blue, flicker, float(rng.uniform(0.5, 7.0)), sun)


@dataclass(frozen=True, eq=False)
class LitWorld:
    """One world of the benchmark, in which one trial is made."""

    name: str
    seed: tuple[int, ...]  # of the trial
    condition: Condition
    world: World
    light: Light | None  # None: the lab's

    @property
    def luminance(self) -> float:
        """The colour of the piece, linear; NaN if no camera uses the object's colour."""
        colour = getattr(self.world.unmodelled, "colour", None)
        return float("nan") if colour is None else float(np.dot(colour, (0.2126, 0.7152, 0.0722)))


def draw_worlds(
    task: Task, seed: int, count: int, condition: str, camera: Literal["kinect", "small"]
) -> tuple[LitWorld, ...]:
    """`count` worlds of `seed` under one of `sensing.conditions.CONDITIONS`, always the same."""
    return tuple(_draw(task, seed, number, condition, camera) for number in range(count))


def _draw(task: Task, seed: int, number: int, condition: str, camera: Literal["kinect", "small"]) -> LitWorld:
    apart = 1000 * list(CONDITIONS).index(condition)  # each condition has motions and worlds of its own
    trial_seed = (seed, apart + number)
    rng, world = np.random.default_rng((*trial_seed, 55)), drawn_world(task, *trial_seed)
    name = f"{task.name}-{condition.replace(',', '').replace(' ', '-')}-{number:02d}"
    drawn = CONDITIONS[condition](rng)
    sensing, light = Sensing(camera=camera, frame_drop=drawn.frame_drop), None
    if drawn.is_lit:
        sensing = replace(
            sensing,
            depth_noise_scale=float(np.exp(rng.uniform(np.log(0.5), np.log(8.0)))),
            frame_drop=float(rng.uniform(0.0, 0.4)) * float(rng.random() < 0.5),
        )
        if hasattr(world.unmodelled, "colour"):
            world = replace(world, unmodelled=replace(world.unmodelled, colour=_colour(rng)))
        light = Light.draw(rng)
    return LitWorld(name, trial_seed, drawn, replace(world, sensing=sensing), light)


def _colour(rng: np.random.Generator) -> tuple[float, float, float]:
    """Any hue, grey to vivid, of a luminance that is drawn evenly in its logarithm."""
    hue, saturation = np.float32(rng.uniform(0, 360)), np.float32(rng.uniform(0.0, 0.95))
    rgb = cv2.cvtColor(np.array([[[hue, saturation, 1.0]]], np.float32), cv2.COLOR_HSV2RGB)[0, 0].astype(float)
    luminance = np.exp(rng.uniform(np.log(DARKEST), np.log(BRIGHTEST)))
    red, green, blue = np.clip(rgb * luminance / np.dot(rgb, (0.2126, 0.7152, 0.0722)), 0.0, 1.0).tolist()
    return red, green, blue


class LitCamera:
    """A `Camera`: the lab's, under the light of one world, with the stamps of a device that has a clock of its own."""

    def __init__(self, camera: Camera, light: Light | None, condition: Condition, seed: tuple[int, ...]) -> None:
        self._camera, self._light, self._condition, self._seed = camera, light, condition, seed

    def model(self) -> CameraModel:
        """See `hw.ports.Camera`."""
        return self._camera.model()

    def snapshot(self) -> Frame:
        """See `hw.ports.Camera`."""
        return self._lit(self._camera.snapshot())

    def start_recording(self) -> None:
        """See `hw.ports.Camera`."""
        self._camera.start_recording()

    def stop_recording(self) -> Sequence[Frame]:
        """See `hw.ports.Camera`."""
        frames = [self._lit(frame) for frame in self._camera.stop_recording()]
        if not frames:
            return frames
        times_s = stamped(np.array([frame.t_s for frame in frames]), self._condition.device_s)
        return [replace(frame, t_s=float(t_s)) for frame, t_s in zip(frames, times_s, strict=True)]

    def newest(self) -> NDArray[np.uint8] | None:
        """See `hw.ports.Camera`; without the light."""
        return self._camera.newest()

    def __enter__(self) -> LitCamera:
        return self

    def __exit__(self, *exc: object) -> None:
        pass

    def _lit(self, frame: Frame) -> Frame:
        if (light := self._light) is None:
            return frame
        rng = np.random.default_rng((*self._seed, round(1e6 * frame.t_s)))
        gain = light.gain * (1 + light.flicker * np.sin(2 * np.pi * light.flicker_Hz * frame.t_s))
        grey = (np.arange(256) / 255) ** 2.2
        curves = [255 * np.clip(gain * part * grey, 0, 1) ** (1 / 2.2) for part in (light.red, 1.0, light.blue)]
        lut = np.stack(curves, axis=-1)[None].astype(np.float32)
        noise = rng.standard_normal(frame.colour.shape[:2], dtype=np.float32)
        colour = cv2.LUT(frame.colour, lut) + _READ_STD * noise[..., None]
        depth_mm: NDArray[np.uint16] = frame.depth_mm.copy()
        if light.sun:
            depth_mm[rng.random(depth_mm.shape, dtype=np.float32) < light.sun] = 0
        return replace(frame, colour=np.clip(np.rint(colour), 0, 255).astype(np.uint8), depth_mm=depth_mm)
