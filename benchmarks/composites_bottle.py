"""Tracks a bottle in depth that our renderer did not make: which effects break the tracking, and is it flagged first?

    python benchmarks/composites_bottle.py
    python benchmarks/composites_bottle.py --from recording.mkv     cut the readings out of the recording again

Noise and holes are those of a real Azure Kinect (tests/data/azure-kinect, cut from a recording of pyk4a's): the noise
of a wall, and the readings that are missing on a printed, shining mug. The bottle wears the mug's holes. Table and
bottle are met by rays, in the view of the planned workcell; the bottle is pushed 25 cm in 0.5 s and rests. Effects are
added one at a time. Tracking is the product's, unchanged.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from composites import Result, judged, tell

from adaptsim_cli.bench.devices.trackers import BOTTLE_AREA
from hw.types import Array, CameraModel, Frame
from perception.arm_mask import NO_ARM
from perception.bottle import find_bottle, track_bottle
from perception.cylinder import Cylinder
from perception.scan import Mask
from sim.lab.kinect import default_X_BC, kinect_model
from sim.tasks.pushing.params import BOTTLE_HEIGHT_M, BOTTLE_RADIUS_M, START_M

DATA = Path(__file__).parents[1] / "tests" / "data" / "azure-kinect" / "readings.npz"
WALL, MUG = (slice(170, 298), slice(60, 188)), (slice(330, 515), slice(132, 270))  # of the recording's depth picture
BODY = Cylinder(BOTTLE_RADIUS_M, BOTTLE_HEIGHT_M)
START_S, PUSHED_S, LAST_S, RATE_HZ = 0.1, 0.5, 0.9, 30.0
WAY_M = np.array([0.25, 0.05])


@dataclass(frozen=True)
class Effects:
    """The errors of a depth camera."""

    noise: float = 1.0  # times the wall's
    missing: int = 0  # pixels by which the mug's holes are widened; -1: no holes
    ring_px: int = 2  # readings that are missing around the bottle's outline
    flying_px: int = 1  # width of the edge whose readings lie between bottle and table
    echo_mm: float = 0.0  # by which the bottle's lower half is read too far: light that comes by the table
    scale: float = 1.0  # of all depth: a cold camera
    thin: float = 0.0  # share of all readings that is missing: a dark table


LEVELS: dict[str, tuple[float, ...]] = {
    "noise": (2.0, 4.0, 8.0),
    "missing": (-1, 2, 4, 6),
    "ring_px": (4, 6, 8, 10),
    "flying_px": (2, 4, 6),
    "echo_mm": (2.0, 5.0, 10.0, 20.0),
    "scale": (1.002, 1.005, 1.01, 1.02),
    "thin": (0.3, 0.6, 0.8, 0.9),
}


class Room:
    """The view of the planned workcell, with the faults of a real camera."""

    def __init__(self) -> None:
        self.model: CameraModel = kinect_model()
        self.X_BC = default_X_BC()
        with np.load(DATA, allow_pickle=False) as data:
            self.noise_mm, self.holes = data["noise_mm"].astype(float), data["missing"]
        camera = self.model.depth
        v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(np.float64)
        pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
        normal = cv2.undistortPoints(pixels, camera.K, camera.distortion).reshape(-1, 2)
        self.rays = np.column_stack([normal, np.ones(len(normal))]).reshape(camera.height, camera.width, 3)
        self.X_BD = self.X_BC @ self.model.X_CD
        down = self.rays @ self.X_BD[2, :3]
        self.table_m = np.where(down < -1e-3, -self.X_BD[2, 3] / np.minimum(down, -1e-3), 0.0)
        self.table_m[self.table_m > 3.0] = 0.0

    def bottle_m(self, xy_m: Array) -> Array:
        """(h, w) depth at which rays meet an upright bottle; inf where they miss."""
        origin = self.X_BD[:3, 3] - [xy_m[0], xy_m[1], 0.0]
        along = self.rays @ self.X_BD[:3, :3].T
        a = (along[..., :2] ** 2).sum(axis=-1)
        b, c = along[..., :2] @ origin[:2], origin[:2] @ origin[:2] - BODY.radius_m**2
        root = b * b - a * c
        side = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
        height = origin[2] + np.where(np.isfinite(side), side, 0.0) * along[..., 2]
        side[(height < 0.0) | (height > BODY.height_m)] = np.inf
        top = (BODY.height_m - origin[2]) / np.minimum(along[..., 2], -1e-6)
        at = origin[:2] + top[..., None] * along[..., :2]
        top[(at**2).sum(axis=-1) > BODY.radius_m**2] = np.inf
        return np.asarray(np.minimum(side, top))


def composite(room: Room, xy_m: Array, t_s: float, effects: Effects, rng: np.random.Generator) -> Frame:
    """The frame with the bottle at `xy_m` (2,)."""
    bottle = room.bottle_m(xy_m)
    on = np.isfinite(bottle)
    depth = np.where(on, bottle, room.table_m)
    rows, columns = (np.flatnonzero(on.any(axis=axis)) for axis in (1, 0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    if effects.echo_mm:
        lower = np.zeros_like(on)
        lower[(rows[0] + rows[-1]) // 2 : rows[-1] + 1] = True
        depth = depth + 1e-3 * effects.echo_mm * (on & lower)
    edge = _grown(on, effects.flying_px) & _grown(~on, effects.flying_px) if effects.flying_px else np.zeros_like(on)
    share = rng.random(on.shape)
    depth = np.where(edge, share * np.where(on, bottle, depth) + (1 - share) * room.table_m, depth)
    depth = effects.scale * depth + 1e-3 * effects.noise * _tiled(room.noise_mm, on.shape, rng)
    missing = rng.random(on.shape) < effects.thin
    if effects.missing >= 0:
        shape = (box[0].stop - box[0].start, box[1].stop - box[1].start)
        worn = cv2.resize(room.holes.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
        missing[box] |= _grown(worn, effects.missing) & on[box]
    outside = _grown(on, effects.ring_px) & ~on
    missing |= outside
    read = np.where(missing | (room.table_m == 0.0) & ~on, 0.0, depth)
    colour = np.zeros((room.model.colour.height, room.model.colour.width, 3), np.uint8)
    return Frame(t_s, colour, np.rint(1e3 * np.clip(read, 0.0, 10.0)).astype(np.uint16))


def _grown(mask: Mask, by_px: int) -> Mask:
    if by_px <= 0:
        return mask
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((2 * by_px + 1, 2 * by_px + 1), np.uint8)) > 0)


def _tiled(patch: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """The patch beside its mirror images, from a random corner on: its noise, no repeated edges."""
    mirrored = np.block([[patch, patch[:, ::-1]], [patch[::-1], patch[::-1, ::-1]]])
    times = [-(-n // m) for n, m in zip(shape, mirrored.shape, strict=True)]
    moved = np.roll(mirrored, rng.integers(0, mirrored.shape[0], 2), axis=(0, 1))
    return np.asarray(np.tile(moved, times)[: shape[0], : shape[1]])


def judge(room: Room, effects: Effects, seed: int = 0) -> Result:
    """Find the bottle, follow it, and compare with its true places."""
    rng = np.random.default_rng(seed)
    first = composite(room, START_M, -1.0, effects, rng)
    frames = (composite(room, place(t), t, effects, rng) for t in np.arange(0.0, LAST_S, 1 / RATE_HZ))
    model, X_BC, end_s = room.model, room.X_BC, START_S + PUSHED_S
    return judged(
        lambda: find_bottle(first, model, X_BC, BODY, BOTTLE_AREA, START_M, within_m=0.02),
        lambda found: track_bottle(list(frames), model, X_BC, found, lambda _: NO_ARM, 0.0, end_s, BOTTLE_AREA),
        lambda track: np.array([place(t) for t in track.t_s]),
    )


def place(t_s: float) -> Array:
    """(2,) where the bottle is."""
    s = np.clip((t_s - START_S) / PUSHED_S, 0.0, 1.0)
    return np.asarray(START_M + WAY_M * s * s * (3.0 - 2.0 * s))


def spoilt(name: str, level: float) -> Effects:
    """One effect."""
    return Effects(**{name: int(level) if name in ("missing", "ring_px", "flying_px") else level})  # type: ignore[arg-type]


def cut(recording: Path) -> None:
    """Store the needed part of the recording. Needs PyAV (`pip install av`)."""
    from kinect_recording import KinectRecording  # noqa: PLC0415 - an extra

    with KinectRecording(recording) as opened:
        depth_mm = next(opened.frames()).depth_mm.astype(np.float64)
    wall = depth_mm[WALL]
    v, u = np.mgrid[0 : wall.shape[0], 0 : wall.shape[1]] / wall.shape[0]
    terms = np.stack([u**i * v**j for i in range(4) for j in range(4 - i)], axis=-1)  # a wall seen through a lens
    known = wall > 0
    weights = np.linalg.lstsq(terms[known], wall[known], rcond=None)[0]
    noise = np.where(known, wall - terms @ weights, 0.0)
    DATA.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(DATA, noise_mm=noise.astype(np.float32), missing=depth_mm[MUG] == 0)
    print(
        f"{DATA}: noise of {noise.std():.2f} mm at {np.median(wall):.0f} mm, {(depth_mm[MUG] == 0).mean():.0%} missing"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--from", dest="recording", type=Path, help="cut the readings out of this recording first")
    args = parser.parse_args()
    if args.recording:
        cut(args.recording)
    room = Room()
    print(f"noise {room.noise_mm.std():.2f} mm, holes {room.holes.mean():.0%}; plain: {judge(room, Effects())}")
    tell(LEVELS, lambda name, level: judge(room, spoilt(name, level)))


if __name__ == "__main__":
    main()
