"""A trial without devices: in a simulated target the trajectory follows from context and action, or it was recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from adaptsim_cli.outputs.trials import TrackRecord
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import Readiness
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.records import read, to_json
from adaptsim_cli.session.target import Executed, Placed, Planned, TrackedTrial
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.adaptation.sessions import Progress, silently
from sim.adaptation.stages import RunTrial, TrialKey
from sim.errors import NotExecutable
from sim.rollouts.recorded import RecordedTrials

Rollout = Callable[[Array, Array], ObjectTrack]
"""(context (c,), action (a,)) -> the target's response. Deterministic; the target's parameters stay hidden in it."""

FILE = "trajectory.json"


class WithoutDevices:
    """The part of a `Target` in which nothing can move."""

    moves = needs_consent = owns_devices = False
    release = Release()
    outcomes: tuple[Outcome, ...] = ()  # nobody watches, so nobody overrules

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """See `Target`; never: nothing can have moved."""
        return False

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> Placed:
        """See `Target`: the drawn context is the true one."""
        return Placed(drawn, drawn)

    def read(self, folder: Path) -> ObjectTrack:
        """See `Target`: the trajectory."""
        return read(TrackRecord, folder / FILE).track()

    def track(self, context: Array, action: Array, recorded: Any, progress: Progress = silently) -> TrackedTrial:
        """See `Target`: the trajectory is the track."""
        return TrackedTrial(recorded)


@dataclass(frozen=True)
class SimulatedTarget(WithoutDevices):
    """A `Target` without arm, camera or bench."""

    object_name: str
    duration_s: float  # simulated time of a trial
    title: str
    rollout: Rollout

    def checks(self) -> tuple[Readiness, ...]:
        """See `Target`; there are no devices to check."""
        return (Readiness("devices", True, "none needed"),)

    def plan(self, placed: Placed, action: Array, progress: Progress = silently) -> Planned:
        """See `Target`: nothing limits a simulated trial."""
        summary = f"{self.duration_s:.1f} s of the {self.object_name} will be simulated"
        return Planned(placed, action, summary, f"The {self.object_name} is simulated for {self.duration_s:.1f} s")

    def execute(self, planned: Planned, progress: Progress = silently) -> Executed:
        """See `Target`: run the rollout, which nothing can stop."""
        with progress(f"Simulating the {self.object_name}", "simulating"):
            trajectory = self.rollout(planned.placed.context, planned.action)
        return _executed(trajectory)


@dataclass(frozen=True)
class RecordedTarget(WithoutDevices):
    """A `Target` of recorded trials, each of which a session gets once, also after an interruption."""

    trials: RecordedTrials  # without those held out
    title: str
    spent_rows: set[int] = field(default_factory=set)  # of trials

    def executable(self, context: Array, action: Array) -> bool:
        """Whether the action was recorded and is not used yet."""
        row = self._row(action)
        return row >= 0 and row not in self.spent_rows

    def checks(self) -> tuple[Readiness, ...]:
        """See `Target`: how many recordings are left."""
        left = len(self.trials) - len(self.spent_rows)
        return (Readiness("recorded trials", left > 0, f"{left} of {len(self.trials)} not used yet"),)

    def plan(self, placed: Placed, action: Array, progress: Progress = silently) -> Planned:
        """See `Target`; the context is that of the recording, unless it only scores. Raises NotExecutable."""
        row = self._row(action)
        if row < 0:
            raise NotExecutable("this action was not recorded: take another method, or the solver of the checkpoint")
        there = Placed(placed.drawn, self.trials.context_of(row, placed.context))
        what = f"recording {self.trials.names[row]}"
        return Planned(there, action, f"{what} is the answer", f"{what} is taken")

    def execute(self, planned: Planned, progress: Progress = silently) -> Executed:
        """See `Target`: the recording."""
        row = self._row(planned.action)
        self.spent_rows.add(row)
        return _executed(self.trials.tracks[row])

    def _row(self, action: Array) -> int:
        return int(self.trials.at(action[None])[0])


def _executed(trajectory: ObjectTrack) -> Executed:
    return Executed(lambda: ({FILE: to_json(TrackRecord.from_track(trajectory))}, trajectory))
