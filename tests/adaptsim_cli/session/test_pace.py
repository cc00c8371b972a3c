"""A trial at a slower pace is a rehearsal; and what the rig says can never cost a recording."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_rig import ToyLab, on_rig, toy_parts
from toy_session import resolved, silent, unattended

from adaptsim_cli import app
from adaptsim_cli.session import running
from adaptsim_cli.session.flow import RunningSession, run_iteration
from adaptsim_cli.session.on_rig import OnRig
from adaptsim_cli.session.records import RigFacts, TrialKey
from hw.errors import Rehearsed

KEY, CONTEXT, ACTION = TrialKey(1, 0), np.array([0.68, 0.0]), np.array([0.5])


def slow(pace: float) -> OnRig:
    target = on_rig(toy_parts(ToyLab(0)))
    return replace(target, rig=replace(target.rig, pace=pace))


@pytest.mark.parametrize("pace", [0.1, 0.5, 1.0])
def test_below_full_pace_nothing_is_learnt_and_everybody_says_so(pace: float) -> None:
    target = slow(pace)
    planned = target.plan(target.place(CONTEXT, KEY, unattended()), ACTION)
    assert ("nothing is learnt" in planned.summary) == (pace < 1.0)
    executed = target.execute(planned)
    assert isinstance(executed.stopped, Rehearsed) == (pace < 1.0)
    assert "recording.mcap" in executed.stored()[0]


def test_a_rehearsed_trial_does_not_count_and_ends_the_command(tmp_path: Path) -> None:
    parts = toy_parts(ToyLab(0))
    target = on_rig(parts)
    parts = replace(parts, target=replace(target, rig=replace(target.rig, pace=0.3)))
    settings = resolved(tmp_path)
    store = running.begin(settings.places.sessions, "s", settings.config, parts)
    with pytest.raises(Rehearsed, match=r"pace 0\.3 .*nothing is learnt .*without --pace") as raised:
        run_iteration(RunningSession(store, parts, unattended(), silent()))
    assert app.exit_code(raised.value) == 7
    existing = store.existing()
    assert existing.completed == {} or not existing.completed
    assert len(existing.rejected) == 1


class Nonsense:
    """An attendant whose balance gave a number that is none."""

    def recover(self) -> None: ...

    def prepare(self, what: str) -> None: ...

    def facts(self) -> RigFacts:
        return RigFacts().model_copy(update={"object_mass_kg": math.nan})


def test_facts_that_cannot_be_stored_do_not_lose_the_recording() -> None:
    target = slow(1.0)
    rig = replace(target.rig, attendant=Nonsense())
    target = replace(target, rig=rig)
    files = target.execute(target.plan(target.place(CONTEXT, KEY, unattended()), ACTION)).stored()[0]
    assert "recording.mcap" in files
    kept = json.loads(files["rig.json"])
    assert kept["object_mass_kg"] is None
    assert "JSON" in kept["problem"]
