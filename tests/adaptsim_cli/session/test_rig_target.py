"""The object is tracked while the arm goes back, in the frames as they are stored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from adaptsim_cli.bench.rig import TrackRequest
from toy_rig import ToyLab, rig_target, toy_parts
from toy_session import unattended

from adaptsim_cli.research.lab_place import rig_in_lab
from adaptsim_cli.session.rig_target import RigTarget
from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.stages import TrialKey
from sim.lab.world import load_world
from sim.tasks import get_task

KEY, CONTEXT, ACTION = TrialKey(1, 0), np.array([0.68, 0.0]), np.array([0.5])


def test_the_track_is_there_before_the_arm_is_home():
    tracked, waited, motions = Event(), [], iter(("approach", "motion", "back"))

    def moving(trial: int, attempt: int) -> None:
        if next(motions) == "back":
            waited.append(tracked.wait(30.0))

    target = rig_target(toy_parts(ToyLab(0, hooks={"execute": moving})))
    plain = target.tracker.track

    def track(request: TrackRequest) -> ObjectTrack:
        tracked.set()
        return plain(request)

    target = replace(target, tracker=replace(target.tracker, track=track))
    planned = target.plan(target.place(CONTEXT, KEY, unattended()), ACTION)
    target.execute(planned).files()
    assert waited == [True]


def require_same_again(target: RigTarget, context: Array, action: Array, folder: Path) -> None:
    placed = target.place(context, KEY, unattended())
    motion = target.execute(target.plan(placed, action))
    files = motion.files()
    assert motion.followed is not None
    for name, content in files.items():
        (folder / name).write_bytes(content)
    beside, again = (it.track() for it in (motion, target.read(folder, placed.context, action)))
    for name in ("t_s", "state", "confidence", "end_in_tool_m"):
        assert np.array_equal(getattr(beside.track, name), getattr(again.track, name), equal_nan=True)
    assert (beside.track.outcome, beside.track.flags) == (again.track.outcome, again.track.flags)
    assert beside.files == again.files


def test_a_recording_gives_the_same_track_again_bit_for_bit(tmp_path):
    require_same_again(rig_target(toy_parts(ToyLab(0))), CONTEXT, ACTION, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scooping", "pushing"])
def test_so_does_a_recording_of_the_whole_lab(tmp_path, name):
    task = get_task(name)
    action = task.action.denormalise(np.full(len(task.action.dimensions), 0.5))
    with rig_in_lab(task, load_world("wd", task), 0) as (_, target):
        require_same_again(target, task.reference_context, action, tmp_path)
