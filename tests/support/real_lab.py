"""A real lab without its devices: rig file, calibration, and scripted devices where the drivers would be."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
from players import InstantArm
from rich.console import Console

from adaptsim_cli.bench import calibration_in_use
from adaptsim_cli.bench.devices.drivers import Drivers
from adaptsim_cli.bench.rig_file.waivers import Waivable, WaiverPart
from adaptsim_cli.config import Resolved
from adaptsim_cli.screen.console import Screen
from calib.saved import SavedCalibration, UncertaintyRecord
from calib.target_records import BoardRecord
from hw.errors import BalanceError, DeviceUnavailable
from hw.grasping import FakeHand
from hw.types import CameraModel, Frame, Intrinsics
from hw.workcell import Workcell
from perception.board.types import Board
from sim.lab.kinect import default_X_BC
from sim.tasks.scooping.spatula import ADAPTER_M


def waivers(*names: str, on: str = "") -> str:
    """The part of a rig file that waives these safeguards, from today on."""
    day = on or datetime.now(UTC).date().isoformat()
    entry = '[[waivers]]\nsafeguard = "{}"\nreason = "a lab of the tests"\nby = "Kim"\non = "{}"\n'
    return "".join(entry.format(name, day) for name in names)


def waiver(name: Waivable) -> WaiverPart:
    """From today on."""
    return WaiverPart(name, "a lab of the tests", "Kim", datetime.now(UTC).date().isoformat())


WAIVED = ("keep_out", "stop_button", "slow_start")
RIG = """\
name = "lab-1"
consent = "command"
[arm]
model = "panda"
address = "172.16.0.2"
[camera]
serial = "000123"
[pedal]
port = "/dev/ttyACM0"
[balance]
port = "/dev/ttyUSB0"
protocol = "sbi"
[person]
side = "left"
[tools.board.payload]
mass_kg = 0.45
[tools.scooping]
height_m = 0.002
[tools.scooping.payload]
mass_kg = 0.12
""" + waivers(*WAIVED)
READY_RAD = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
_PINHOLE = Intrinsics(64, 48, np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1.0]]))
MODEL = CameraModel("000123", _PINHOLE, _PINHOLE, np.eye(4))
HANDLE_M = ADAPTER_M[1]
DARK = Frame(0.0, np.zeros((48, 64, 3), np.uint8), np.full((48, 64), 900, np.uint16))


def write_rig(folder: Path, text: str = RIG) -> Path:
    path = folder / "rig.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def calibration(created: str = "2026-01-01T00:00:00+00:00") -> SavedCalibration:
    """As `adaptsim calibrate` leaves one, of the camera where the simulated lab has it."""
    u = UncertaintyRecord(
        sigma_mm=0.5, sigma_deg=0.05, position_95_mm=1.0, rotation_95_deg=0.1, worst_95_mm=1.5, arm_worst_95_mm=1.4,
        points_m=((0.0, 0.0, 0.0),), work_95_mm=(1.0,), arm_work_95_mm=(1.0,),
    )  # fmt: skip
    X_BC = tuple(tuple(map(float, row)) for row in default_X_BC())
    return SavedCalibration(
        mounting="fixed", X_AC=X_BC, X_HM=X_BC, joint_offsets=None, uncertainty=u, fit_px=0.1, held_out_px=0.1,
        corner_px=0.1, joint_rad=1e-4, square_scale=1.0, views=(), methods=(), checks=(), gates=(), accepted=True,
        created=created, source="calibrated", folder="views-0001", hw="panda", arm="panda", camera="000123",
        board=BoardRecord.from_board(Board()), versions={},
    )  # fmt: skip


def calibrated(resolved: Resolved) -> None:
    calibration_in_use.calibrations(resolved.config, resolved.places).save(calibration(), b"")


def typing(monkeypatch: pytest.MonkeyPatch, *answers: str) -> None:
    """What the person at the terminal types from now on."""
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{answer}\n" for answer in answers)))


def quiet() -> Screen:
    return Screen(console=Console(file=io.StringIO(), width=200, markup=False))


def said(screen: Screen) -> str:
    """What a `quiet` one was told, on one line."""
    file = screen._console.file
    assert isinstance(file, io.StringIO)
    return " ".join(file.getvalue().split())


class Untouched:
    """Drivers that may not be asked for anything."""

    def __getattr__(self, name: str) -> object:
        raise AssertionError(f"{name} was opened")


@dataclass
class ToyPedal:
    """`held` says for each look in turn whether it is pressed; the last stays. Not entered, it enables nothing."""

    held: list[bool] = field(default_factory=lambda: [True])
    port: str = ""
    connected: bool = False

    def __enter__(self) -> Self:
        self.connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self.connected = False

    def enabled(self) -> bool:
        return self.connected and (self.held.pop(0) if len(self.held) > 1 else self.held[0])

    def why_not(self) -> str:
        return "the pedal is released" if self.connected else "the pedal is not connected"


@dataclass
class ToyBalance:
    """Gives the masses in turn; None is a pan that still moves."""

    masses_kg: list[float | None]
    connected: bool = False

    def __enter__(self) -> Self:
        self.connected = True
        return self

    def __exit__(self, *exc: object) -> None:
        self.connected = False

    def mass_kg(self) -> float:
        if not self.connected:
            raise DeviceUnavailable("the balance is not connected: use it inside a `with` block")
        mass = self.masses_kg.pop(0)
        if mass is None:
            raise BalanceError("the balance is not at rest")
        return mass


class DarkCamera:
    """It sees nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None: ...

    def model(self) -> CameraModel:
        return MODEL

    def snapshot(self) -> Frame:
        return DARK

    def newest(self) -> np.ndarray | None:
        return None

    def start_recording(self) -> None: ...

    def stop_recording(self) -> Sequence[Frame]:
        return (DARK,)


