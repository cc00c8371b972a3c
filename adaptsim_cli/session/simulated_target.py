"""A trial without devices. The trajectory of a simulated target follows from context and action; or it was recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from adaptsim_cli.screen.outputs.trials import TrackRecord
from adaptsim_cli.screen.release import Release
from adaptsim_cli.screen.views import Readiness
from adaptsim_cli.session.live_trial import PlacedTrial, PlannedTrial, TrackedTrial
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.records import read, to_json
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.adaptation.sessions import Progress, silently
from sim.adaptation.stages import RunTrial, TrialKey
from sim.errors import NotExecutable
from sim.rollouts.recorded import RecordedTrials

Rollout = Callable[[Array, Array], ObjectTrack]
"""(context (c,), action (a,)) -> the target's response. It is deterministic, and hides the target's parameters."""

FILE = "trajectory.json"


@dataclass(frozen=True, eq=False)
class KnownMotion:
    """A `Motion` without a recording: its trajectory is known."""

    trajectory: ObjectTrack
    others: Mapping[str, bytes] = field(default_factory=dict)  # further files, name -> content
    stopped: None = None

    def files(self) -> Mapping[str, bytes]:
        """See `Motion`: the trajectory."""
        return {FILE: to_json(TrackRecord.from_track(self.trajectory)), **self.others}

    def track(self, progress: Progress = silently) -> TrackedTrial:
        """See `Motion`: the trajectory is the track."""
        return TrackedTrial(self.trajectory)


class WithoutDevices:
    """The part of a `Target` in which nothing can move."""

    moves = needs_consent = False
    release = Release()
    outcomes: tuple[Outcome, ...] = ()  # nobody watches, so nobody overrules

    def goes_on(self, key: TrialKey) -> bool:
        """See `Target`; never."""
        return False

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """See `Target`. It never is, because nothing can have moved."""
        return False

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> PlacedTrial:
        """See `Target`: the drawn context is the true one."""
        return PlacedTrial(drawn, drawn, key)

    def read(self, folder: Path, context: Array, action: Array) -> KnownMotion:
        """See `Target`: the trajectory."""
        return KnownMotion(read(TrackRecord, folder / FILE).track())


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

    def plan(self, placed: PlacedTrial, action: Array, progress: Progress = silently) -> PlannedTrial:
        """See `Target`: nothing limits a simulated trial."""
        summary = f"{self.duration_s:.1f} s of the {self.object_name} will be simulated"
        announcement = f"The {self.object_name} is simulated for {self.duration_s:.1f} s"
        return PlannedTrial(placed.drawn, placed.context, placed.key, action, summary, announcement)

    def execute(self, planned: PlannedTrial, progress: Progress = silently) -> KnownMotion:
        """See `Target`: run the rollout, which nothing can stop."""
        with progress(f"Simulating the {self.object_name}", "simulating"):
            trajectory = self.rollout(planned.context, planned.action)
        return KnownMotion(trajectory)


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

    def plan(self, placed: PlacedTrial, action: Array, progress: Progress = silently) -> PlannedTrial:
        """See `Target`. The context is that of the recording, unless contexts only decide the reward. Raises
        NotExecutable.
        """
        row = self._row(action)
        if row < 0:
            raise NotExecutable("this action was not recorded: take another method, or the solver of the checkpoint")
        what, context = f"recording {self.trials.names[row]}", self.trials.context_of(row, placed.context)
        return PlannedTrial(placed.drawn, context, placed.key, action, f"{what} is the answer", f"{what} is taken")

    def execute(self, planned: PlannedTrial, progress: Progress = silently) -> KnownMotion:
        """See `Target`: the recording."""
        row = self._row(planned.action)
        self.spent_rows.add(row)
        return KnownMotion(self.trials.tracks[row])

    def _row(self, action: Array) -> int:
        return int(self.trials.at(action[None])[0])
