"""How well a touch-off finds table and tool: random hidden errors of both in the simulated lab, against the truth.

Prints one line a seed, then the errors' median and 95th percentile and how often the stated intervals held; with
--scoops, how scoops end without and with what it found, beside a world where nothing is off.

    python benchmarks/touch_off.py --seeds 20 --scoops 5
"""

from __future__ import annotations

import argparse
import io
import json
import logging
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.touch_off.asking import NoAssistant
from adaptsim_cli.touch_off.errors import TouchOffFailed
from adaptsim_cli.touch_off.flow import touch_off
from adaptsim_cli.touch_off.parts import Grasp, Plan, TouchRig, plan_of
from adaptsim_cli.touch_off.solving import Result
from hw.types import Array
from hw.workcell import Workcell
from sim.lab.cell import Cell
from sim.lab.simulated import READY_RAD
from sim.lab.touch import TouchLab
from sim.lab.world import Mount, Sensing, World, load_world
from sim.panda.correction import ToolCorrection
from sim.panda.feelers import empty_hand, feeling, touchable
from sim.panda.planning import home, trial_paths
from sim.panda.tool import cell_as_shipped, tool_of
from sim.panda.touching import HeldTool
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
MOST = {"table": 10.0, "tilt": 5.0, "tool": 4.0, "roll": 15.0, "pitch": 50.0}
"""Largest hidden errors: mm, mrad, mm, mrad, mrad."""


@dataclass(frozen=True)
class Score:
    """One touch-off against the truth: error and stated 95 % half width of each quantity."""

    error: dict[str, float]
    within: dict[str, float]
    edge_mm: float  # what a scoop feels: error of the edge against the table, at the task's pitch


def world_of(seed: int, joint_offset_mrad: float) -> World:
    """The middle of all parameters, table and tool off by random amounts."""
    rng = np.random.default_rng(seed)
    table, tilt_x, tilt_y, tool, roll, pitch = rng.uniform(-1.0, 1.0, 6)
    tilts = MOST["tilt"] * tilt_x, MOST["tilt"] * tilt_y
    x_m, y_m = touchable(HARDWARE).centre_m
    mount = Mount(
        table_height_mm=MOST["table"] * table - tilts[0] * x_m - tilts[1] * y_m,
        table_tilt_mrad=tilts,
        tool_height_mm=MOST["tool"] * tool,
        tool_roll_mrad=MOST["roll"] * roll,
    )
    effects = TASK.unmodelled(pitch_bias_rad=1e-3 * MOST["pitch"] * pitch)
    nominal = load_world("wd", TASK)
    return replace(nominal, unmodelled=effects, mount=mount, sensing=Sensing(joint_offset_mrad=joint_offset_mrad))


def rig_of(lab: TouchLab, cell: Workcell, plan: Plan) -> TouchRig:
    """The lab's devices, ready for a touch-off by `plan`."""
    return TouchRig(
        name="fake",
        title="lab",
        key="test",
        tool_name="scooping tool",
        arm=lab.arm,
        hand=lab.hand,
        grasp=Grasp(),
        empty=HeldTool(cell, np.eye(4)),
        loaded=HeldTool(cell.holding(feeling(HARDWARE)), HARDWARE.X_FT),
        plan=plan,
        home_rad=home(HARDWARE.X_FT, cell.holding(tool_of(HARDWARE)), HARDWARE.home_pitch_rad),
        tool_there=lab.offer_tool,
    )


def touched(world: World, seed: int) -> tuple[Result, dict[str, Any]]:
    cell = cell_as_shipped(HARDWARE, "panda").holding(empty_hand())
    with TouchLab(TASK, world, seed, cell, home_q_rad=READY_RAD) as lab:
        rig = rig_of(lab, cell, plan_of(HARDWARE))
        found = touch_off(rig, NoAssistant(), Screen(console=Console(file=io.StringIO())))
        return found.result, lab.truth()


def score(found: Result, truth: dict[str, Any]) -> Score:
    height_m, slope_x, slope_y = truth["table"]
    at_m = np.array(touchable(HARDWARE).centre_m)
    true_height_m = height_m + slope_x * at_m[0] + slope_y * at_m[1]
    pairs = {
        "table height mm": (found.table_height_m, true_height_m, 1e3),
        "tilt x mrad": (found.tilt_x, slope_x, 1e3),
        "tilt y mrad": (found.tilt_y, slope_y, 1e3),
        "blade height mm": (found.height_m, truth["tool_height_m"], 1e3),
        "blade pitch deg": (found.pitch_rad, truth["tool_pitch_rad"], float(np.rad2deg(1.0))),
        "blade roll deg": (found.roll_rad, truth["tool_roll_rad"], float(np.rad2deg(1.0))),
    }
    error = {name: scale * (e.value - true) for name, (e, true, scale) in pairs.items()}
    within = {name: scale * e.within for name, (e, _, scale) in pairs.items()}
    return Score(error, within, error["blade height mm"] - error["table height mm"])


