"""How well a touch-off finds table and tool: random hidden errors of both in the simulated lab, against the truth.

Prints one line per seed, then the median and 95th percentile of the errors, and how often the stated intervals were
right.

    python benchmarks/touch_off.py --seeds 300
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
from scipy.spatial.transform import Rotation

from adaptsim_cli.bench.touch_off.guiding import touch_off
from adaptsim_cli.bench.touch_off.parts import GuidedTouchRig, TouchOffFailed
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.screen.console import Screen
from hw.collision import Table
from hw.poses import pose
from sim.lab.simulated import READY_RAD
from sim.lab.touch import TouchLab
from sim.lab.world import Mount, Sensing, World, load_world
from sim.panda.setting_down import set_downs
from sim.panda.tool import ToolCorrection, cell_as_shipped, feeling, touchable
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
SCOOP_PITCH_RAD = np.deg2rad(6.0)
MOST = {"table": 10.0, "tilt": 5.0, "tool": 4.0, "roll": 15.0, "pitch": 50.0}
"""Largest hidden errors: mm, mrad, mm, mrad, mrad."""


@dataclass(frozen=True)
class Score:
    """One touch-off against the truth: error and stated 95 % half width of each quantity."""

    error: dict[str, float]
    within: dict[str, float]
    edge_mm: float  # what a scoop feels: how much higher than planned the edge is over the table
    edge_within_mm: float  # stated: two-sided 95 %
    edge_too_high_mm: float  # stated: one-sided 95 %


def world_of(seed: int) -> World:
    """The middle of all parameters, table and tool off by random amounts."""
    rng = np.random.default_rng(seed)
    table, tilt_x, tilt_y, tool, roll, pitch = rng.uniform(-1.0, 1.0, 6)
    tilts = MOST["tilt"] * tilt_x, MOST["tilt"] * tilt_y
    x_m, y_m = touchable(HARDWARE).centre_m
    mount = Mount(
        table_height_mm=MOST["table"] * table - tilts[0] * x_m - tilts[1] * y_m,
        table_rise_mrad=tilts,
        tool_height_mm=MOST["tool"] * tool,
        tool_roll_mrad=MOST["roll"] * roll,
    )
    effects = TASK.unmodelled(pitch_bias_rad=1e-3 * MOST["pitch"] * pitch)
    return replace(load_world("wd", TASK), unmodelled=effects, mount=mount, sensing=Sensing())


def set_down(world: World, seed: int) -> tuple[SavedTouchOff, dict[str, Any]]:
    """A touch-off: a simulated person sets the tool down."""
    cell = cell_as_shipped(HARDWARE, "panda").holding(feeling(HARDWARE))
    at = touchable(HARDWARE)
    with TouchLab(TASK, world, seed, cell, home_q_rad=READY_RAD) as lab:
        rig = GuidedTouchRig(
            name="fake",
            title="lab",
            key="test",
            tool_name="scooping tool",
            arm=lab.arm,
            model=cell.arm,
            designed=HARDWARE.X_FT,
            table=cell.table,
            set_downs=set_downs(at.feelers, at.centre_m),
            work_m=np.array(at.centre_m),
            pause=lambda _: None,
            person=lab,
        )
        result = touch_off(rig, Screen(console=Console(file=io.StringIO())), unattended=True, created="")
        return result, lab.truth()


def score(result: SavedTouchOff, truth: dict[str, Any]) -> Score:
    height_m, slope_x, slope_y = truth["table"]
    at_m = np.array(touchable(HARDWARE).centre_m)
    true_height_m = height_m + slope_x * at_m[0] + slope_y * at_m[1]
    pairs = {
        "table height mm": (result.table_height_m, true_height_m, 1e3),
        "tilt x mrad": (result.tilt_x, slope_x, 1e3),
        "tilt y mrad": (result.tilt_y, slope_y, 1e3),
        "blade height mm": (result.tool_height_m, truth["tool_height_m"], 1e3),
        "blade pitch deg": (result.tool_pitch_rad, truth["tool_pitch_rad"], float(np.rad2deg(1.0))),
        "blade roll deg": (result.tool_roll_rad, truth["tool_roll_rad"], float(np.rad2deg(1.0))),
    }
    error = {name: scale * (e.value - true) for name, (e, true, scale) in pairs.items()}
    within = {name: scale * e.within for name, (e, _, scale) in pairs.items()}
    lift_mm = 1e3 * result.edge_over_table_m
    return Score(error, within, 1e3 * edge_m(result, truth), lift_mm, 1e3 * result.edge_too_high_m)


def edge_m(result: SavedTouchOff, truth: dict[str, Any]) -> float:
    """The true height of the edge's middle over the true table, planned to be on it, pitched as in a scoop."""
    c, at = result.correction(), touchable(HARDWARE)
    edge = [feeler for feeler in at.feelers if "edge" in feeler.name]
    middle, radius_m = np.mean([feeler.p_T_m for feeler in edge], axis=0), edge[0].radius_m
    R = Rotation.from_euler("Y", SCOOP_PITCH_RAD).as_matrix()
    X_BT = c.table.X_BW @ pose(R, np.array([*at.centre_m, radius_m]) - R @ middle)
    height_m, slope_x, slope_y = truth["table"]
    really = ToolCorrection(
        Table(height_m, slope_x, slope_y),
        truth["tool_height_m"],
        pitch_rad=truth["tool_pitch_rad"],
        roll_rad=truth["tool_roll_rad"],
    )
    X_BF = X_BT @ np.linalg.inv(c.X_FT(HARDWARE.X_FT))
    edge_B_m = (X_BF @ really.X_FT(HARDWARE.X_FT) @ np.append(middle, 1.0))[:3]
    return float(edge_B_m[2] - radius_m - really.table.height_at(edge_B_m))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=300)
    seeds = parser.parse_args().seeds
    logging.getLogger("drake").setLevel(logging.ERROR)
    scores: list[Score] = []
    refused = 0
    for seed in range(seeds):
        started_s = time.process_time()
        try:
            scores.append(score(*set_down(world_of(seed), seed)))
        except TouchOffFailed as refusal:
            refused += 1
            print(f"seed {seed}: refused: {refusal}", flush=True)
            continue
        by_name = ", ".join(f"{name} {value:+.3f}" for name, value in scores[-1].error.items())
        took_s = time.process_time() - started_s
        print(f"seed {seed}: {by_name}; edge {scores[-1].edge_mm:+.3f} mm; {took_s:.0f} s", flush=True)
    print(f"refused {refused} of {seeds}")
    for name in scores[0].error:
        if "height" in name:
            continue  # only their sum is measured
        errors = np.abs([s.error[name] for s in scores])
        held_in = float(np.mean([abs(s.error[name]) <= s.within[name] for s in scores]))
        stated = float(np.median([s.within[name] for s in scores]))
        print(
            f"{name:16s} median {np.median(errors):.3f}  p95 {np.percentile(errors, 95):.3f}  stated ± {stated:.3f}  "
            f"covered {held_in:.2f}"
        )
    edge = np.array([s.edge_mm for s in scores])
    size = np.abs(edge)
    inside = float(np.mean(size <= [s.edge_within_mm for s in scores]))
    below = float(np.mean(edge <= [s.edge_too_high_mm for s in scores]))
    stated, too_high = (
        float(np.median([getattr(s, name) for s in scores])) for name in ("edge_within_mm", "edge_too_high_mm")
    )
    print(f"edge against table median {np.median(size):.3f}  p95 {np.percentile(size, 95):.3f} mm")
    print(f"  mean {edge.mean():+.3f}  sd {edge.std(ddof=1):.3f}; stated ± {stated:.3f}, covered {inside:.2f}")
    print(f"  stated at most {too_high:.3f} too high, held in {below:.2f}")


if __name__ == "__main__":
    main()
