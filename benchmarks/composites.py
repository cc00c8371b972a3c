"""Which effects break the tracking of a piece in pictures that our renderer did not make, and are they flagged first?

    python benchmarks/composites.py

The background is a photograph of a real table (tests/data/panda-realsense, camera 2). It is the median of twenty
pictures, so that the arm does not appear in it. An ellipsoid with the texture of another part of that photograph lies
on the table and moves in a straight line. Shading is added, noise as measured between the twenty pictures, and one
effect at a time. Depth is that of the plane and the ellipsoid, with the noise that a Kinect showed on a table. The
tracking is the program's own.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
import real_views

from calib.foreign.sizing import solve_any_size
from hw.poses import inverse
from hw.types import Array, CameraModel, Frame
from perception.errors import PerceptionError, TrackingFailed
from perception.geometry import on_plane, project
from perception.piece import find_piece, track_piece
from perception.types import ObjectTrack

HALF_M = (0.013, 0.012, 0.010)
FROM_PX, TO_PX = (90.0, 330.0), (150.0, 338.0)
ROWS, COLUMNS = slice(262, 412), slice(0, 260)  # the part of the picture that is made
FRAMES, RATE_HZ = 9, 30.0
DEPTH_NOISE_M = 0.0017  # the residual of the table in the Kinect recording, see docs/results/tracking.md
COLOUR = np.array([0.74, 0.24, 0.12])
LIMIT_MM, MOST_LOST = 5.0, 0.2
AWAY = np.block([[np.eye(3), np.array([[0.0], [3.0], [1.0]])], [np.zeros((1, 3)), np.ones((1, 1))]])
TOOL = (np.array([[0.0, 0, 0], [-0.1, 0.04, 0], [-0.1, -0.04, 0]]), np.array([[0, 1, 2]]))
ALWAYS = "camera pose not checked"


@dataclass(frozen=True)
class Effects:
    """What may be wrong with a picture, nothing by default. Light and blur change after the detection."""

    noise: float = 1.0  # times the measured one
    blur_px: float = 0.0  # along the motion
    gain: float = 1.0  # automatic exposure
    flicker: float = 0.0  # amplitude, of lamps against the frame rate
    red: float = 1.0  # automatic white balance
    shine: float = 0.0  # share of the piece's disc that a white spot covers
    shadow: float = 1.0  # light that is left in the shadow of a hand
    texture: float = 0.3  # how much of the photograph's texture the piece has
    alike: float = 0.0  # share of the table's colour in the piece's
    jpeg: int = 95


LEVELS: dict[str, tuple[float, ...]] = {
    "noise": (2.0, 4.0, 8.0),
    "blur_px": (8.0, 16.0, 24.0),
    "gain": (0.25, 0.1, 0.05, 1.6, 2.5),
    "flicker": (0.4, 0.8),
    "red": (1.05, 1.1, 1.2, 1.35),
    "shine": (0.15, 0.35, 0.6),
    "shadow": (0.5, 0.25, 0.12),
    "texture": (1.0, 2.0),
    "alike": (0.5, 0.7, 0.85),
    "jpeg": (40, 15),
}


class Room:
    """A real table and the camera before it, in a frame whose plane z = 0 is the table."""

    def __init__(self) -> None:
        pictures = [cv2.imread(str(real_views.DATA / f"camera-2-{i:02d}.jpg")) for i in range(real_views.POSTURES)]
        stack = np.stack([p for p in pictures if p is not None])[..., ::-1].astype(np.float32)
        whole = np.median(stack, axis=0)
        self.rgb, self.background = whole[ROWS, COLUMNS], whole.astype(np.uint8)
        off = stack[:, ROWS, COLUMNS] - self.rgb
        still = np.abs(off) < 12.0  # the shadow of the arm is not noise
        self.noise = float(np.sqrt((off[still] ** 2).mean()))
        camera = real_views.camera(2)
        self.model = CameraModel("realsense", camera, camera, np.eye(4))
        self.X_BC = self._on_table()
        self.texture = cv2.resize(whole[150:230, 520:580], (self.rgb.shape[1], self.rgb.shape[0]))
        K = camera.K
        directions = np.stack([(GRID[1] - K[0, 2]) / K[0, 0], (GRID[0] - K[1, 2]) / K[1, 1], np.ones_like(GRID[0])], -1)
        self.rays = directions.reshape(-1, 3).astype(np.float64)
        self.bare = self._bare_m()

    def _bare_m(self) -> Array:
        """(480, 640) depth of the bare table."""
        v, u = np.mgrid[0:480, 0:640]
        K = self.model.colour.K
        rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], axis=-1)
        down = rays @ self.X_BC[2, :3]
        return np.asarray(np.where(down < -1e-3, np.clip(-self.X_BC[2, 3] / np.minimum(down, -1e-3), 0.0, 4.0), 0.0))

    def _on_table(self) -> Array:
        """(4, 4) the camera over the table: base frame moved and tilted so that the markers on the table have z = 0."""
        X = [np.array(solve_any_size(real_views.views(k), real_views.setup(k), None)[0].X_AC) for k in range(3)]
        points = []
        for seen in real_views.room_corners():
            P = {k: real_views.camera(k).K @ inverse(X[k])[:3] for k in seen}
            for j in range(4):
                rows = [
                    row
                    for k, px in seen.items()
                    for row in (px[j, 0] * P[k][2] - P[k][0], px[j, 1] * P[k][2] - P[k][1])
                ]
                point = np.linalg.svd(np.array(rows))[2][-1]
                points.append(point[:3] / point[3])
        slope_x, slope_y, height_m = np.linalg.lstsq(
            np.c_[np.array(points)[:, :2], np.ones(len(points))], np.array(points)[:, 2], rcond=None
        )[0]
        z = np.array([-slope_x, -slope_y, 1.0]) / np.linalg.norm([-slope_x, -slope_y, 1.0])
        x = np.array([1.0, 0.0, slope_x]) / np.linalg.norm([1.0, 0.0, slope_x])
        X_BW = np.eye(4)
        X_BW[:3, :3], X_BW[2, 3] = np.column_stack([x, np.cross(z, x), z]), height_m
        return np.asarray(inverse(X_BW) @ X[2])

    def at(self, px: Sequence[float]) -> Array:
        """(2,) of the table under a pixel."""
        K = self.model.colour.K
        ray = np.array([[(px[0] - K[0, 2]) / K[0, 0], (px[1] - K[1, 2]) / K[1, 1], 1.0]])
        return np.asarray(on_plane(ray, self.X_BC, HALF_M[2])[0])


def composite(room: Room, xy_m: Array, effects: Effects, step_px: Array, turn: int, rng: np.random.Generator) -> Frame:
    """The frame with the piece at `xy_m` (2,), `turn` counts frames from the detection's, 0."""
    alpha, shade, depth = body(room, xy_m)
    colour = COLOUR * 255.0 * (1.0 - effects.alike) + effects.alike * table_colour(room, xy_m)
    patch = room.texture
    rough = 1.0 + effects.texture * (patch / patch.mean(axis=(0, 1)) - 1.0)
    skin = colour * rough * shade[..., None]
    if effects.shine:
        u, v = project(room.model.colour, inverse(room.X_BC), np.array([[*xy_m, 1.6 * HALF_M[2]]]))[0]
        spot = np.exp(
            -((((GRID[1] - u) ** 2 + (GRID[0] - v) ** 2) / max(effects.shine * alpha.sum() / np.pi, 1.0)) ** 2)
        )
        skin = skin + 330.0 * spot[..., None]
    picture = room.rgb * (1.0 - alpha[..., None]) + skin * alpha[..., None]
    if effects.blur_px and turn:
        picture = smeared(picture, effects.blur_px * step_px / np.linalg.norm(step_px))
    if turn:
        picture = lit(picture, effects, turn)
    noisy = picture + effects.noise * room.noise * rng.standard_normal(picture.shape)
    seen = np.clip(noisy, 0, 255).astype(np.uint8)
    data = cv2.imencode(".jpg", seen[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, int(effects.jpeg)))[1]
    back = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert back is not None
    whole = room.background.copy()
    whole[ROWS, COLUMNS] = back[..., ::-1]
    read = room.bare.copy()
    read[ROWS, COLUMNS] = depth + DEPTH_NOISE_M * rng.standard_normal(depth.shape)
    return Frame(turn / RATE_HZ, whole, np.rint(1e3 * read).astype(np.uint16))


