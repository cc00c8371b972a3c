"""The motions that each arm can make with a load in its hand: accepted and refused ones by declared payload, as a
table.

    python benchmarks/payloads.py
    python benchmarks/payloads.py --moves 200

The motions, the same for every payload: the task paths of scooping and pushing (smallest, middle and largest action at
the reference context, planned with the shipped tool), and random moves between postures over the table, as fast as
their joint limits allow. Each is checked as before a real motion, its stops included (`Workcell.require`). The load
hangs 0.12 m under the flange. The last column names the quantity that refuses most of them.

A second table has the largest used share of each limit of torque and flange, by the motions of the tasks with the
shipped tool and by their stops from every 50 ms.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from dataclasses import replace

import numpy as np

from hw.braking import brake
from hw.collision import BARE_HAND, HAND_MASS, Tool
from hw.errors import MotionRefused
from hw.mass import Mass
from hw.types import JointPath
from hw.workcell import Workcell
from sim.errors import NotExecutable
from sim.panda.moves import move_path
from sim.panda.planning import home, trial_paths
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

PAYLOADS_KG = (0.0, 0.5, 1.0, 2.0, 3.0)
TASKS = ("scooping", "pushing")
UNDER_FLANGE_M = 0.12
STOPS_EVERY_S = 0.05
FAST = 0.9
"""Share of the joint limits that the random moves use."""


def loaded(tool: Tool, kg: float) -> Tool:
    """`tool` with this mass between the fingers instead of its own."""
    radius_m = 0.04
    load = Mass(kg, np.array([0.0, 0.0, UNDER_FLANGE_M]), 0.4 * kg * radius_m**2 * np.eye(3))
    return replace(tool, mass=HAND_MASS + load)


def task_paths(name: str, model: str) -> tuple[Workcell, list[JointPath]]:
    """The workcell in which a task ships, and the task's own motions there."""
    task = get_task(name)
    hardware = task.require_hardware()
    cell = cell_as_shipped(hardware, model)
    q_home = home(hardware.X_FT, cell, hardware.home_pitch_rad)
    paths = []
    for share in (0.0, 0.5, 1.0):
        action = task.action.low + share * (task.action.high - task.action.low)
        try:
            motion = hardware.plan(task.reference_context, action)
            paths.append(trial_paths(motion, hardware.X_FT, cell, q_home, carries=hardware.carries)[1])
        except NotExecutable as error:
            print(f"{model}, {name}, action {share:g} of its range: not planned ({error})")
    return cell, paths


def moves(model: str, count: int) -> tuple[Workcell, list[JointPath]]:
    """Fast moves that an arm with an empty hand may make."""
    rng = np.random.default_rng(0)
    cell = replace(cell_as_shipped(get_task("pushing").require_hardware(), model), tool=BARE_HAND)
    limits, paths = cell.arm.limits, list[JointPath]()
    middle, half = (limits.q_max_rad + limits.q_min_rad) / 2.0, (limits.q_max_rad - limits.q_min_rad) / 2.0
    while len(paths) < count:
        ends = middle + rng.uniform(-0.9, 0.9, (2, 7)) * half * np.array([0.5, 0.8, 0.3, 0.9, 0.4, 0.6, 0.8])
        path = move_path(ends[0], ends[0] + 0.3 * (ends[1] - ends[0]), limits, FAST)
        try:
            cell.require(path)
        except MotionRefused:
            continue
        paths.append(path)
    return cell, paths


def row(cell: Workcell, paths: list[JointPath], kg: float) -> tuple[int, float, str]:
    """How many of the paths pass with that load, the largest share of a torque limit, and the most frequent reason of a
    refusal.
    """
    loaded_cell, reasons, share, passed = cell.holding(loaded(cell.tool, kg)), Counter[str](), 0.0, 0
    for path in paths:
        torque = next(c for c in loaded_cell.motion.checks(path) if c.quantity == "torque")
        try:
            loaded_cell.require(path)
            passed += 1
            share = max(share, torque.ratio)
        except MotionRefused as error:
            match = re.search(r": ((?:[\w-]+ )+of (?:joint \d|the flange))", str(error))
            reasons[match[1] if match else "no stop along the path"] += 1
    return passed, share, reasons.most_common(1)[0][0] if reasons else ""


def used(cell: Workcell, paths: list[JointPath]) -> dict[str, tuple[float, float, str]]:
    """Quantity -> the largest share of its limit, its value and unit, over the paths and their stops."""
    peaks: dict[str, tuple[float, float, str]] = {}
    for path in paths:
        stops = [brake(path, at_s, cell.motion) for at_s in np.arange(STOPS_EVERY_S, path.duration_s, STOPS_EVERY_S)]
        for check in (check for one in (path, *stops) for check in cell.motion.checks(one)):
            before = peaks.get(check.quantity, (0.0, 0.0, ""))
            peaks[check.quantity] = max(before, (check.ratio, abs(check.value), check.unit))
    return peaks


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--moves", type=int, default=60)
    options = parser.parse_args()
    print("| arm | motions | payload | accepted | largest torque, share of its limit | refused mostly for |")
    print("|---|---|---|---|---|---|")
    uses: dict[tuple[str, str], dict[str, tuple[float, float, str]]] = {}
    for model in ("panda", "fr3"):
        groups = {name: task_paths(name, model) for name in TASKS} | {"fast moves": moves(model, options.moves)}
        for name, (cell, paths) in groups.items():
            if name in TASKS:
                uses[model, name] = used(cell, paths)
            for kg in PAYLOADS_KG if paths else ():
                passed, share, reason = row(cell, paths, kg)
                print(f"| {model} | {name} | {kg:g} kg | {passed} of {len(paths)} | {share:.2f} | {reason or '–'} |")
    columns = list(uses.values())
    print("\n| of motions and stops | " + " | ".join(f"{model}, {name}" for model, name in uses) + " |")
    print("|---" * (1 + len(columns)) + "|")
    for quantity in columns[0]:
        cells = (f"{value:.3g} {unit} ({100 * ratio:.0f} %)" for ratio, value, unit in (c[quantity] for c in columns))
        print(f"| {quantity} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
