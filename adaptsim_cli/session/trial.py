"""The steps of one trial, in a session or by itself: propose, execute, look."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session import shows
from adaptsim_cli.session.operator import Proposal
from adaptsim_cli.session.policy import ExpectedReward
from adaptsim_cli.session.stages import RunTrial
from adaptsim_cli.session.target import Executed, Planned, Ready, Target, TrialReplay
from hw.types import Array
from perception.types import ObjectTrack
from sim.tasks.solver import SolvedPolicy
from sim.tasks.task import Task


def propose(
    task: Task,
    stage: RunTrial,
    parameters: Array,
    policy: SolvedPolicy,
    ready: Ready,
    action: Array,
    planned: Planned,
    keep: Callable[[bytes], Path],
    screen: Screen,
) -> Proposal:
    """Show the planned trial and its expected reward before anyone is asked.

    `parameters` (p,) are those of the policy; `keep` stores the picture of the detection.
    """
    overlay = None if ready.overlay is None else keep(ready.overlay)
    expected = ExpectedReward(*policy.predict(ready.context))
    proposal = Proposal(
        stage, parameters, ready.drawn, ready.context, action, expected, planned.summary, planned.announcement, overlay
    )
    screen.show(shows.proposal(task, proposal))
    return proposal


def execute(planned: Planned, store: Callable[[Executed], None], screen: Screen) -> None:
    """Execute, and `store` the recording before anyone looks at it. Raises HardwareError."""
    executed = planned.execute(screen.busy)
    with screen.busy("Storing the recording", "storing"):
        store(executed)
    if executed.stopped is not None:
        raise executed.stopped


def look(
    target: Target, context: Array, action: Array, folder: Path, screen: Screen
) -> tuple[TrialReplay, ObjectTrack]:
    """Track the recording in `folder`. Raises PerceptionError, SessionError naming a corrupt file."""
    with screen.busy("Reading the recording", "reading"):
        replay = target.replay(context, action, folder)
    with screen.busy(replay.looking, "tracking"):
        return replay, replay.track()
