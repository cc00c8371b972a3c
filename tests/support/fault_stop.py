"""The stop button pressed in the slow swing of the stop check, on an arm that coasts far too long."""

from __future__ import annotations

import numpy as np
from arm_meshes import placed
from cells import READY, cell
from fault_lab import Outcome
from fault_world import user_stop
from hard_paths import LOADED
from living_sdk import LivingSdk
from mesh_judge import surfaces
from own_judge import Array, poses
from players import arm_of

from adaptsim_cli.bench.devices.known_arm import StopMeasurement
from adaptsim_cli.bench.devices.stop_check import JOINTS, measurement, swing
from hw.errors import ArmFault
from hw.joint_limits import LIMITS

COASTING = "stop: coasts"
NEAR_M = 0.001
"""How much less than the true surface travels a measured way may be."""


class PressedAt:
    """The stop button, pressed in one cycle of a motion."""

    def __init__(self, sdk: LivingSdk, cycle: int) -> None:
        self.sdk, self._cycle = sdk, cycle

    def __call__(self, cycle: int) -> None:
        if cycle == self._cycle:
            user_stop(self)  # type: ignore[arg-type]


def stopped_swing(
    model: str, joint: int, coast_ms: float, share: float, rng: np.random.Generator
) -> tuple[StopMeasurement, float]:
    """Swing one joint (from 0), press the button at `share` of the motion -> what is kept, and the way in m of the
    point of the true surface that went farthest, hand without tool."""
    within = cell(model, LOADED)
    path = swing(READY, within, (joint,))
    sdk = LivingSdk(k=model == "panda", q_rad=READY.tolist(), coast_ms=coast_ms, rng=rng)
    sdk.when = PressedAt(sdk, round(share * len(path.t_s)))
    with arm_of(sdk, model, tool=LOADED) as arm:
        try:
            arm.execute(path)
        except ArmFault:
            stop = arm.last_stop
            assert stop is not None and stop.q_rad is not None
            return measurement(stop, path, within, "Kim"), surface_way_m(model, stop.q_rad)
    raise AssertionError("the button did not stop the arm")


def surface_way_m(model: str, q_rad: Array) -> float:
    """Joints (N, 7) -> the way of the point of the maker's meshes that goes farthest, by another kinematics."""
    X = poses(q_rad[::10])
    steps = (np.diff(placed(part.points_m, X[:, part.link]), axis=0) for part in surfaces(model))
    return max(float(np.linalg.norm(step, axis=-1).sum(axis=0).max()) for step in steps)


def one_stop(number: int, rng: np.random.Generator) -> Outcome:
    """Each joint of the swing in turn, pressed where it is fast; effective if the surface went too far."""
    model = tuple(LIMITS)[number // len(JOINTS) % len(LIMITS)]
    joint, share = JOINTS[number % len(JOINTS)], float(rng.uniform(0.45, 0.55))
    stop, true_m = stopped_swing(model, joint, float(rng.uniform(250.0, 400.0)), share, rng)
    notes = []
    if true_m > stop.worst_distance_m and stop.is_within:
        notes.append(f"joint {joint + 1}: the surface went {1e3 * true_m:.0f} mm and the stop reads: {stop}")
    if stop.distance_m < true_m - NEAR_M:
        notes.append(f"joint {joint + 1}: {1e3 * stop.distance_m:.0f} mm measured, {1e3 * true_m:.0f} mm gone")
    return Outcome(COASTING, true_m > stop.worst_distance_m, notes, stop.time_s)
