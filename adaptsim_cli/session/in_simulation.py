"""A trial in a simulated target, without devices: set the context, apply the action, take the trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from adaptsim_cli.outputs.trials import TrackRecord
from adaptsim_cli.screen.views import Readiness
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.records import RunTrial, TrialKey, read, to_json
from adaptsim_cli.session.target import Executed, Placed, Planned, Progress, TrackedTrial, silently
from hw.types import Array
from perception.types import ObjectTrack, Outcome

Rollout = Callable[[Array, Array], ObjectTrack]
"""(context (c,), action (a,)) -> the target's response. Deterministic; the target's parameters stay hidden in it."""

FILE = "trajectory.json"


@dataclass(frozen=True)
class InSimulation:
    """A `Target` without arm, camera or bench."""

    object_name: str
    duration_s: float  # simulated time of a trial
    title: str
    rollout: Rollout
    is_real: bool = False
    outcomes: tuple[Outcome, ...] = ()  # nobody watches, so nobody overrules

    def checks(self) -> tuple[Readiness, ...]:
        """See `Target`; there are no devices to check."""
        return (Readiness("devices", True, "none needed"),)

    def spent(self, stage: RunTrial, operator: Operator) -> bool:
        """See `Target`; never: nothing can have moved."""
        return False

    def place(self, drawn: Array, key: TrialKey, operator: Operator, progress: Progress = silently) -> Placed:
        """See `Target`: the drawn context is the true one."""
        return Placed(drawn, drawn)

    def plan(self, placed: Placed, action: Array, progress: Progress = silently) -> Planned:
        """See `Target`: nothing limits a simulated trial."""
        summary = f"{self.duration_s:.1f} s of the {self.object_name} will be simulated"
        return Planned(placed, action, summary, f"The {self.object_name} is simulated for {self.duration_s:.1f} s")

    def execute(self, planned: Planned, progress: Progress = silently) -> Executed:
        """See `Target`: run the rollout, which nothing can stop."""
        with progress(f"Simulating the {self.object_name}", "simulating"):
            trajectory = self.rollout(planned.placed.context, planned.action)
        return Executed(lambda: {FILE: to_json(TrackRecord.from_track(trajectory))})

    def track(
        self,
        context: Array,
        action: Array,
        folder: Path,
        progress: Progress = silently,
        executed: Executed | None = None,
    ) -> TrackedTrial:
        """See `Target`: the stored trajectory. Raises SessionError."""
        with progress("Reading the trajectory", "reading"):
            return TrackedTrial(read(TrackRecord, folder / FILE).track())
