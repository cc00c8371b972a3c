"""The simulated lab: a whole arm, table, object and camera in a world that learning and tracking never see.

It poses as `hw.ports.Arm`, `hw.ports.Camera` and `hw.ports.Bench`. `docs/decisions/0005-simulated-lab.md` says what
it models and what it leaves out.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Self

import numpy as np

from hw.ports import Arm, Bench, Camera
from hw.types import Array, Frame, frozen_array
from hw.workcell import Workcell
from sim.lab.arm import LabArm
from sim.lab.bench import LabBench
from sim.lab.camera import LabCamera
from sim.lab.kinect import default_X_BC
from sim.lab.physics import effects_in
from sim.lab.room import Room
from sim.lab.world import World
from sim.tasks.task import Task

READY_RAD: Array = frozen_array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
"""The maker's ready pose."""


class SimulatedLab:
    """One world as a bench with devices.

    What happens at a trial follows from (world, seed, trial, attempt) and the paths alone: the same inputs give
    the same bytes, in any process and after any history. Entering connects arm and camera.
    """

    def __init__(
        self,
        task: Task,
        world: World,
        seed: int,
        cell: Workcell,
        *,
        home_q_rad: Array = READY_RAD,
    ) -> None:
        """`home_q_rad` (7,) is where the arm stands whenever the object is placed, `cell` what its arm checks motions
        against: what is believed of it, not what is hidden in the world. Builds nothing yet.

        Raises NoHardware, also for a world of a foreign physics, ValueError for another task's world, or another arm
        than a Panda.
        """
        self._hardware = task.require_hardware()
        world.require_lab()
        if world.task != task.name:
            raise ValueError(f"world {world.name} is of {world.task}, not of {task.name}")
        if cell.arm.name != "panda":
            raise ValueError(f"the lab has a panda, but its workcell is for the arm {cell.arm.name}")
        self._task, self._world, self._seed = task, world, seed
        self._X_BC = default_X_BC()
        self._room = Room(task, world, seed, frozen_array(home_q_rad, (7,), "home_q_rad"))
        self.arm: Arm = LabArm(self._room, cell)
        self.camera: Camera = LabCamera(self._room, self._X_BC)
        self.bench: Bench = LabBench(self._room)

    def __enter__(self) -> Self:
        self.arm.__enter__()
        self.camera.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self.camera.__exit__(*exc)
        self.arm.__exit__(*exc)

    @property
    def title(self) -> str:
        """What an operator calls it."""
        return f"world {self._world.name}"

    @property
    def home_q_rad(self) -> Array:
        """(7,) where paths from home begin."""
        return self._room.home_q_rad

    def picture(self) -> Frame:
        """What the camera sees with the arm at home and the object where the task's reference context has it."""
        with self:
            self.bench.place(self._room.reference_xy_m, trial=1, attempt=0)
            return self.camera.snapshot()

    def truth(self) -> dict[str, Any]:
        """All that is hidden, ready for JSON, for checking alone: `X_BC` (4, 4), parameters and effects, and of every
        trial so far where the object was placed and how it moved (`X_BO` every 10 ms on the arm's clock).
        """
        task, world = self._task, self._world
        return {
            **truth_of(task, world),
            "seed": self._seed,
            "sensing": asdict(world.sensing),
            "mount": asdict(world.mount),
            "faults": asdict(world.faults),
            "X_BC": self._X_BC.tolist(),
            "joint_zeros_rad": self._room.zeros_rad.tolist(),
            "X_FT": self._hardware.X_FT.tolist(),
            "trials": [dict(trial) for trial in self._room.history],
        }


def truth_of(task: Task, world: World) -> dict[str, Any]:
    """What is hidden in a world besides arm and camera, ready for JSON."""
    return {
        "task": task.name,
        "world": world.name,
        "description": world.description,
        "physics": world.physics,
        "parameters": dict(zip(task.parameters.names, world.parameters.tolist(), strict=True)),
        "nuisance": dict(zip(task.nuisance.names, world.nuisance.tolist(), strict=True)),
        "unmodelled": effects_in(world.physics, world.unmodelled),
    }
