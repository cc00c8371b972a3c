"""How far apart Drake and MuJoCo end, and the same motion in both.

    python benchmarks/foreign_physics.py --task pushing
    python benchmarks/foreign_physics.py --task scooping --pictures docs/figures

A case is a drawn world (parameters in Omega or its margin, and each effect that both simulators have with a chance of
one half) with a random context and action. It is rolled out in Drake as in training, again with the object `NUDGE_M`
farther off, and in MuJoCo. The nudge shows how much two rollouts differ that look the same.

`--pictures` renders one rollout in both from the recorded poses, by the lab's renderer: only the motion differs.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from agreement import without_arm
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.planning import RobotDiagramBuilder

from perception.types import ObjectTrack
from sim.lab.drawn import draw_world
from sim.lab.kinect import kinect_model, looking
from sim.lab.physics import effects_in, simulate_of
from sim.lab.world import World, load_world
from sim.render.renderer import Renderer
from sim.tasks import get_task
from sim.tasks.shared.readings import Readings
from sim.tasks.task import Task

NUDGE_M = 0.001


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=("pushing", "scooping"), default="scooping")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--pictures", type=Path, help="render one rollout in both into this folder instead")
    asked = parser.parse_args()
    task = get_task(asked.task)
    if asked.pictures:
        picture(task, asked.pictures)
        return
    cases = [case(task, number) for number in range(asked.cases)]
    drake, nudged, mujoco = zip(*cases, strict=True)
    print("| | outcomes agree | succeed | both succeed: ends apart, median / 90 % | mean reward |")
    print("|---|---|---|---|---|")
    print(compared(task, "object 1 mm farther", drake, nudged))
    print(compared(task, "MuJoCo", drake, mujoco))


Scored = tuple[ObjectTrack, float]
"""A rollout and its reward."""


def case(task: Task, number: int) -> tuple[Scored, Scored, Scored]:
    """One world, context and action: in Drake, with the object farther off, and in MuJoCo."""
    rng = np.random.default_rng((0, number))
    world = draw_world(task, rng, effects=effects_in("mujoco", task.unmodelled()))
    context, action = task.context.sample(rng, 1)[0], task.action.sample(rng, 1)[0]
    hardware = task.require_hardware()
    motion = hardware.plan(context, action)
    X_BO = np.array(hardware.rest_pose(context, world.parameters, world.nuisance, world.unmodelled))
    drake = without_arm(task, world, motion, X_BO)
    X_BO[0, 3] += NUDGE_M
    nudged = without_arm(task, world, motion, X_BO)
    mujoco = simulate_of(task.name, "mujoco")(world.parameters, context, action, world.nuisance, world.unmodelled)
    one, other, third = ((track, task.score(track, context)) for track in (drake, nudged, mujoco))
    return one, other, third


def compared(task: Task, name: str, ours: tuple[Scored, ...], others: tuple[Scored, ...]) -> str:
    """A row of the table; ends as scored: on the table when pushing, on the blade when scooping."""
    pairs = list(zip(ours, others, strict=True))
    agree = sum(a.outcome is b.outcome for (a, _), (b, _) in pairs)
    both = [(a, b) for (a, _), (b, _) in pairs if task.succeeded(a) and task.succeeded(b)]
    apart_mm = [1e3 * float(np.linalg.norm(task.end_state(a) - task.end_state(b))) for a, b in both]
    succeed = " and ".join(str(sum(bool(task.succeeded(track)) for track, _ in way)) for way in (ours, others))
    rewards = " and ".join(f"{np.mean([reward for _, reward in way]):.2f}" for way in (ours, others))
    ends = "{:.1f} / {:.1f} mm".format(*np.quantile(apart_mm, [0.5, 0.9])) if both else ""
    return f"| {task.name}, {name} | {agree} of {len(pairs)} | {succeed} | {ends} | {rewards} |"


LOOKS = {
    "pushing": ([0.05, 0.7], (0.0, 0.12, 0.25, 0.6), ((0.80, -0.62, 0.34), (0.68, 0.0, 0.02))),
    "scooping": ([-0.05, 0.09, 0.012], (0.0, 0.1, 0.2, 0.4), ((0.78, -0.45, 0.16), (0.77, 0.0, 0.015))),
}
"""Action, moments after the start of the readings in s, and where the camera stands and looks, in m."""


def picture(task: Task, folder: Path) -> None:
    """`foreign-physics-TASK.jpg`: the moments in a row, Drake's above MuJoCo's."""
    action, moments_s, places_m = LOOKS[task.name]
    eye_m, target_m = np.array(places_m)
    world, hardware = load_world("wd", task), task.require_hardware()
    context, model = task.reference_context, kinect_model()
    motion = hardware.plan(context, np.array(action))
    X_BO = hardware.rest_pose(context, world.parameters, world.nuisance, world.unmodelled)
    renderer, strips = Renderer(model, looking(eye_m, target_m - eye_m), _visuals(task, world)), []
    for module in (f"sim.tasks.{task.name}.rollout", f"sim.research.mujoco.{task.name}"):
        found: Readings = import_module(module).readings(
            motion, X_BO, world.parameters, world.nuisance, world.unmodelled
        )
        frames = [_frame(renderer, task, found, found.t_s[0] + moment) for moment in moments_s]
        strips.append(np.hstack(frames))
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"foreign-physics-{task.name}.jpg"
    cv2.imwrite(str(file), np.vstack(strips)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(f"Written: {file}")


def _frame(renderer: Renderer, task: Task, found: Readings, t_s: float) -> Any:
    i = min(int(np.searchsorted(found.t_s, t_s - 1e-9)), len(found.t_s) - 1)
    tool, thing = (np.tile(X[i].GetAsMatrix4(), (2, 1, 1)) for X in (found.X_BT, found.X_BO))
    poses = {"pushing": {"pusher": tool, "bottle": thing}}.get(
        task.name, {"spatula": tool, "spatula_handle": tool, "piece": thing}
    )
    colour, _ = renderer.render(poses, None, np.random.default_rng(0))
    cut = colour[140:580, 320:960]
    return cv2.resize(cut, (480, 330), interpolation=cv2.INTER_AREA)


def _visuals(task: Task, world: World) -> Any:
    plant: MultibodyPlant = RobotDiagramBuilder(time_step=0.001).plant()
    hardware = task.require_hardware()
    frame, X = plant.world_frame(), np.asarray(RigidTransform().GetAsMatrix4())
    return hardware.build_scene(plant, frame, X, world.parameters, world.nuisance, world.unmodelled).visuals


if __name__ == "__main__":
    main()
