"""The conditions of the benchmark: changes of the lab's scene, of its pictures or of the camera's stamps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from hw.camera.grabber import DeviceClock
from hw.errors import CameraError
from hw.poses import pose, translation
from hw.types import Array
from sim.render.pool import Picture, Poses, Scene
from sim.tasks.shared.shapes import box
from sim.types import Visual

ARRIVES_S = 0.02
"""From the middle of an exposure to the arrival of its picture."""
_HAND_M, _SKIN = np.array([0.08, 0.10, 0.06]), (0.55, 0.32, 0.22)
_SOOT, _DARK_TABLE = (0.010, 0.010, 0.010), (0.020, 0.020, 0.022)
_KNOCK_M = 0.03
_FRAME_S = 1 / 30


@dataclass(frozen=True)
class Moment:
    """A picture of the camera: its number since the object was placed (0: before the motion), and a random generator
    of its own.
    """

    number: int
    rng: np.random.Generator


def _same_scene(scene: Scene, object_name: str, rng: np.random.Generator) -> Scene:
    return scene


def _no_bodies(poses: Poses, object_name: str, moment: Moment) -> dict[str, Array]:
    return {}


def _same_picture(picture: Picture, moment: Moment) -> Picture:
    return picture


def _true_stamp(t_s: float) -> float:
    return t_s


@dataclass(frozen=True)
class Condition:
    """One condition; each part that is not named stays that of the plain lab."""

    scene: Callable[[Scene, str, np.random.Generator], Scene] = _same_scene  # with the object's name
    bodies: Callable[[Poses, str, Moment], dict[str, Array]] = _no_bodies  # poses (S, 4, 4) of further bodies
    develop: Callable[[Picture, Moment], Picture] = _same_picture
    knocked_from: int | None = None
    """The number of the first picture by a camera that was moved by 30 mm; None: it stands still."""
    glass: bool = False  # whether the camera looks through most of the object
    device_s: Callable[[float], float] = _true_stamp  # time since the start of the recording -> the device's stamp
    frame_drop: float = 0.0  # share of pictures lost
    is_lit: bool = False  # under drawn light, with drawn colour and noise (`sensing.drawing`)


def _recoloured(scene: Scene, name: str, rgb: tuple[float, float, float]) -> Scene:
    return replace(scene, visuals=[replace(v, rgb=rgb) if v.body == name else v for v in scene.visuals])


def _dark_on_dark(scene: Scene, object_name: str, rng: np.random.Generator) -> Scene:
    return _recoloured(_recoloured(scene, object_name, _SOOT), "world", _DARK_TABLE)


def _of_the_table_s_colour(scene: Scene, object_name: str, rng: np.random.Generator) -> Scene:
    table = np.array(next(v.rgb for v in scene.visuals if v.body == "world"))
    near = np.clip(table * rng.uniform(0.8, 1.25), 0.0, 1.0)
    return _recoloured(scene, object_name, (float(near[0]), float(near[1]), float(near[2])))


def _with_hand(scene: Scene, object_name: str, rng: np.random.Generator) -> Scene:
    return replace(scene, visuals=[*scene.visuals, Visual("hand", *box(_HAND_M, np.zeros(3)), _SKIN)])


def _hand(poses: Poses, object_name: str, moment: Moment) -> dict[str, Array]:
    """It comes from one side over the object's place and leaves, within a second."""
    X_BO = poses[object_name]
    way_m = 0.5 * abs(_FRAME_S * moment.number - 1.0) if moment.number else 3.0  # away while the object is looked for
    side = 1.0 if round(1e6 * float(X_BO[0, 0, 3])) % 2 else -1.0
    return {
        "hand": np.repeat(translation((float(X_BO[0, 0, 3]) + 0.04, side * (0.03 + way_m), 0.10))[None], len(X_BO), 0)
    }


def _with_second(scene: Scene, object_name: str, rng: np.random.Generator) -> Scene:
    twin = [replace(v, body="second") for v in scene.visuals if v.body == object_name]
    return replace(scene, visuals=[*scene.visuals, *twin])


@dataclass
class _Beside:
    """The second object stays where it was put first, beside the place of the object."""

    at: dict[str, Array] = field(default_factory=dict)

    def __call__(self, poses: Poses, object_name: str, moment: Moment) -> dict[str, Array]:
        X_BO = poses[object_name]
        if moment.number == 0:
            X = np.array(X_BO[0])
            X[1, 3] += moment.rng.choice([-1.0, 1.0]) * (0.16 if X[2, 3] > 0.03 else 0.06)
            self.at[object_name] = X
        return {"second": np.repeat(self.at[object_name][None], len(X_BO), 0)}


