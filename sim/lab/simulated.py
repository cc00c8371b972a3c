"""The simulated lab: a whole arm, table, object and camera in a world hidden from learning and tracking.

It provides `hw.ports.Arm`, `hw.ports.Camera` and `hw.ports.ObjectPlacer`. For its models and their limits see
`docs/decisions/0005-simulated-lab.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Self

import numpy as np

from hw.ports import Arm, Camera, ObjectPlacer
from hw.types import Array, Frame, frozen_array
from hw.workcell import Workcell
from sim.lab.arm import LabArm
from sim.lab.camera import LabCamera
from sim.lab.kinect import moved_X_BC
from sim.lab.physics import effects_in, physics_name
from sim.lab.rng_streams import moved_stream
from sim.lab.room import Room
from sim.lab.world import World
from sim.render.pool import RenderPool, Scene
from sim.tasks.task import Task

READY_RAD: Array = frozen_array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
"""The maker's ready pose."""


class SimulatedLab:
    """One world as a bench with devices.

    A trial depends only on (world, seed, trial, attempt) and the paths: the same inputs give the same bytes, in any
    process and after any history. Entering connects arm and camera.
    """

    def __init__(
        self,
        task: Task,
        world: World,
        seed: int,
        cell: Workcell,
        *,
        home_q_rad: Array = READY_RAD,
        pool: Callable[[Scene], RenderPool] | None = None,
    ) -> None:
        """`home_q_rad` (7,) is the arm's posture whenever the object is placed; `pool`: see `LabCamera`.

        `cell` checks its motions; it describes the assumed geometry, not the world's hidden one. Builds nothing yet.

        Raises NoHardware, also for a world with a foreign physics, and ValueError for another task's world or an arm
        other than a Panda.
        """
        self._hardware = task.require_hardware()
        world.require_lab()
        if world.task != task.name:
            raise ValueError(f"world {world.name} is of {world.task}, not of {task.name}")
        if cell.arm.name != "panda":
            raise ValueError(f"the lab has a panda, but its workcell is for the arm {cell.arm.name}")
        self._task, self._world, self._seed = task, world, seed
        sensing = world.sensing
        self._X_BC = moved_X_BC(sensing.camera_moved_mm, sensing.camera_moved_deg, moved_stream(seed))
        self._room = Room(task, world, seed, frozen_array(home_q_rad, (7,), "home_q_rad"))
        self.arm: Arm = LabArm(self._room, cell)
        self.camera: Camera = LabCamera(self._room, self._X_BC, pool)
        self.bench: ObjectPlacer = self._room

    def __enter__(self) -> Self:
        self.arm.__enter__()
        self.camera.__enter__()
        return self

    def __exit__(self, *exc: object) -> None:
        self.camera.__exit__(*exc)
        self.arm.__exit__(*exc)

    @property
    def title(self) -> str:
        """Its name for an operator."""
        return f"world {self._world.name}"

    def picture(self) -> Frame:
        """The camera's picture with the arm at home and the object at the task's reference context."""
        with self:
            self.bench.place(self._room.reference_xy_m, trial=1, attempt=0)
            return self.camera.snapshot()

    def truth(self) -> dict[str, Any]:
        """All hidden values, ready for JSON, only for checks: `X_BC` (4, 4), parameters, effects, and for every trial
        so far the object's place and its motion (`X_BO` every 10 ms on the arm's clock).
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
    """The hidden values of a world except those of arm and camera, ready for JSON."""
    return {
        "task": task.name,
        "world": world.name,
        "description": world.description,
        "physics": physics_name(task, world.physics),
        "parameters": dict(zip(task.parameters.names, world.parameters.tolist(), strict=True)),
        "nuisance": dict(zip(task.nuisance.names, world.nuisance.tolist(), strict=True)),
        "unmodelled": effects_in(world.physics, world.unmodelled),
    }
