"""How an arm holds a task's tool: pictures at the start, at mid-motion and at the end of one motion, from two sides.

The object is where the training simulator has it at that moment, with the middle of all parameters, drawn upright.

python benchmarks/mount.py --task pushing --model panda --action 0 0.8 --png docs/figures/mount-pushing.png
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from hw.types import Array
from sim.lab.kinect import kinect_model, looking
from sim.panda.model import FLANGE_NAME, JOINT_NAMES, add_panda
from sim.panda.planning import home, trial_paths
from sim.panda.shapes import visuals
from sim.panda.tool import cell_as_shipped
from sim.render.renderer import Renderer
from sim.tasks import get_task
from sim.tasks.task import Task

VIEWS = {"from the right": (0.50, -1.05, 0.35), "from ahead and the left": (1.25, 0.65, 0.50)}
LOOK_AT_M = (0.45, 0.0, 0.17)
CROP = (slice(130, 590), slice(240, 1040))


def pictures(task: Task, model: str, action: Array) -> dict[tuple[str, str], Array]:
    """(view, moment) -> colour picture."""
    hardware = task.require_hardware()
    cell = cell_as_shipped(hardware, model)
    motion = hardware.plan(task.reference_context, action)
    path = trial_paths(motion, hardware.X_FT, cell, home(hardware.X_FT, cell))[1]
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), hardware.time_step_s(None))
    add_panda(plant, model)
    parameters, nuisance = (s.middle for s in (task.parameters, task.nuisance))
    bodies = hardware.build_scene(plant, plant.GetFrameByName(FLANGE_NAME), hardware.X_FT, parameters, nuisance, None)
    plant.Finalize()
    state = plant.CreateDefaultContext()
    X_BO = hardware.rest_pose(task.reference_context, parameters, nuisance, None)
    track = task.simulate(parameters, task.reference_context, action, nuisance)
    shown = (*visuals(), *bodies.visuals)
    names = {v.body for v in shown} - {"world"}
    made: dict[tuple[str, str], Any] = {}
    for view, from_m in VIEWS.items():
        renderer = Renderer(kinect_model("kinect"), looking(np.array(from_m), np.subtract(LOOK_AT_M, from_m)), shown)
        for moment, share in (("start", 0.0), ("middle", 0.5), ("end", 1.0)):
            q_rad = path.q_rad[round(share * (len(path.q_rad) - 1))]
            X_BO[:3, 3] = track.at(np.array([share * path.duration_s]))[0, :3]
            plant.SetFreeBodyPose(state, plant.GetBodyByName(bodies.object), RigidTransform(X_BO))
            for name, q in zip(JOINT_NAMES, q_rad, strict=True):
                plant.GetJointByName(name).set_angle(state, q)
            poses = {n: plant.GetBodyByName(n).EvalPoseInWorld(state).GetAsMatrix4()[None] for n in names}
            made[view, moment] = renderer.render(poses, None, np.random.default_rng(0))[0][CROP]
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--task", default="pushing")
    parser.add_argument("--model", default="panda", choices=["panda", "fr3"])
    parser.add_argument("--action", type=float, nargs="+", help="default: the middle of the action space")
    parser.add_argument("--png", type=Path, required=True)
    options = parser.parse_args()
    import matplotlib  # noqa: PLC0415

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    task = get_task(options.task)
    action = np.array(options.action) if options.action else (task.action.low + task.action.high) / 2
    made = pictures(task, options.model, action)
    figure, axes = plt.subplots(len(VIEWS), 3, figsize=(13.0, 5.5), layout="constrained")
    for axis, ((view, moment), picture) in zip(axes.flat, made.items(), strict=True):
        axis.imshow(picture)
        axis.set(xticks=[], yticks=[], title=f"{moment}, {view}")
    figure.savefig(options.png, dpi=110)
    print(f"picture: {options.png}")


if __name__ == "__main__":
    main()
