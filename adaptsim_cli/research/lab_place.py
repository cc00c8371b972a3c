"""Benchmark sessions in the whole simulated lab: arm, camera and tracking take part in every trial."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from adaptsim_cli.bench.devices.mounted import mounted_as_shipped
from adaptsim_cli.bench.devices.simulated import nominal_hand_eye
from adaptsim_cli.bench.devices.trackers import tracker_of
from adaptsim_cli.bench.rig import Rig
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.rig_target import RigTarget
from hw.errors import MotionRefused
from hw.types import Array
from perception.errors import PerceptionError
from perception.types import ObjectTrack
from sim.adaptation.method import Trial, trials_of_rows
from sim.adaptation.stages import TrialKey
from sim.errors import NotExecutable, RolloutError
from sim.lab.simulated import SimulatedLab
from sim.lab.world import World
from sim.render.pool import RenderPool, Scene
from sim.research.benchmark.entries import FIXED_RULES, LIMITS, Entry
from sim.research.benchmark.jobs import BenchmarkRow, Job, run_job
from sim.research.benchmark.trial_sources import TableTrials, TrialSource
from sim.tasks import get_task
from sim.tasks.task import Executable, Task

ATTEMPTS, INWARD = 6, 0.02
"""The most placements until the object is found and no limit forbids the motion. After each, it is moved inward by this
share of the area, as the message asks, because at the rim the errors of the hand and of the first picture put most
placements outside."""


class Nobody:
    """An operator for trials without questions."""

    def placed(self, *_: Any) -> None:
        """See `adaptsim_cli.session.operator.Operator`."""


@dataclass(frozen=True, eq=False)
class InLab:
    """A `TrialSource`: trials run in the lab; scores and best actions come from the table of the same world."""

    rig: RigTarget
    table: TrialSource
    executable: Executable
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def play(self, contexts: Array, actions: Array, rng: np.random.Generator) -> tuple[Trial, ...]:
        """See `TrialSource`.

        Raises RolloutError if a trial keeps failing. The lab draws from its own random numbers, not `rng`.
        """
        task = self.rig.task
        trials = [self._trial(context, action) for context, action in zip(contexts, actions, strict=True)]
        tracks = [track for _, track in trials]
        return trials_of_rows(
            np.stack([context for context, _ in trials]),
            actions,
            np.stack([task.observation(track) for track in tracks]),
            np.array([task.score(track, context) for context, track in trials]),
            map(task.end_of, tracks),
        )

    def take(self, action: Array) -> None:
        """See `TrialSource`: any number of times."""

    def score(self, contexts: Array, actions: Array, rng: np.random.Generator) -> Array:
        """See `TrialSource`: from the table."""
        return self.table.score(contexts, actions, rng)

    def best_actions(self, contexts: Array) -> Array:
        """See `TrialSource`: from the table."""
        return self.table.best_actions(contexts)

    def _trial(self, context: Array, action: Array) -> tuple[Array, ObjectTrack]:
        """One motion, as in a session -> the measured context, and the track."""
        number, why = next(self._numbers), ""
        area = self.rig.task.context
        for attempt in range(ATTEMPTS):
            inner = np.clip(area.normalise(context), INWARD * attempt, 1 - INWARD * attempt)
            try:
                placed = self.rig.place(area.denormalise(inner), TrialKey(number, attempt), cast(Operator, Nobody()))
                motion = self.rig.execute(self.rig.plan(placed, action))
                motion.files()
                return placed.context, motion.track().track
            except (PerceptionError, NotExecutable, MotionRefused) as error:
                why = str(error)
        raise RolloutError(f"trial {number} in the lab failed {ATTEMPTS} times: {why}")


def run_in_lab(job: Job) -> BenchmarkRow:
    """Run a job as `run_job` does, with the session's trials in the lab.

    UDR and the upper bounds run outside the lab, because they need no trials, or too many.
    """
    if Entry.parse(job.method).name in (*FIXED_RULES, *LIMITS):
        return run_job(job)
    with in_lab(job) as place:
        return run_job(job, place)


@contextmanager
def in_lab(job: Job) -> Iterator[InLab]:
    """The place of a job's trials."""
    task = get_task(job.task)
    assert job.world is not None and job.table is not None, "only a task without hardware has no table"
    with rig_in_lab(task, job.world, job.seed) as (_, rig):
        yield InLab(rig, TableTrials(task, job.table), rig.executable)


@contextmanager
def rig_in_lab(
    task: Task, world: World, seed: int, pool: Callable[[Scene], RenderPool] | None = None
) -> Iterator[tuple[SimulatedLab, RigTarget]]:
    """A lab in `world` and its rig, with the default arm and the nominal calibration; for `pool` see `LabCamera`."""
    mounted_task = mounted_as_shipped(task, "panda")
    with SimulatedLab(task, world, seed, mounted_task.cell, home_q_rad=mounted_task.home_rad, pool=pool) as lab:
        devices = Rig("fake", lab.title, lab.arm, lab.camera, lab.bench, nominal_hand_eye(world, seed))
        yield lab, RigTarget(mounted_task.task, devices, tracker_of(mounted_task.task), mounted_task.planner())