@dataclass
class ToyDevices:
    """`Drivers` over scripted devices; `opened` tells which were asked for, oldest first, and with what."""

    q_rad: np.ndarray = field(default_factory=lambda: READY_RAD)
    pedal: ToyPedal = field(default_factory=ToyPedal)
    balance: ToyBalance = field(default_factory=lambda: ToyBalance([0.5]))
    lacking: str = ""  # of this device the driver is not installed
    opened: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    hand: FakeHand = field(default_factory=lambda: FakeHand(HANDLE_M, holds=True))
    arm: InstantArm | None = None

    def drivers(self) -> Drivers:
        return Drivers(arm=self._arm, camera=self._camera, pedal=self._pedal, balance=self._balance, hand=self._hand)

    def drivers_of_a_stopped_arm(self) -> Drivers:
        """Its arm was stopped by a reflex before it is connected."""

        def stopped(*args: Any, **given: Any) -> InstantArm:
            arm = self._arm(*args, **given)
            arm._fault = "cartesian_reflex"
            return arm

        return replace(self.drivers(), arm=stopped)

    def _arm(self, cell: Workcell, settings: Any, pedal: Any) -> InstantArm:
        self._open("arm", cell=cell, settings=settings, pedal=pedal)
        self.arm = InstantArm(self.q_rad, cell, settings=settings)
        return self.arm

    def _hand(self, model: str, host: str, pedal: Any) -> FakeHand:
        self._open("hand", model=model, host=host, pedal=pedal)
        return self.hand

    def _camera(self, part: Any, infrared: bool) -> DarkCamera:
        self._open("camera", part=part, infrared=infrared)
        return DarkCamera()

    def _pedal(self, part: Any) -> ToyPedal:
        self._open("pedal", port=part.port)
        return self.pedal

    def _balance(self, part: Any) -> ToyBalance:
        self._open("balance", part=part)
        return self.balance

    def _open(self, name: str, **given: Any) -> None:
        if name == self.lacking:
            raise DeviceUnavailable(f"{name}: the driver is not installed; run: pip install {name}-driver==1.0")
        self.opened[name] = given
