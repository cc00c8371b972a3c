"""What stops a rolling piece: how far it rolls on the level under each contact law, and how scoops end.

    python benchmarks/rolling.py --scoops 160

The first table rolls a sphere of 25 mm on the level table and states its mean rolling resistance: the height that it
could have climbed over the distance that it rolled. The second one scoops with random actions in Omega, as the paper
judges (at 1.0 s) and at rest, with the turner's neck and without, and under the other contact law.
"""

from __future__ import annotations

import argparse
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from pydrake.geometry import HalfSpace
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.planning import RobotDiagramBuilder
from pydrake.systems.analysis import Simulator

from hw.types import Array
from perception.types import REST_M_S
from sim.rollouts import process_pool
from sim.tasks.scooping import TASK, rollout, scene
from sim.tasks.scooping.handle import NECK_SIZE_M
from sim.tasks.scooping.params import Unmodelled
from sim.tasks.shared.contact import rigid, set_contact

RADIUS_M, FRICTION, SPEED_M_S = 0.0125, 0.35, 0.2
LAWS = {
    "SAP, 120 ms (training)": ("sap", 0.120),
    "SAP, 20 ms": ("sap", 0.020),
    "lagged, 1 s/m": ("lagged", 0.120),
}
MODULI_PA = (1e4, 5e4, 2e5)
GRAVITY_M_S2 = 9.81
READ_S, LONGEST_S = 0.02, 3.0
NECK_M, NO_NECK_M = NECK_SIZE_M, (1e-3, 1e-3, 1e-3)


@dataclass(frozen=True)
class Case:
    """One way to scoop and to judge."""

    name: str
    neck: bool
    contact: str
    judged_s: float


CASES = (
    Case("no neck, judged at 1.0 s", False, "sap", 1.0),
    Case("no neck, judged at rest", False, "sap", rollout.LATEST_S),
    Case("neck, judged at rest", True, "sap", rollout.LATEST_S),
    Case("neck, judged at rest, lagged", True, "lagged", rollout.LATEST_S),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scoops", type=int, default=160)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=None)
    arguments = parser.parse_args()
    print(f"| contact | {' | '.join(f'{e / 1e3:g} kPa' for e in MODULI_PA)} |\n|---|---|---|---|")
    for name, (contact, relaxation_s) in LAWS.items():
        rolled_m = [rolls_m(e_Pa, contact, relaxation_s) for e_Pa in MODULI_PA]
        print(f"| {name} | {' | '.join(f'{1e3 * d:.0f} mm, {resistance(d):.3f}' for d in rolled_m)} |", flush=True)
    print("\n| scoops | ellipsoids on the blade | at the neck | cylinders on the blade |\n|---|---|---|---|")
    with process_pool(arguments.workers) as executor:
        for case in CASES:
            print(told(case, scoops(case, arguments.scoops, arguments.seed, executor)), flush=True)


def rolls_m(e_Pa: float, contact: str, relaxation_s: float) -> float:
    """How far the sphere rolls until it rests."""
    robot = RobotDiagramBuilder(time_step=scene.STEP_S)
    plant = robot.plant()
    set_contact(plant, "sap" if contact == "sap" else "lagged")
    plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "table", rigid(FRICTION))
    parameters = np.array([FRICTION, e_Pa, 0, 200.0 * RADIUS_M])
    body = scene.add_piece(plant, parameters, np.array([RADIUS_M]), Unmodelled(), relaxation_s)
    plant.Finalize()
    simulator = Simulator(robot.Build())
    state = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(state, body, RigidTransform([0.0, 0.0, RADIUS_M]))
    turning: Any = np.array([0.0, SPEED_M_S / RADIUS_M, 0.0])
    forward: Any = np.array([SPEED_M_S, 0.0, 0.0])
    rolling = SpatialVelocity(turning, forward)
    plant.SetFreeBodySpatialVelocity(state, body, rolling)
    for t_s in np.arange(READ_S, LONGEST_S, READ_S):
        simulator.AdvanceTo(t_s)
        if abs(body.EvalSpatialVelocityInWorld(state).translational()[0]) < REST_M_S:
            break
    return float(body.EvalPoseInWorld(state).translation()[0])


def resistance(rolled_m: float) -> float:
    """Kinetic energy of a rolling sphere over weight and distance."""
    return 0.7 * SPEED_M_S**2 / (GRAVITY_M_S2 * rolled_m)


def scoops(case: Case, count: int, seed: int, executor: Executor) -> Array:
    """(count, 3): shape, on the blade, at the neck."""
    rng = np.random.default_rng(seed)
    spaces = TASK.parameters, TASK.context, TASK.action, TASK.nuisance
    drawn = zip(*(space.sample(rng, count) for space in spaces), strict=True)
    return np.array(list(executor.map(partial(scoop, case), drawn)))


def scoop(case: Case, drawn: tuple[Array, Array, Array, Array]) -> tuple[float, bool, bool]:
    """In a worker, which is this benchmark's alone: the scene is changed there."""
    vars(scene)["NECK_SIZE_M"] = NECK_M if case.neck else NO_NECK_M
    rollout.LATEST_S = case.judged_s
    track = TASK.simulate(*drawn, Unmodelled(contact="sap" if case.contact == "sap" else "lagged"))
    succeeded = TASK.succeeded(track)
    return round(drawn[0][2]), succeeded, succeeded and track.end_in_tool_m[0] < -0.085


def told(case: Case, rows: Array) -> str:
    ellipsoids, cylinders = rows[rows[:, 0] == 0], rows[rows[:, 0] == 1]
    on, at_neck = int(ellipsoids[:, 1].sum()), int(ellipsoids[:, 2].sum())
    return f"| {case.name} | {on} of {len(ellipsoids)} | {at_neck} | {int(cylinders[:, 1].sum())} of {len(cylinders)} |"


if __name__ == "__main__":
    main()
