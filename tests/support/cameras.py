"""Every camera of the program before a scene that a test steers: simulated, recorded, driven over a stand-in, real."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import plain_lab
from camera_stage import DELAY_S, enter, while_shown
from fake_k4a import PERIOD_S, FakeK4a, frames, kinect_library, threaded
from staged_realsense import SoftRealSense

from hw.camera.k4a_device import ColourSettings
from hw.camera.process import CameraProcess
from hw.camera.served import Device
from hw.joint_limits import LIMITS
from hw.ports import Camera
from hw.types import CameraModel, Frame
from perception.board import Board, draw
from sim.lab.board import HeldBoard
from sim.lab.calibrating import CalibrationLab
from sim.lab.simulated import READY_RAD, SimulatedLab
from sim.lab.world import Faults
from sim.panda.moves import move_path

RATE_HZ = 30.0


def _nothing() -> None:
    return


@dataclass(frozen=True)
class Scene:
    """A camera, and what a test may do before it."""

    camera: Camera
    now_s: Callable[[], float]  # the arm's clock
    passes: Callable[[], None] = _nothing  # some time, with something to film
    spoil: Callable[[], None] | None = None  # the recording that begins next fails; None: recordings never do
    rate_hz: float = RATE_HZ


def lab() -> Scene:
    """The rendered camera of trials, which fails in its second. Nothing moves: a recording shows the piece at rest."""
    built = SimulatedLab(plain_lab.TASK, plain_lab.world(faults=Faults(camera_timeout=(2,))), 0, plain_lab.CELL)
    xy_m = plain_lab.XY_M
    built.bench.place(xy_m, trial=1, attempt=0)
    arm = built.arm.__enter__()
    return Scene(built.camera, lambda: arm.state().t_s, spoil=lambda: built.bench.place(xy_m, 2, 0))


def board_lab() -> Scene:
    """The rendered camera of calibrations: it films motions alone."""
    board = Board()
    held = HeldBoard(draw(board, 112), board.size_m)
    built = CalibrationLab(plain_lab.TASK, plain_lab.world(), 0, held, plain_lab.CELL, home_q_rad=READY_RAD)
    built.arm.__enter__()
    away_rad = READY_RAD + np.array([0.05, 0, 0, 0, 0, 0, 0])

    def swing() -> None:
        q_rad = built.arm.state().q_rad
        there_rad = away_rad if np.allclose(q_rad, READY_RAD) else READY_RAD
        built.arm.execute(move_path(q_rad, there_rad, LIMITS["panda"]))

    return Scene(built.camera, lambda: built.arm.state().t_s, swing, rate_hz=15.0)


class Staged:
    """A camera on a stage, and somebody who shows it captures whenever it waits for one."""

    def __init__(self, make: Callable[[], FakeK4a | SoftRealSense]) -> None:
        settings = ColourSettings()
        self._make, self._library = make, make()
        self._camera = threaded(
            self._driver, self.now_s, settings=settings, latency_s=DELAY_S - 0.5e-6 * settings.exposure_us
        )
        self._next_s = self.now_s()  # middle of the next exposure
        self.loses = False  # every other capture of the next film

    def _driver(self, now_s: Callable[[], float]) -> Device:
        return self._library.driver(now_s)

    def now_s(self) -> float:
        return self._library.clock.now_s()

    def __enter__(self) -> Self:
        started, self._library = self.now_s(), self._make()
        self._library.clock.advance_to(started)
        self._next_s = started
        enter(self._camera, lambda: self.show(20))
        return self

    def __exit__(self, *exc: object) -> None:
        self._library.end()
        self._camera.__exit__()
        assert not self._library.handles
        assert not self._library.open

    def model(self) -> CameraModel:
        return self._camera.model()

    def snapshot(self) -> Frame:
        return while_shown(self._library, self._camera.snapshot, lambda: self.show(3))

    def start_recording(self) -> None:
        self._camera.start_recording()

    def stop_recording(self) -> Sequence[Frame]:
        return while_shown(self._library, self._camera.stop_recording, lambda: self.show(3))

    def show(self, count: int) -> None:
        shown = frames(self._next_s, count)
        self._next_s += count * PERIOD_S
        self._library.show(*(shown[::2] if self.loses else shown))

    def newest(self) -> np.ndarray | None:
        return self._camera.newest()

    def film(self) -> None:
        self.show(12)
        self.loses = False

    def spoil(self) -> None:
        self.loses = True


def _library() -> FakeK4a:
    return kinect_library(FakeK4a("A1"))


def kinect() -> Scene:
    staged = Staged(_library)
    return Scene(staged, staged.now_s, staged.film, staged.spoil)


def realsense() -> Scene:
    """On the SDK's own software device: the real library, without a device."""
    staged = Staged(SoftRealSense)
    return Scene(staged, staged.now_s, staged.film, staged.spoil)


def real_kinect() -> Scene:
    """The camera that is plugged in, or the one with the serial number in ADAPTSIM_TEST_CAMERA."""
    camera = CameraProcess(os.environ.get("ADAPTSIM_TEST_CAMERA"))

    def pictures() -> None:
        for _ in range(10):
            camera.snapshot()

    return Scene(camera, time.monotonic, pictures)
