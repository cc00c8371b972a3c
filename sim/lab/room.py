"""The shared state of the lab's arm, camera and bench: one cell, one clock, one trial at a time."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from hw.poses import translation
from hw.types import Array, Execution, JointPath, Placing
from sim.lab.cell import Cell, DivergedError, PlantMotion
from sim.lab.film import Filming
from sim.lab.rng_streams import RngStreams, joint_zeros
from sim.lab.world import World
from sim.tasks.task import Task

TRIAL_S, ATTEMPT_S = 1000.0, 50.0
"""Placing sets the clock to `trial` times the first value plus `attempt` times the second, so that times depend on
nothing else."""

TRAVEL_PERIOD_S = 0.005
CHECK_PERIOD_S = 0.02
TRUTH_PERIOD_S = 0.01

_AWAY_M = (0.0, 0.0, -5.0)
"""The object's place before it is first placed: under the floor, out of sight."""


@dataclass(eq=False)
class Room:
    """The present state of the lab. Its clock advances only during events."""

    task: Task
    world: World
    seed: int
    home_q_rad: Array
    t_s: float = 0.0
    t_placed_s: float = 0.0
    chance: RngStreams = field(init=False)
    zeros_rad: Array = field(init=False)  # (7,) true minus reported joint positions
    faults_due: set[str] = field(default_factory=set)  # of this trial, not yet triggered
    filming: Filming | None = None  # the running recording
    history: list[dict[str, Any]] = field(default_factory=list)  # true data of every placing, oldest first

    def __post_init__(self) -> None:
        self.chance = RngStreams.draw(self.seed, 0, 0)
        self.zeros_rad = joint_zeros(self.seed, self.world.sensing.joint_offset_mrad)

    @cached_property
    def cell(self) -> Cell:
        """The cell, built on first use."""
        cell = Cell(self.task, self.world)
        cell.reset(self.home_q_rad + self.zeros_rad, translation(_AWAY_M))
        return cell

    @property
    def q_rad(self) -> Array:
        """(7,) reported joints."""
        return np.asarray(self.cell.q_rad - self.zeros_rad)

    def place(self, xy_m: Array, trial: int, attempt: int) -> None:
        """See `hw.ports.ObjectPlacer`. The object is put at rest near `xy_m` (on its mark, or with its near side
        there), and the arm at home. Clock and random numbers become those of this attempt.
        """
        xy_m = Placing(xy_m, trial, attempt).xy_m
        self.chance = RngStreams.draw(self.seed, trial, attempt)
        self.t_s = self.t_placed_s = TRIAL_S * trial + ATTEMPT_S * attempt
        self.filming = None
        due = vars(self.world.faults).items()
        self.faults_due = {name for name, trials in due if trial in trials and attempt == 0}
        X_BO = self._X_BO_at(xy_m)
        X_BO[:2, 3] += self.chance.placing_m
        self.cell.reset(self.home_q_rad + self.zeros_rad, X_BO)
        self.history.append({"trial": trial, "attempt": attempt, "X_BO_placed": X_BO.tolist(), "motions": []})

    @property
    def reference_xy_m(self) -> Array:
        """(2,) the object's mark, or its place in the task's reference context."""
        standing = self.task.require_hardware().standing
        return np.array(self.task.reference_context[:2] if standing is None else standing.mark_m)

    def fault_comes(self, fault: str) -> bool:
        """Whether a fault is due in this trial; it comes once."""
        due = fault in self.faults_due
        self.faults_due.discard(fault)
        return due

    def needs_physics(self, path: JointPath) -> bool:
        """Whether the tool touches anything on the way, or carries the object. If not, the object lies still."""
        if path.contact is not None or self.cell.touches()[0]:
            return True
        return self.cell.would_touch(path.q_rad[:: round(1000 * CHECK_PERIOD_S)] + self.zeros_rad)

    def travel(self, path: JointPath) -> Execution:
        """Play a path without contact; it costs time only for a recording."""
        times_s = np.array([0.0, path.duration_s])
        if self.filming is not None:
            times_s = np.linspace(0.0, path.duration_s, 2 + int(path.duration_s / TRAVEL_PERIOD_S))
        rows = np.stack([np.interp(times_s, path.t_s, column) for column in path.q_rad.T], axis=-1)
        t_start_s = self._happened(self.cell.travel(times_s, rows + self.zeros_rad))
        return Execution(t_start_s, path.t_s, path.q_rad, path.q_rad, 1.0)

    def simulate(self, t_s: Array, q_rad: Array) -> Execution:
        """Follow (N,), (N, 7) with physics and wait until the object rests.

        Raises DivergedError, with everything at rest.
        """
        try:
            motion = self.cell.simulate(t_s, q_rad + self.zeros_rad + self.chance.joint_offset_rad, self._shown)
        except DivergedError as error:
            self._happened(error.motion)
            raise
        t_start_s = self._happened(motion)
        self._remember(t_start_s, motion)
        return Execution(t_start_s, t_s, q_rad, motion.arm_at(t_s) - self.zeros_rad, 1.0)

    def wait(self, duration_s: float) -> None:
        """Let time pass with everything at rest."""
        positions = np.tile(self.cell.positions, (2, 1))
        self._happened(PlantMotion(np.array([0.0, duration_s]), positions, np.tile(self.cell.q_rad, (2, 1))))

    def _X_BO_at(self, xy_m: Array) -> Array:
        world, hardware = self.world, self.task.require_hardware()
        standing = hardware.standing
        context = np.asarray(xy_m) if standing is None else self.task.reference_context
        X_BO = np.array(hardware.rest_pose(context, world.parameters, world.nuisance, world.unmodelled))
        if standing is not None:
            X_BO[:2, 3] = xy_m
        return X_BO

    def _shown(self, motion: PlantMotion) -> None:
        if self.filming is not None:
            self.filming.saw(self.t_s, motion)

    def _happened(self, motion: PlantMotion) -> float:
        self._shown(motion)
        t_start_s = self.t_s
        self.t_s = t_start_s + float(motion.t_s[-1])
        return t_start_s

    def _remember(self, t_start_s: float, motion: PlantMotion) -> None:
        if not self.history:
            return
        every = max(1, round(TRUTH_PERIOD_S / (motion.t_s[1] - motion.t_s[0])))
        poses = self.cell.poses(motion.positions[::every])[self.cell.bodies.object]
        self.history[-1]["motions"].append(
            {"t_start_s": t_start_s, "t_s": motion.t_s[::every].tolist(), "X_BO": poses.tolist()}
        )