GRID = np.mgrid[ROWS, COLUMNS].astype(np.float32)


def body(room: Room, xy_m: Array) -> tuple[Array, Array, Array]:
    """(h, w) each: share of the piece, its shading, depth of everything in m."""
    hit, cosine = sphere(room, xy_m, room.rays)
    shape = GRID[0].shape
    share, shade = np.isfinite(hit).astype(np.float64).reshape(shape), (0.55 + 0.55 * cosine).reshape(shape)
    depth = np.minimum(room.bare[ROWS, COLUMNS], hit.reshape(shape))
    soft = np.asarray(cv2.GaussianBlur(share, (0, 0), 0.6))
    return soft, np.asarray(cv2.GaussianBlur(shade, (0, 0), 0.6)), depth


def sphere(room: Room, xy_m: Array, rays: Array) -> tuple[Array, Array]:
    """Depth (n,) at which rays meet the piece, inf where they miss, and how far it faces up there, 0 to 1."""
    half = np.array(HALF_M)
    origin = (room.X_BC[:3, 3] - [*xy_m, HALF_M[2]]) / half
    along = rays @ room.X_BC[:3, :3].T / half
    a, b, c = (along**2).sum(axis=1), along @ origin, origin @ origin - 1.0
    root = b * b - a * c
    t = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
    normal = np.where(np.isfinite(t)[:, None], origin + np.where(np.isfinite(t), t, 0.0)[:, None] * along, 0.0) / half
    return t, np.clip(normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-9), 0.0, 1.0)


def table_colour(room: Room, xy_m: Array) -> Array:
    u, v = project(room.model.colour, inverse(room.X_BC), np.array([[*xy_m, 0.0]]))[0]
    near = (np.abs(GRID[1] - u) < 20) & (np.abs(GRID[0] - v) < 20)
    return np.asarray(np.median(room.rgb[near], axis=0))


