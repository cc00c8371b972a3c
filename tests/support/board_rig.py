"""A bench for calibrations in memory: an arm that is at once where it is sent, a camera that draws the board.

`hooks` are called with the number of the picture and may raise, or move the arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from real_lab import quiet

from adaptsim_cli.bench.calibration import board_mover, flow
from adaptsim_cli.bench.calibration.parts import CalibrationRig, Ways
from adaptsim_cli.bench.calibration.solving import SolvedFolder
from adaptsim_cli.bench.calibration.store import CalibrationStore
from adaptsim_cli.screen.console import Screen
from calib import poses
from hw.errors import CameraError
from hw.kinematics import forward
from hw.types import ArmState, Array, CameraModel, Execution, Frame, Intrinsics, JointPath
from perception.board import draw
from perception.board.types import Board
from sim.lab.arm import laid_board, touching_q_rad
from sim.lab.board import HeldBoard
from sim.lab.kinect import default_X_BC
from sim.panda.postures import postures
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

CAMERA = Intrinsics(640, 360, np.array([[413.0, 0, 319.0], [0, 413.0, 181.0], [0, 0, 1]]))
_SQUARE_PX = 42
_FINE = 2


@lru_cache
def _print(across: int, down: int, dictionary: str) -> NDArray[np.uint8]:
    return draw(Board(across, down, dictionary=dictionary), _SQUARE_PX, margin_px=_SQUARE_PX // 3)


def picture(X_CM: Array, board: Board, camera: Intrinsics = CAMERA, seed: int = 0) -> NDArray[np.uint8]:
    """(H, W, 3) RGB of the board at X_CM (4, 4) before a grey wall, with a little blur and noise."""
    ink = _print(board.squares_across, board.squares_down, board.dictionary)
    margin = _SQUARE_PX // 3
    per_px = board.square_m / _SQUARE_PX
    to_board = np.array([[per_px, 0, -(margin - 0.5) * per_px], [0, per_px, -(margin - 0.5) * per_px], [0, 0, 1]])
    fine = np.array([[_FINE, 0, (_FINE - 1) / 2], [0, _FINE, (_FINE - 1) / 2], [0, 0, 1]])
    H = fine @ camera.K @ X_CM[:3, [0, 1, 3]] @ to_board
    size = (_FINE * camera.width, _FINE * camera.height)
    grey = cv2.warpPerspective(
        (30 + 0.8 * ink).astype(np.uint8),
        H,
        size,
        flags=cv2.INTER_AREA,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=110,
    )
    small = cv2.resize(grey, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(seed).normal(0, 1.0, small.shape)
    rgb = np.clip(cv2.GaussianBlur(small, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(np.repeat(rgb[..., None], 3, axis=2))


BOARD = Board()
COUNT = 12
NEAR_RAD = (0.0, -0.8, 0.0, -2.2, 0.0, 1.9, -0.785)
X_BC = default_X_BC()
_DEPTH = Intrinsics(32, 32, np.array([[30.0, 0, 16], [0, 30.0, 16], [0, 0, 1]]))
MODEL = CameraModel("toy-camera", CAMERA, _DEPTH, np.eye(4))
_HELD = HeldBoard(np.zeros((2, 2), np.uint8), BOARD.size_m)
_CELL = cell_as_shipped(get_task("scooping").require_hardware(), "panda").holding(_HELD.tool())


@lru_cache
def places(count: int) -> Array:
    """(count, 7) postures that show the board in many ways."""
    X_CM = poses.candidates(CAMERA, BOARD, 256, (0.45, 1.0))
    found = postures(X_BC @ X_CM @ np.linalg.inv(_HELD.X_FM), _CELL, NEAR_RAD)
    able = [i for i, q in enumerate(found) if q is not None]
    chosen = [able[i] for i in poses.spread(X_CM[able], BOARD, count)]
    assert len(chosen) == count
    return np.array([found[i] for i in chosen])


@dataclass
class ToyBench:
    """Arm and camera; what a test wants to be wrong is set on it."""

    X_FM: Array = field(default_factory=lambda: _HELD.X_FM)  # as the board really is held
    X_BC: Array = field(default_factory=lambda: X_BC)
    printed: Board = BOARD  # what really hangs there
    paint: Callable[[NDArray[np.uint8]], NDArray[np.uint8]] = lambda image: image
    q_rad: Array = field(default_factory=lambda: np.array(NEAR_RAD))
    t_s: float = 0.0
    fault: str | None = None
    by_hand: bool = False  # the fault ends when a person lets go
    hooks: list[Callable[[ToyBench, int], None]] = field(default_factory=list)
    pictures: int = 0
    motions: int = 0
    recording: list[JointPath] | None = None
    model_name: str = "panda"
    X_BM_laid: Array | None = None  # the board on the table
    warmth_C: Callable[[int], float | None] = lambda picture: None  # of the camera at the picture of that number

    @property
    def model(self) -> str:
        return self.model_name

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        return

    def state(self) -> ArmState:
        return ArmState(self.t_s, self.q_rad, np.zeros(7), self.fault, self.by_hand)

    def execute(self, path: JointPath) -> Execution:
        self.motions += 1
        if self.recording is not None:
            self.recording.append(path)
        started, self.t_s, self.q_rad = self.t_s, self.t_s + path.duration_s, path.q_rad[-1]
        return Execution(started, path.t_s, path.q_rad, path.q_rad, 1.0)

    def recover(self) -> None:
        self.fault = None


@dataclass
class ToyCamera:
    bench: ToyBench

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        return

    def model(self) -> CameraModel:
        return MODEL

    def snapshot(self) -> Frame:
        bench = self.bench
        bench.pictures += 1
        frame = self._frame(bench.t_s, bench.q_rad)
        for hook in bench.hooks:
            hook(bench, bench.pictures)
        return frame

    @property
    def temperature_C(self) -> float | None:
        return self.bench.warmth_C(self.bench.pictures)

    def start_recording(self) -> None:
        self.bench.recording = []

    def newest(self) -> np.ndarray | None:
        return None

    def stop_recording(self) -> Sequence[Frame]:
        shots, self.bench.recording = self.bench.recording, None
        if shots is None:
            raise CameraError("the camera is not recording")
        frames: list[Frame] = []
        for path in shots:
            since = self.bench.t_s - path.duration_s
            for i in range(20, len(path.t_s), 60):
                frames.append(self._frame(since + path.t_s[i], path.q_rad[i]))
        return frames

    def _frame(self, t_s: float, q_rad: Array) -> Frame:
        laid = self.bench.X_BM_laid
        X_BM = forward(q_rad) @ self.bench.X_FM if laid is None else laid
        X_CM = np.linalg.inv(self.bench.X_BC) @ X_BM
        image = picture(X_CM, self.bench.printed, seed=round(1e3 * t_s))
        return Frame(t_s, self.bench.paint(image), np.zeros((32, 32), np.uint16))


@dataclass
class ToyHands:
    """Lays the board flat before the camera and guides a tip to it; `slip_m` is how far the tip misses at a touch."""

    bench: ToyBench
    slip_m: Callable[[int], float] = lambda number: 0.0

    def lay_board(self) -> None:
        self.bench.X_BM_laid = laid_board(_HELD, np.random.default_rng(0))

    def touch(self, p_M_m: Array, number: int) -> None:
        laid = self.bench.X_BM_laid
        assert laid is not None
        p_B_m = laid[:3, :3] @ p_M_m + laid[:3, 3] + np.array([0.0, self.slip_m(number), 0.0])
        self.bench.q_rad = touching_q_rad(p_B_m, number, np.random.default_rng(number))


def straight(q_from: Array, q_to: Array) -> JointPath:
    t_s = np.linspace(0.0, 0.6, 601)
    share = t_s / t_s[-1]
    smooth = share**3 * (10 - 15 * share + 6 * share**2)
    return JointPath(t_s, q_from + smooth[:, None] * (q_to - q_from))


def rig(
    bench: ToyBench, name: str = "fake", board: Board = BOARD, way: Any = straight, hands: ToyHands | None = None
) -> CalibrationRig:
    return CalibrationRig(
        name=name,
        title="toy bench",
        key="toy",
        arm=bench,
        camera=ToyCamera(bench),
        board=board,
        X_FM=_HELD.X_FM,
        rough_X_BC=X_BC,
        ways=Ways(lambda X_BF: [None] * len(X_BF), way),
        pause=lambda _: None,
        hands=hands,
    )


def run(
    tmp_path: Path, bench: ToyBench, q_rad: Array | None = None, screen: Screen | None = None, **options: Any
) -> tuple[SolvedFolder, Path]:
    """A whole calibration of the bench, unattended unless `unattended` says otherwise."""
    unattended = options.pop("unattended", True)
    the_rig, screen = rig(bench, **options), screen or quiet()
    q = places(COUNT) if q_rad is None else q_rad
    going = board_mover.Automatic(the_rig, screen, q, np.array(NEAR_RAD), unattended=True)
    made = "2024-05-01T10:00:00+00:00"
    return flow.calibrate(the_rig, store(tmp_path), going, screen, fresh=False, unattended=unattended, created=made)


def store(tmp_path: Path) -> CalibrationStore:
    return CalibrationStore(tmp_path / "calibrations" / "toy")