def _in_shadow(picture: Picture, moment: Moment) -> Picture:
    """A soft shadow with a quarter of the light passes over the table."""
    colour, depth_mm = picture
    columns = np.arange(colour.shape[1]) / colour.shape[1]
    edge = -0.4 + 0.03 * moment.number
    inside = 1.0 / (1.0 + np.exp(-(columns - edge) / 0.01)) - 1.0 / (1.0 + np.exp(-(columns - edge - 0.35) / 0.01))
    light = (1.0 - 0.75 * inside[None, :, None]) ** (1 / 2.2)
    return np.rint(colour * light).astype(np.uint8), depth_mm


def _too_deep(picture: Picture, moment: Moment) -> Picture:
    """All depth 2 % too large."""
    return picture[0], np.rint(1.02 * picture[1]).astype(np.uint16)


def _defocused(picture: Picture, moment: Moment) -> Picture:
    return np.asarray(cv2.GaussianBlur(picture[0], (0, 0), picture[0].shape[1] / 320), dtype=np.uint8), picture[1]


def _clocks(rng: np.random.Generator) -> Callable[[float], float]:
    """A device's clock with one of five faults that users of such cameras report."""
    at_s = float(rng.uniform(0.2, 2.0))
    faults: tuple[Callable[[float], float], ...] = (
        lambda t_s: t_s if t_s < at_s else t_s + 0.5,  # it jumps
        lambda t_s: t_s if t_s < at_s else max(at_s, t_s - 0.4),  # it pauses
        lambda t_s: t_s if t_s < at_s else t_s - 0.02,  # it is set back by less than a picture
        lambda t_s: t_s * (1.0 - 5e-4),  # it is slow
        lambda t_s: t_s + 0.008 * np.sin(40.0 * t_s),  # it is uneven
    )
    return faults[rng.integers(len(faults))]


CONDITIONS: dict[str, Callable[[np.random.Generator], Condition]] = {
    "light, colour and noise": lambda rng: Condition(is_lit=True),
    "shadow": lambda rng: Condition(develop=_in_shadow),
    "dark on dark": lambda rng: Condition(scene=_dark_on_dark),
    "transparent": lambda rng: Condition(glass=True),
    "table-coloured": lambda rng: Condition(scene=_of_the_table_s_colour),
    "hand": lambda rng: Condition(scene=_with_hand, bodies=_hand),
    "second object": lambda rng: Condition(scene=_with_second, bodies=_Beside()),
    "knocked camera": lambda rng: Condition(knocked_from=int(rng.integers(8, 40))),
    "dropped frames": lambda rng: Condition(frame_drop=float(rng.uniform(0.4, 0.8))),
    "depth scale": lambda rng: Condition(develop=_too_deep),
    "stamps": lambda rng: Condition(device_s=_clocks(rng)),
    "blur": lambda rng: Condition(develop=_defocused),
}
"""Each draws its condition for one trial."""


def knocked(X_BC: Array, rng: np.random.Generator) -> Array:
    """(4, 4) the camera after a knock of 30 mm in any direction, turned with it by up to 2°."""
    way = rng.standard_normal(3)
    turn, _ = cv2.Rodrigues(np.deg2rad(rng.uniform(-2.0, 2.0)) * np.array([0.0, 0.0, 1.0]))
    return np.asarray(X_BC @ pose(np.asarray(turn), _KNOCK_M * way / np.linalg.norm(way)))


def seen_through(picture: Picture, without: Picture, moment: Moment) -> Picture:
    """A picture of an object of clear glass, from one of an opaque object and one without it."""
    (colour, depth_mm), (behind, bare_mm) = picture, without
    clear = np.rint(0.3 * colour + 0.7 * behind).astype(np.uint8)
    covered = np.abs(depth_mm.astype(np.int32) - bare_mm) > 8
    fate = moment.rng.random(depth_mm.shape)
    return clear, np.where(covered & (fate < 0.6), bare_mm, np.where(covered & (fate < 0.8), 0, depth_mm)).astype(
        np.uint16
    )


def stamped(times_s: Array, device_s: Callable[[float], float]) -> Array:
    """(N,) the times that the program gives to pictures taken at `times_s` (N,), by the clock map of a live camera.

    Raises CameraError as a recording of a live camera does.
    """
    clock = DeviceClock()
    before = times_s[0] - np.arange(30, 0, -1) * _FRAME_S
    stamps_s = [device_s(float(t_s - times_s[0])) for t_s in (*before, *times_s)]
    for stamp_s, t_s in zip(stamps_s[:30], before, strict=True):
        clock.add(stamp_s, float(t_s) + ARRIVES_S)
    jumps = clock.jumps
    for stamp_s, t_s in zip(stamps_s[30:], times_s, strict=True):
        clock.add(stamp_s, float(t_s) + ARRIVES_S)
    if clock.jumps > jumps:
        raise CameraError("the camera's clock jumped during the recording, so the times of its images are unknown")
    return np.array([clock.map().host_s(stamp_s) for stamp_s in stamps_s[30:]])