def smeared(picture: Array, along_px: Array) -> Array:
    """Only moving pixels are smeared; a still region looks the same after smearing, except at its edges."""
    steps = [-0.5 + i / 8 for i in range(9)]
    size, edge = (picture.shape[1], picture.shape[0]), cv2.BORDER_REPLICATE
    moves = [np.array([[1.0, 0.0, s * along_px[0]], [0.0, 1.0, s * along_px[1]]]) for s in steps]
    shifted = [cv2.warpAffine(picture, move, size, borderMode=edge) for move in moves]
    return np.asarray(np.mean(shifted, axis=0))


def lit(picture: Array, effects: Effects, turn: int) -> Array:
    """Exposure, flicker, white balance and the shadow of a hand."""
    gain = effects.gain * (1.0 + effects.flicker * np.sin(2.1 * turn))
    light = picture * gain * np.array([effects.red, 1.0, 1.0 / effects.red])
    if effects.shadow < 1.0:
        edge = FROM_PX[0] + 18.0 * turn - 60.0
        deep = 1.0 / (1.0 + np.exp(-(GRID[1] - edge) / 6.0)) * (GRID[1] < edge + 120)
        light = light * (1.0 - deep[..., None] * (1.0 - effects.shadow * np.array([0.94, 1.0, 1.08])))
    return np.asarray(light)


@dataclass(frozen=True)
class Result:
    """How well an object was found and followed."""

    middle_mm: float
    worst_mm: float
    lost: float  # share of frames
    found: float  # confidence of the detection
    sure: float  # median confidence of the track
    flags: tuple[str, ...]
    failed: str = ""

    @property
    def broken(self) -> bool:
        return bool(self.failed) or self.worst_mm > LIMIT_MM or self.lost > MOST_LOST

    def __str__(self) -> str:
        told = "; ".join(self.flags) or "-"
        if self.failed:
            return f"REFUSED {self.failed}"
        state, off = "BROKEN" if self.broken else "ok", f"{self.middle_mm:5.1f} {self.worst_mm:6.1f} mm"
        return f"{state:7s} {off}  lost {self.lost:4.0%}  found {self.found:.2f} sure {self.sure:.2f}  {told}"


def judge(room: Room, effects: Effects, seed: int = 0) -> Result:
    """Find the piece, follow it, and compare with its true places."""
    rng = np.random.default_rng(seed)
    start, end = room.at(FROM_PX), room.at(TO_PX)
    way = [start + (end - start) * (max(i - 2, 0) / (FRAMES - 3)) ** 1.5 for i in range(FRAMES)]
    step_px = np.subtract(TO_PX, FROM_PX) / FRAMES
    frames = [composite(room, xy, effects, step_px, i, rng) for i, xy in enumerate(way)]
    area = (start[0] - 0.03, start[0] + 0.03, start[1] - 0.03, start[1] + 0.03)
    model, X_BC, began_s = room.model, room.X_BC, frames[1].t_s
    duration_s = frames[-1].t_s - began_s
    return judged(
        lambda: find_piece(frames[0], model, X_BC, area),
        lambda found: track_piece(frames[1:], model, X_BC, found, TOOL, lambda _: AWAY, began_s, duration_s),
        lambda track: np.array(way[1:]),
    )


def judged(
    find: Callable[[], Any], follow: Callable[[Any], ObjectTrack], places: Callable[[ObjectTrack], Array]
) -> Result:
    """Find an object, follow it, and compare with its true places (N, 2)."""
    try:
        found = find()
    except PerceptionError as error:
        return Result(0.0, 0.0, 1.0, 0.0, 0.0, (), f"not found: {error}")
    try:
        track = follow(found)
    except TrackingFailed as error:
        return Result(0.0, 0.0, 1.0, found.confidence, 0.0, (), f"not tracked: {error}")
    off_mm = 1e3 * np.linalg.norm(track.state[:, :2] - places(track), axis=1)
    return Result(
        middle_mm=float(np.median(off_mm)),
        worst_mm=float(off_mm.max()),
        lost=float((track.confidence <= 0).mean()),
        found=found.confidence,
        sure=float(np.median(track.confidence)),
        flags=tuple(flag for flag in track.flags if not flag.startswith(ALWAYS)),
    )


def spoilt(name: str, level: float) -> Effects:
    """One effect."""
    return Effects(jpeg=int(level)) if name == "jpeg" else Effects(**{name: level})  # type: ignore[arg-type]


def tell(levels: Mapping[str, Sequence[float]], judged: Callable[[str, float], Result]) -> None:
    """One line for each level of each effect."""
    for name, values in levels.items():
        for level in values:
            print(f"{name:9s} {level:6g}  {judged(name, level)}", flush=True)


def main() -> None:
    room = Room()
    print(f"noise of the pictures {room.noise:.2f} grey levels; plain: {judge(room, Effects())}")
    tell(LEVELS, lambda name, level: judge(room, spoilt(name, level)))


if __name__ == "__main__":
    main()
