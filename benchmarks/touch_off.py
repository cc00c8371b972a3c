"""How well a touch-off finds table and tool: random hidden errors of both in the simulated lab, against the truth.

Prints one line a seed, then the errors' median and 95th percentile and how often the stated intervals held.

    python benchmarks/touch_off.py --seeds 20
"""

from __future__ import annotations

import argparse
import io
import logging
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.touch_off.flow import touch_off
from adaptsim_cli.touch_off.parts import Grasp, Plan, TouchOffFailed, TouchRig, plan_of
from adaptsim_cli.touch_off.store import SavedTouchOff
from hw.workcell import Workcell
from sim.lab.simulated import READY_RAD
from sim.lab.touch import TouchLab
from sim.lab.world import Mount, Sensing, World, load_world
from sim.panda.planning import home
from sim.panda.tool import cell_as_shipped, empty_hand, feeling, tool_of, touchable
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


def world_of(seed: int) -> World:
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
    return replace(load_world("wd", TASK), unmodelled=effects, mount=mount, sensing=Sensing())


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


def touched(world: World, seed: int) -> tuple[SavedTouchOff, dict[str, Any]]:
    cell = cell_as_shipped(HARDWARE, "panda").holding(empty_hand())
    with TouchLab(TASK, world, seed, cell, home_q_rad=READY_RAD) as lab:
        rig = rig_of(lab, cell, plan_of(HARDWARE))
        found = touch_off(rig, Screen(console=Console(file=io.StringIO())), unattended=True, created="")
        return found, lab.truth()


def score(found: SavedTouchOff, truth: dict[str, Any]) -> Score:
    height_m, slope_x, slope_y = truth["table"]
    at_m = np.array(touchable(HARDWARE).centre_m)
    true_height_m = height_m + slope_x * at_m[0] + slope_y * at_m[1]
    pairs = {
        "table height mm": (found.table_height_m, true_height_m, 1e3),
        "tilt x mrad": (found.tilt_x, slope_x, 1e3),
        "tilt y mrad": (found.tilt_y, slope_y, 1e3),
        "blade height mm": (found.tool_height_m, truth["tool_height_m"], 1e3),
        "blade pitch deg": (found.tool_pitch_rad, truth["tool_pitch_rad"], float(np.rad2deg(1.0))),
        "blade roll deg": (found.tool_roll_rad, truth["tool_roll_rad"], float(np.rad2deg(1.0))),
    }
    error = {name: scale * (e.value - true) for name, (e, true, scale) in pairs.items()}
    within = {name: scale * e.within for name, (e, _, scale) in pairs.items()}
    return Score(error, within, error["blade height mm"] - error["table height mm"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    logging.getLogger("drake").setLevel(logging.ERROR)
    scores: list[Score] = []
    refused = 0
    for seed in range(seeds):
        started_s = time.process_time()
        try:
            scores.append(score(*touched(world_of(seed), seed)))
        except TouchOffFailed as refusal:
            refused += 1
            print(f"seed {seed}: refused: {refusal}", flush=True)
            continue
        said = ", ".join(f"{name} {value:+.3f}" for name, value in scores[-1].error.items())
        took_s = time.process_time() - started_s
        print(f"seed {seed}: {said}; edge {scores[-1].edge_mm:+.3f} mm; {took_s:.0f} s", flush=True)
    print(f"refused {refused} of {seeds}")
    for name in scores[0].error:
        errors = np.abs([s.error[name] for s in scores])
        held_in = float(np.mean([abs(s.error[name]) <= s.within[name] for s in scores]))
        stated = float(np.median([s.within[name] for s in scores]))
        print(
            f"{name:16s} median {np.median(errors):.3f}  p95 {np.percentile(errors, 95):.3f}  stated ± {stated:.3f}  "
            f"covered {held_in:.2f}"
        )
    edge = np.abs([s.edge_mm for s in scores])
    print(f"edge against table median {np.median(edge):.3f}  p95 {np.percentile(edge, 95):.3f} mm")


if __name__ == "__main__":
    main()
