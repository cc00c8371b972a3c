"""How far apart Drake and MuJoCo end, case by case, and what of that is MuJoCo's time step.

    python benchmarks/foreign_physics.py --task pushing --cases 60
    python benchmarks/foreign_physics.py --task scooping --cases 60
    python benchmarks/foreign_physics.py --task scooping --pictures docs/figures

A case is a drawn world (parameters in Omega or its margin, each effect that both know in every second one) with an
evenly drawn context and action: nobody chose it. It is rolled out in Drake as in training, again with the object
`NUDGE_M` farther off, in Drake under its other contact law, in MuJoCo, and for the first `--halved` cases in MuJoCo
with its step halved and halved again. The nudge says how much two rollouts differ that nobody can tell apart.

`--pictures` renders one rollout in both from the recorded poses, by the lab's renderer: only the motion differs.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.planning import RobotDiagramBuilder

from hw.types import Array
from perception.types import ObjectTrack
from sim.lab.drawn import draw_world, effects_of
from sim.lab.kinect import kinect_model, looking
from sim.lab.physics import Physics, effects_in, simulate_of
from sim.lab.world import World, load_world
from sim.render.renderer import Renderer
from sim.tasks import get_task
from sim.tasks.shared.readings import Readings
from sim.tasks.task import Task

NUDGE_M = 0.001
OTHER_LAW = {"pushing": "sap", "scooping": "lagged"}
NAMES = ("drake", "nudged", "other law", "mujoco", "halved", "quartered")


@dataclass(frozen=True)
class Row:
    """One case; every list is in the order of `NAMES`, as far as it was run."""

    number: int
    parameters: dict[str, float]
    effects: dict[str, Any]
    action: list[float]
    outcome: list[str]
    reward: list[float]
    end_m: list[list[float]]  # as scored: on the table when pushing, on the blade when scooping
    cpu_s: list[float]
    flags: list[str]


def main() -> None:
    arguments = _arguments()
    task = get_task(arguments.task)
    if arguments.pictures:
        picture(task, arguments.world, Path(arguments.pictures))
        return
    rows = list[Row]()
    for number in range(arguments.first, arguments.first + arguments.cases):
        rows.append(case(task, arguments.seed, number, number < arguments.halved))
        print(json.dumps(asdict(rows[-1])), flush=True)
    print(report(task, rows))


def drawn(task: Task, seed: int, number: int) -> tuple[World, Array, Array]:
    """World, context and action of a case."""
    rng = np.random.default_rng((seed, number))
    world = draw_world(task, rng, effects=effects_in("mujoco", task.unmodelled()))
    return world, task.context.sample(rng, 1)[0], task.action.sample(rng, 1)[0]


def case(task: Task, seed: int, number: int, with_steps: bool) -> Row:
    """One world, context and action, every way."""
    world, context, action = drawn(task, seed, number)
    tracks, cpu_s = list[ObjectTrack](), list[float]()

    def run(physics: Physics, unmodelled: Any) -> None:
        began = time.process_time()
        simulate = simulate_of(task.name, physics)
        tracks.append(simulate(world.parameters, context, action, world.nuisance, unmodelled))
        cpu_s.append(round(time.process_time() - began, 3))

    run("drake", world.unmodelled)
    tracks.append(_nudged(task, world, context, action))
    cpu_s.append(cpu_s[0])
    run("drake", replace(world.unmodelled, contact=OTHER_LAW[task.name]))
    run("mujoco", world.unmodelled)
    step_s = import_module(f"sim.research.mujoco.{task.name}").STEP_S
    for halvings in (1, 2) if with_steps else ():
        run("mujoco", replace(world.unmodelled, dt_s=step_s / 2**halvings))
    return Row(
        number,
        dict(zip(task.parameters.names, world.parameters.tolist(), strict=True)),
        effects_of(task, world),
        action.tolist(),
        [track.outcome.value for track in tracks],
        [round(task.score(track, context), 4) for track in tracks],
        [task.end_state(track).round(5).tolist() for track in tracks],
        cpu_s,
        [flag for track in tracks for flag in track.flags],
    )


def _nudged(task: Task, world: World, context: Array, action: Array) -> ObjectTrack:
    """The same motion in Drake, at an object that is `NUDGE_M` farther off."""
    hardware = task.require_hardware()
    X_BO = np.array(hardware.rest_pose(context, world.parameters, world.nuisance, world.unmodelled))
    X_BO[0, 3] += NUDGE_M
    motion = hardware.plan(context, action)
    play = import_module(f"sim.tasks.{task.name}.rollout").play
    track: ObjectTrack = play(motion, X_BO, world.parameters, world.nuisance, world.unmodelled)
    return track


def summary(task: Task, rows: Sequence[Row]) -> dict[str, Any]:
    """All figures, ready for JSON."""
    compared = {
        "Drake, and with the object 1 mm farther": (0, 1),
        "Drake, and under its other contact law": (0, 2),
        "Drake, and MuJoCo": (0, 3),
        "Drake's other law, and MuJoCo": (2, 3),
        "MuJoCo, and with half the step": (3, 4),
        "half the step, and a quarter": (4, 5),
    }
    return {
        "task": task.name,
        "cases": len(rows),
        "pairs": {name: agreement(task, rows, *pair) for name, pair in compared.items()},
        "cpu_s": {
            name: float(np.median([row.cpu_s[i] for row in rows if len(row.cpu_s) > i]))
            for i, name in enumerate(NAMES)
            if any(len(row.cpu_s) > i for row in rows)
        },
        "flags": sorted({flag for row in rows for flag in row.flags}),
    }


def agreement(task: Task, rows: Sequence[Row], one: int, other: int) -> dict[str, Any]:
    """Outcomes and rewards of two ways to roll out, and how far apart successes end."""
    rows = [row for row in rows if len(row.outcome) > max(one, other)]
    if not rows:
        return {"cases": 0}
    good = _succeeds(task)
    apart = [
        1e3 * float(np.linalg.norm(np.subtract(row.end_m[one], row.end_m[other])))
        for row in rows
        if good(row.outcome[one]) and good(row.outcome[other])
    ]
    rewards = np.array([[row.reward[one], row.reward[other]] for row in rows])
    varied = len(rows) > 2 and bool((rewards.std(axis=0) > 0.0).all())
    return {
        "cases": len(rows),
        "agree": sum(row.outcome[one] == row.outcome[other] for row in rows),
        "succeed": [sum(good(row.outcome[i]) for row in rows) for i in (one, other)],
        "apart_mm": round(float(np.median(apart)), 2) if apart else None,
        "apart_mm_p90": round(float(np.quantile(apart, 0.9)), 2) if apart else None,
        "reward_correlation": round(float(np.corrcoef(rewards.T)[0, 1]), 3) if varied else None,
        "reward": rewards.mean(axis=0).round(3).tolist(),
    }


def _succeeds(task: Task) -> Callable[[str], bool]:
    wanted = {"pushing": "upright", "scooping": "on_blade"}[task.name]
    return lambda outcome: outcome == wanted


def report(task: Task, rows: Sequence[Row]) -> str:
    """The same as Markdown."""
    found = summary(task, rows)
    head = "| {} | cases | outcomes agree | succeed | apart mm (median, p90) | rewards correlate | mean reward |"
    rule = "|---|---|---|---|---|---|---|"
    lines = ["", head.format("compared"), rule]
    lines += [_line(name, values) for name, values in found["pairs"].items()]
    cost = ", ".join(f"{name} {cpu_s:.2f} s" for name, cpu_s in found["cpu_s"].items())
    return "\n".join([*lines, "", f"CPU per rollout (median): {cost}.", *found["flags"]])


def _line(name: str, v: dict[str, Any]) -> str:
    if not v["cases"]:
        return f"| {name} | 0 | | | | | |"
    apart = "–" if v["apart_mm"] is None else f"{v['apart_mm']:.1f}, {v['apart_mm_p90']:.1f}"
    correlation = "–" if v["reward_correlation"] is None else f"{v['reward_correlation']:.2f}"
    succeed, reward = (f"{a:g} and {b:g}" for a, b in (v["succeed"], v["reward"]))
    return f"| {name} | {v['cases']} | {v['agree']} | {succeed} | {apart} | {correlation} | {reward} |"


LOOKS = {
    "pushing": ("wd", [0.05, 0.7], (0.0, 0.12, 0.25, 0.6), ((0.80, -0.62, 0.34), (0.68, 0.0, 0.02))),
    "scooping": ("wd", [-0.05, 0.09, 0.012], (0.0, 0.1, 0.2, 0.4), ((0.78, -0.45, 0.16), (0.77, 0.0, 0.015))),
}
"""World, action, moments after the start of the readings in s, and where the camera stands and looks, in m."""


def picture(task: Task, name: str | None, folder: Path) -> None:
    """`foreign-physics-TASK.jpg`: the moments in a row, Drake's above MuJoCo's."""
    default, action, moments_s, places_m = LOOKS[task.name]
    eye_m, target_m = np.array(places_m)
    world, hardware = load_world(name or default, task), task.require_hardware()
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


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=("pushing", "scooping"), default="scooping")
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--halved", type=int, default=60, help="so many of them also with the step halved twice")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pictures", help="render one rollout in both into this folder instead")
    parser.add_argument("--world", help="which one to render")
    return parser.parse_args()


if __name__ == "__main__":
    main()
