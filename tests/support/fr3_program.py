"""The `adaptsim` program in a lab whose arm is the FR3 adapter talking to franky-sim, and whose pedal is a serial line.

    python fr3_program.py CUE_FD WORLD -- run-iteration --hw fr3 ...

Only the makers' drivers are replaced: the arm's is the real adapter with a player that needs no real-time kernel, the
pedal's is the real one. The camera shows the simulated room, in which table, object and tool go through every motion
with the joints that the FR3 measured; a person who puts the object down is its bench. Before each motion its name
(home, approach, task, back) goes to CUE_FD, and nothing moves until a line comes back: a test arms its fault there. A
word in that line is a fault of what the program itself has: "camera" gives no frame until the next motion, "disk" is
full.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np

from adaptsim_cli.bench.devices import drivers, real
from adaptsim_cli.commands import app
from hw.errors import CameraError
from hw.franka.arm import FrankaArm, franka
from hw.franka.playback import Timing
from hw.ports import ArmWrapper
from hw.serial import pedal_protocol
from hw.types import CameraModel, Execution, Frame, JointPath
from hw.workcell import Workcell
from sim.lab.camera import LabCamera
from sim.lab.kinect import default_X_BC
from sim.lab.room import Room
from sim.lab.world import load_world
from sim.panda.planning import home
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

SILENCE_S = 5.0
"""Of the pedal, instead of 0.06 s: a busy computer is no fault of its cable."""
PATIENT = Timing(realtime=False, silence_s=20.0, start_s=60.0, unwatched_s=60.0, overrun_s=600.0)


class Shown:
    """The simulated room as the place where the FR3 stands: its clock is brought to the arm's."""

    def __init__(self, world: str, seed: int) -> None:
        task = get_task("scooping")
        hardware = task.require_hardware()
        home_rad = home(hardware.X_FT, cell_as_shipped(hardware, "fr3"), hardware.home_pitch_rad)
        self.room = Room(task, load_world(world, task), seed, home_rad)
        self.offset_s = 0.0  # arm's clock less the room's, in the last motion
        self.is_placed = False
        self.is_blind = False  # the camera gives no frame any more

    def follow(self, path: JointPath, played: Execution) -> None:
        """What the FR3 did, as it measured it, happens to the tool in the room."""
        if not self.is_placed:
            return
        measured = JointPath(path.t_s, played.q_measured_rad[: len(path.t_s)], path.contact)
        room = self.room
        physics = room.needs_physics(path)
        happened = room.simulate(measured.t_s, measured.q_rad) if physics else room.travel(measured)
        self.offset_s = played.t_start_s - happened.t_start_s


class ShownArm(ArmWrapper[FrankaArm]):
    """The FR3 adapter, followed by the room. `cue` asks whoever drives the test before every motion."""

    def __init__(self, arm: FrankaArm, shown: Shown, cue: Any) -> None:
        super().__init__(arm)
        self._shown, self._cue, self._after_task = shown, cue, False

    def __getattr__(self, name: str) -> Any:
        """Whatever else a real arm can do."""
        return getattr(self._arm, name)

    def execute(self, path: JointPath) -> Execution:
        self._cue.write(self._name(path) + b"\n")
        self._suffer(self._cue.readline())
        played = self._arm.execute(path)
        self._shown.follow(path, played)
        return played

    def _suffer(self, order: bytes) -> None:
        self._shown.is_blind = b"camera" in order
        if b"disk" in order:
            vars(os)["fsync"] = _no_space

    def _name(self, path: JointPath) -> bytes:
        if not self._shown.is_placed:
            return b"home"
        came_back, self._after_task = self._after_task, path.contact is not None
        return b"task" if self._after_task else b"back" if came_back else b"approach"


def _no_space(_: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class ShownCamera:
    """The lab's camera, its stamps on the arm's clock."""

    def __init__(self, shown: Shown) -> None:
        self._shown, self._camera = shown, LabCamera(shown.room, default_X_BC())

    def __enter__(self) -> Self:
        self._camera.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self._camera.__exit__(*exc)

    def model(self) -> CameraModel:
        return self._camera.model()

    def snapshot(self) -> Frame:
        self._look()
        seen = self._camera.snapshot()
        return Frame(time.monotonic(), seen.colour, seen.depth_mm)

    def start_recording(self) -> None:
        self._camera.start_recording()

    def stop_recording(self) -> Sequence[Frame]:
        frames = self._camera.stop_recording()
        self._look()
        return [Frame(f.t_s + self._shown.offset_s, f.colour, f.depth_mm) for f in frames]

    def newest(self) -> np.ndarray | None:
        return self._camera.newest()

    def _look(self) -> None:
        if self._shown.is_blind:
            raise CameraError("no frame within 1 s; check the camera's cable and power, then redo the trial")


class Placing:
    """The person beside the table; the arm stands at home when the object is put down."""

    def __init__(self, shown: Shown) -> None:
        self._shown = shown

    def place(self, xy_m: Any, trial: int, attempt: int) -> None:
        self._shown.room.place(xy_m, trial, attempt)
        self._shown.is_placed = True


def main(cue_fd: str, world: str, *arguments: str) -> int:
    shown, cue = Shown(world, 0), os.fdopen(int(cue_fd), "r+b", buffering=0)

    def arm(cell: Workcell, settings: Any, pedal: Any) -> ShownArm:
        return ShownArm(franka(cell, settings, PATIENT, pedal=pedal), shown, cue)

    devices = replace(drivers.makers_drivers(), arm=arm, camera=lambda part, infrared: ShownCamera(shown))
    drivers.makers_drivers = lambda: devices
    pedal_protocol.SILENCE_S = SILENCE_S
    vars(real)["Person"] = lambda: Placing(shown)
    return app.run(arguments)


if __name__ == "__main__":
    split = sys.argv.index("--")
    sys.exit(main(*sys.argv[1:split], *sys.argv[split + 1 :]))
