"""Compares recorded trials with the task's simulator, before a session uses them."""

from __future__ import annotations

from dataclasses import replace

from adaptsim_cli.session.recorded.manifest import MANIFEST
from sim.errors import RecordingsRefused
from sim.rollouts.recorded import RecordedTrials
from sim.solvers.readings import doubt
from sim.tasks.task import Expectations


def compared(trials: RecordedTrials, expectations: Expectations) -> RecordedTrials:
    """The same trials, after the task's simulator has confirmed that they fit their actions as they are written.

    With `as_written` a doubt becomes a note. Raises RecordingsRefused if another reading of them fits much better.
    """
    sentence = doubt(expectations, trials)
    if not sentence:
        return trials
    if not trials.as_written:
        raise RecordingsRefused(
            f"the trajectories contradict their actions: {sentence}. Correct the tables, or write as_written = true in "
            f"{MANIFEST} if they are right"
        )
    return replace(trials, notes=(*trials.notes, sentence))