def outcomes(world: World, correction: ToolCorrection, contexts: Array, actions: Array) -> list[bool]:
    """Whether the piece ends on the blade, scoop by scoop, the arm planning with `correction`."""
    X_FT = correction.X_FT(HARDWARE.X_FT)
    believed = cell_as_shipped(replace(HARDWARE, X_FT=X_FT), "panda").over(correction.table)
    q_home, ended = home(X_FT, believed), []
    for context, action in zip(contexts, actions, strict=True):
        motion = correction.in_base(HARDWARE.plan(context, action))
        path = trial_paths(motion, X_FT, believed, q_home)[1]
        cell = Cell(TASK, world)
        cell.reset(path.q_rad[0], HARDWARE.rest_pose(context, world.parameters, world.nuisance, world.unmodelled))
        played = cell.simulate(path.t_s, path.q_rad)
        poses = cell.poses(played.positions[-1:])
        x_m, y_m, z_m = (np.linalg.inv(poses[cell.bodies.tool][0]) @ poses[cell.bodies.object][0])[:3, 3]
        ended.append(bool(z_m > 0.001 and -0.10 <= x_m <= 0.0 and abs(y_m) <= 0.04))
    return ended


def scoops(seeds: int, joint_offset_mrad: float, count: int) -> dict[str, float]:
    """Share of scoops that end on the blade in the worlds of the first seeds: without, with, and where all is well."""
    ends: dict[str, list[bool]] = {"nothing touched": [], "touched off": [], "nothing is off": []}
    for seed in range(min(seeds, 4)):
        world = world_of(seed, joint_offset_mrad)
        rng = np.random.default_rng(seed)
        contexts, actions = TASK.context.sample(rng, count), TASK.action.sample(rng, count)
        found, _ = touched(world, seed)
        right = replace(world, mount=Mount(), unmodelled=TASK.unmodelled())
        for name, where, correction in (
            ("nothing touched", world, ToolCorrection()),
            ("touched off", world, found.correction),
            ("nothing is off", right, ToolCorrection()),
        ):
            ends[name] += outcomes(where, correction, contexts, actions)
    return {name: float(np.mean(values)) for name, values in ends.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--joint-offset-mrad", type=float, default=0.0, help="of every joint's zero, root mean square")
    parser.add_argument("--scoops", type=int, default=0, help="scoops in each of the first four worlds")
    arguments = parser.parse_args()
    logging.getLogger("drake").setLevel(logging.ERROR)
    scores: list[Score] = []
    refused = 0
    for seed in range(arguments.seeds):
        started_s = time.process_time()
        try:
            scores.append(score(*touched(world_of(seed, arguments.joint_offset_mrad), seed)))
        except TouchOffFailed as refusal:
            refused += 1
            print(f"seed {seed}: refused: {refusal}", flush=True)
            continue
        said = ", ".join(f"{name} {value:+.3f}" for name, value in scores[-1].error.items())
        took_s = time.process_time() - started_s
        print(f"seed {seed}: {said}; edge {scores[-1].edge_mm:+.3f} mm; {took_s:.0f} s", flush=True)
    summary: dict[str, Any] = {"seeds": arguments.seeds, "refused": refused}
    print(f"refused {refused} of {arguments.seeds}")
    for name in scores[0].error:
        errors = np.abs([s.error[name] for s in scores])
        held_in = float(np.mean([abs(s.error[name]) <= s.within[name] for s in scores]))
        stated = float(np.median([s.within[name] for s in scores]))
        summary[name] = {
            "median": float(np.median(errors)),
            "p95": float(np.percentile(errors, 95)),
            "stated": stated,
            "covered": held_in,
        }
        print(
            f"{name:16s} median {np.median(errors):.3f}  p95 {np.percentile(errors, 95):.3f}  stated ± {stated:.3f}  "
            f"covered {held_in:.2f}"
        )
    edge = np.abs([s.edge_mm for s in scores])
    summary["edge_mm"] = {"median": float(np.median(edge)), "p95": float(np.percentile(edge, 95))}
    print(f"edge against table median {np.median(edge):.3f}  p95 {np.percentile(edge, 95):.3f} mm")
    if arguments.scoops:
        summary["scoops"] = scoops(arguments.seeds, arguments.joint_offset_mrad, arguments.scoops)
        print("scoops that end on the blade: " + ", ".join(f"{k} {v:.2f}" for k, v in summary["scoops"].items()))
    print(json.dumps(summary))


if __name__ == "__main__":
    main()
