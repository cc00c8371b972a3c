"""Films random trials by the whole arm in drawn worlds, with what truly happened beside each recording."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from adaptsim_cli.bench.devices.trackers import BOTTLE_AREA
from adaptsim_cli.bench.rig import Detection
from adaptsim_cli.research.lab_place import rig_in_lab
from adaptsim_cli.session import recording
from adaptsim_cli.session.rig_preview import FoundObject
from adaptsim_cli.session.rig_target import RigPlan, RigTarget
from adaptsim_cli.storage import durable
from hw.errors import CameraError, MotionRefused
from hw.kinematics import forward
from hw.poses import inverse
from hw.types import Array, Execution, Frame
from perception.errors import ObjectNotFound
from perception.types import Outcome, is_on_blade
from sensing.drawing import LitCamera, LitWorld
from sensing.staging import StagedPool
from sim.adaptation.stages import TrialKey
from sim.errors import NotExecutable
from sim.lab.simulated import SimulatedLab
from sim.render.pool import Scene
from sim.tasks.task import Task

TRUTH = "truth.json"
OBJECTS = {"scooping": "piece", "pushing": "bottle"}  # names of the bodies in the scene
TRIES = 40  # random actions for each trial
TIPPED_DEG = 30.0
CARRIED_M = 0.03  # a piece higher than this over the table as the arm is home was carried there


def film(task: Task, lit: LitWorld, folder: Path) -> str:
    """Make the trial of a world. Recording and truth are written into `folder`; otherwise the reason is returned."""

    def pool(scene: Scene) -> StagedPool:
        return StagedPool(scene, lit.condition, OBJECTS[task.name], lit.seed)

    with rig_in_lab(task, lit.world, lit.seed[0], pool) as (lab, rig):
        camera = LitCamera(rig.rig.camera, lit.light, lit.condition, lit.seed)
        blind = replace(rig.tracker, find=_not_now)  # the object is found and tracked later, from the recording
        rig_in_light = replace(rig, rig=replace(rig.rig, camera=camera), tracker=blind)
        return _film(lab, rig_in_light, lit, np.random.default_rng((*lit.seed, 0)), folder)


def _film(lab: SimulatedLab, rig: RigTarget, lit: LitWorld, rng: np.random.Generator, folder: Path) -> str:
    """The context is the true one within a hand's error, so that a poor first look ruins no motion."""
    planned = _planned(rig, rng)
    lab.bench.place(rig.tracker.placement(planned.drawn), 1, 0)
    before = rig.in_time(rig.rig.camera.snapshot())
    try:
        executed = rig.execute(replace(planned, sighting=replace(planned.sighting, frame=before)))
    except CameraError as error:
        return str(error)
    if executed.stopped is not None:
        return str(executed.stopped)
    files, recorded = executed.files(), executed.recorded
    assert recorded is not None
    folder.mkdir(parents=True, exist_ok=True)
    durable.replace_file(folder / recording.FILE, files[recording.FILE])
    truth = {
        "context": planned.context.tolist(),
        "action": planned.action.tolist(),
        **_truth(rig, lab.truth()["trials"][-1], recorded.execution),
        "luminance": lit.luminance,
    }
    durable.replace_file(folder / TRUTH, json.dumps(truth).encode())
    return ""


def _planned(rig: RigTarget, rng: np.random.Generator) -> RigPlan:
    for _ in range(TRIES):
        context, action = rig.task.context.sample(rng, 1)[0], rig.task.action.sample(rng, 1)[0]
        try:
            placed = FoundObject(context, context, TrialKey(1, 0), b"", cast(Frame, None), _At(rig, context))
            return rig.plan(placed, action)
        except (NotExecutable, MotionRefused):
            continue
    raise RuntimeError(f"none of {TRIES} random actions is executable")


def _not_now(*_: Any) -> Detection:
    raise ObjectNotFound("nobody looks for it while it is filmed")


class _At:
    """A detection at the given place."""

    def __init__(self, rig: RigTarget, context: Array) -> None:
        self.xy_m = rig.tracker.placement(context)


def _truth(rig: RigTarget, trial: dict[str, Any], played: Execution) -> dict[str, Any]:
    """Outcome, and the object's places on the arm's clock."""
    motion = min(trial["motions"], key=lambda one: abs(one["t_start_s"] - played.t_start_s))
    X_BO = np.array(motion["X_BO"])
    t_s = np.array(motion["t_s"]) + motion["t_start_s"]
    if rig.hardware.carries:
        X_BT = forward(played.q_measured_rad[-1]) @ rig.hardware.X_FT
        on_blade = is_on_blade((inverse(X_BT) @ X_BO[-1])[:3, 3])
        home_m = float(np.array(trial["motions"][-1]["X_BO"])[-1, 2, 3])
        outcome = Outcome.ON_BLADE if on_blade and home_m > CARRIED_M else Outcome.ON_TABLE
    else:
        outcome = bottle_outcome(X_BO)
    return {"outcome": outcome.value, "t_s": t_s.tolist(), "xyz_m": X_BO[:, :3, 3].tolist()}


def bottle_outcome(X_BO: Array) -> Outcome:
    """The outcome of a bottle with the poses (N, 4, 4): one that falls after it has left the searched area is lost."""
    x_low, x_high, y_low, y_high = BOTTLE_AREA
    x_m, y_m = X_BO[:, 0, 3], X_BO[:, 1, 3]
    is_out = (x_m <= x_low) | (x_m >= x_high) | (y_m <= y_low) | (y_m >= y_high)
    is_tipped = np.rad2deg(np.arccos(np.clip(X_BO[:, 2, 2], -1, 1))) > TIPPED_DEG
    if is_tipped.any() and not is_out[: int(is_tipped.argmax()) + 1].any():
        return Outcome.TIPPED
    return Outcome.LOST if is_out[-1] else Outcome.TIPPED if is_tipped.any() else Outcome.UPRIGHT
