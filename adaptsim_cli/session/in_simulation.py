"""A trial in a simulated target, without devices: set the context, apply the action, take the trajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from adaptsim_cli.screen.checks import Readiness
from adaptsim_cli.session.during import During, silently
from adaptsim_cli.session.operator import Operator
from adaptsim_cli.session.records import TrackRecord, read, to_json
from adaptsim_cli.session.stages import RunTrial, TrialKey
from adaptsim_cli.session.target import TrialEvidence
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

    def replay(self, context: Array, action: Array, folder: Path) -> SimulatedReplay:
        """See `Target`: the stored trajectory of a trial. Raises SessionError."""
        return SimulatedReplay(read(TrackRecord, folder / FILE).track())

    def set_up(self, drawn: Array, key: TrialKey, operator: Operator, during: During = silently) -> SimulatedReady:
        """See `Target`: the drawn context is the true one."""
        return SimulatedReady(self, drawn)


@dataclass(frozen=True, eq=False)
class SimulatedReady:
    """A simulated target with its context set, ready to plan."""

    target: InSimulation
    drawn: Array
    overlay: None = None

    @property
    def context(self) -> Array:
        """(c,) as it was drawn, in units."""
        return self.drawn

    def plan(self, action: Array, during: During = silently) -> SimulatedPlan:
        """The rollout of `action` (a,), not run yet."""
        return SimulatedPlan(self.target, self.context, action)


@dataclass(frozen=True, eq=False)
class SimulatedPlan:
    """A simulated trial that waits to be executed."""

    target: InSimulation
    context: Array
    action: Array

    @property
    def summary(self) -> str:
        """How long the rollout lasts, for the screen."""
        return f"{self.target.duration_s:.1f} s of the {self.target.object_name} will be simulated"

    @property
    def announcement(self) -> str:
        """The sentence that asks for approval."""
        return f"The {self.target.object_name} is simulated for {self.target.duration_s:.1f} s"

    def sight(self) -> None:
        """There is no camera."""

    def execute(self, during: During = silently) -> SimulatedTrial:
        """Run the rollout."""
        with during(f"Simulating the {self.target.object_name}", "simulating"):
            return SimulatedTrial(self.target.rollout(self.context, self.action))


@dataclass(frozen=True, eq=False)
class SimulatedTrial:
    """A finished simulated trial; nothing can stop one."""

    trajectory: ObjectTrack
    stopped: None = None

    def files(self) -> Mapping[str, bytes]:
        """The file with the trajectory, stored beside the trial."""
        return {FILE: to_json(TrackRecord.from_track(self.trajectory))}


@dataclass(frozen=True, eq=False)
class SimulatedReplay:
    """A stored simulated trial, read again."""

    trajectory: ObjectTrack
    looking: str = "Reading the trajectory"

    def track(self) -> ObjectTrack:
        """The trajectory; there is nothing to track."""
        return self.trajectory

    def evidence(self, track: ObjectTrack) -> TrialEvidence:
        """Nothing besides the trajectory."""
        return TrialEvidence()

    def track_px(self, track: ObjectTrack) -> Array:
        """See `TrialReplay`: there is no camera."""
        return np.zeros((0, 2))
