"""The simulated lab: a world hidden from learning and tracking. It asks the same questions as a real arm."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING

import numpy as np

from adaptsim_cli.bench.devices.known_arm import KnownArm, StopMeasurement, folder_of
from adaptsim_cli.bench.devices.lab import BoardDevices, TouchDevices
from adaptsim_cli.bench.devices.mounted import MountedTask
from adaptsim_cli.bench.devices.pacing import PacedArm
from adaptsim_cli.bench.devices.released import ReleasedArm, ReleasedHand
from adaptsim_cli.bench.devices.stop_check import measurement, swing, swinging
from adaptsim_cli.bench.rig import Rig
from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.config import SIMULATED, places
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.keys import Key
from adaptsim_cli.screen.release import Release, before_first, require_word
from calib.types import HandEye
from hw.braking import FULL, brake
from hw.collision import KeepOut
from hw.franka.motions import BUTTON, StopReport
from hw.kinematics import forward
from hw.ports import Arm
from hw.types import Array
from hw.workcell import Workcell
from sim.tasks.task import Task

if TYPE_CHECKING:
    from sim.lab.board import HeldBoard
    from sim.lab.world import World


def nominal_hand_eye(world: World, seed: int) -> HandEye:
    """The nominal calibration of a world, with the world's error."""
    from sim.lab.calibrating import nominal_X_BC

    source = "nominal calibration of the simulated lab, with the world's extrinsic error"
    sigma_mm, sigma_deg = world.sensing.extrinsic_error_mm, world.sensing.extrinsic_error_deg
    return HandEye(nominal_X_BC(world, seed), sigma_mm, sigma_deg, source, created="")


class WorldLab:
    """`devices.lab.Lab`: one task in one world."""

    def __init__(
        self,
        task: Task,
        world: World,
        seed: int,
        stack: ExitStack,
        rig: RigDescription,
        *,
        realtime: bool = False,
        pace: float = FULL,
        screen: Screen | None = None,
    ) -> None:
        """With a `screen`, questions are asked before anything moves, as with a real arm; with None there are no
        questions.
        """
        self.rig, self.title = rig, f"simulated lab, world {world.name}"
        self.nominal = nominal_hand_eye(world, seed)
        self._task, self._world, self._seed, self._stack = task, world, seed, stack
        self._realtime, self._pace, self._screen = realtime, pace, screen

    def boxes_around_camera(self, X_BC: Array) -> tuple[KeepOut, ...]:
        """There are none, because no trial comes near the simulated camera."""
        return ()

    def note(self, message: str) -> None:
        """Does nothing, because nobody stands beside the arm."""

    def for_trials(self, mounted_task: MountedTask, hand_eye: HandEye, days: int) -> Rig:
        """See `Lab`."""
        from sim.lab.simulated import SimulatedLab

        lab = SimulatedLab(self._task, self._world, self._seed, mounted_task.cell, home_q_rad=mounted_task.home_rad)
        self._stack.enter_context(lab)
        release = self._release("nothing on the table but the object")
        arm = PacedArm[Arm](ReleasedArm[Arm](lab.arm, release), mounted_task.cell, self._pace, realtime=self._realtime)
        return Rig(
            name=SIMULATED,
            title=self.title,
            arm=arm,
            camera=lab.camera,
            bench=lab.bench,
            hand_eye=hand_eye,
            calibration_days=days,
            await_enabled=release.path,
            pace=self._pace,
            release=release,
        )

    def for_calibration(self, held: HeldBoard, cell: Workcell, home_rad: Array) -> BoardDevices:
        """See `Lab`."""
        from sim.lab.calibrating import CalibrationLab

        lab = CalibrationLab(self._task, self._world, self._seed, held, cell, home_q_rad=home_rad)
        self._stack.enter_context(lab)
        release = self._release("nothing on the table but the object")
        arm = PacedArm[Arm](ReleasedArm[Arm](lab.arm, release), cell, self._pace, realtime=self._realtime)
        return arm, lab.camera, lambda _: None, lab.hands, release

    def for_touch_off(self, cell: Workcell) -> TouchDevices:
        """See `Lab`. A simulated person hands the tool over, and sets it down."""
        from sim.lab.simulated import READY_RAD
        from sim.lab.touch import TouchLab

        ready_rad = cell.arm.reported_rad(READY_RAD)
        lab = self._stack.enter_context(TouchLab(self._task, self._world, self._seed, cell, home_q_rad=ready_rad))
        release = self._release("nothing on the table")
        return lab.arm, ReleasedHand(lab.hand, release), lambda _: None, lab, release

    def measure_stop(self, mounted_task: MountedTask) -> StopMeasurement:
        """See `Lab`. A stand-in presses the button at a moment of its own; the arm brakes along its path."""
        from sim.lab.simulated import SimulatedLab

        lab = SimulatedLab(self._task, self._world, self._seed, mounted_task.cell, home_q_rad=mounted_task.home_rad)
        self._stack.enter_context(lab)
        release = self._release("nothing on the table")
        path = swing(lab.arm.state().q_rad, mounted_task.cell)
        press_s = float(np.random.default_rng(self._seed).uniform(0.2, 0.8)) * path.duration_s
        braked = brake(path, press_s, mounted_task.cell.motion)
        release.one(swinging(path), braked.digest, "The arm swings until a stand-in presses the stop button.")
        played = ReleasedArm[Arm](lab.arm, release).execute(braked)
        after = played.t_s >= press_s
        q_rad = played.q_measured_rad[after]
        way_m = float(np.linalg.norm(np.diff(forward(q_rad)[:, :3, 3], axis=0), axis=1).sum())
        stopped = StopReport(BUTTON, press_s, 0.0, float(played.t_s[-1]) - press_s, way_m, 0.0, q_rad)
        stop = measurement(stopped, path, mounted_task.cell, "a stand-in")
        KnownArm(folder_of(places(), self.rig)).stop_measured(stop)
        return stop

    def _release(self, table: str) -> Release:
        """The questions before a motion."""
        model, screen = self.rig.arm.model, self._screen

        def first() -> None:
            if screen is not None:
                screen.note(before_first("The simulated robot", table, pedal=False))
                agreed = Key(model, "to confirm", "The arm may move; the program still asks before it does.")
                require_word(screen, "Have you checked all of this?", agreed)

        return Release(screen, model, False, self.rig.consent or "motion", first)
