"""The effect of a calibration: pushes tracked with the camera pose that a lab begins with, and with a calibrated one.

    python benchmarks/calibration_use.py --seeds 12

Every seed is a lab of its own: camera off by 3 mm and 0.3 degrees (normal, each), joint zeros off by 0.5 mrad, encoders
by 0.1 mrad. It is calibrated from 25 views with simulated corners (0.1 px; `calibration_rendered.py` does that part
through the camera), then its arm pushes a bottle. Depth images of each push are rendered and tracked twice: with the
nominal pose, and with the calibrated one. In mm:

found      how far from the truth the bottle is found before the motion
relative   how far the tool is, against the bottle, from where both are believed to be when the motion begins; after
           calibrating the joint offsets found count
tracked    mean over the frames of the push
rest       in the last frame
refused    pushes that would not be made, since the bottle was found too far from its mark, or not at all
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "tests" / "support"))
from kept import Kept
from pushes import GONE, DepthEye, Push, Result, judged, pushed
from simulated_views import BOUNDS, Quality, Truth, random_poses, seen

from adaptsim_cli.bench.devices.trackers import tracker_of
from calib.solve import solve
from calib.types import Mounting, Setup
from hw.kinematics import forward
from hw.types import Array
from perception.board import draw
from perception.board.types import Board
from sim.lab.board import HeldBoard
from sim.lab.calibrating import nominal_X_BC
from sim.lab.kinect import default_X_BC, kinect_model
from sim.lab.rng_streams import joint_zeros
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Sensing, load_world
from sim.panda.planning import home
from sim.panda.tool import cell_as_shipped
from sim.render.sensor import SensorNoise
from sim.tasks.pushing import HARDWARE, TASK

SENSING = Sensing(
    extrinsic_error_mm=3.0, extrinsic_error_deg=0.3, encoder_noise_mrad=0.1, joint_offset_mrad=0.5
)  # fmt: skip
VIEWS, PUSHES, TRIES = 25, 2, 29


NAMES = ("found_mm", "relative_mm", "tracked_mm", "rest_mm")
"""Of one push with one camera pose; NaN where it was refused."""


def calibrated(seed: int) -> tuple[Array, Array]:
    """X_BC (4, 4) and joint offsets (7,) as the calibration finds them."""
    rng, board = np.random.default_rng([seed, 7]), Board()
    setup = Setup(Mounting.FIXED, board, kinect_model().colour)
    X_FM = HeldBoard(draw(board, 16), board.size_m).X_FM
    truth = Truth(default_X_BC(), X_FM, joint_zeros(seed, SENSING.joint_offset_mrad))
    q_rad = random_poses(setup, truth, forward, BOUNDS, VIEWS, rng, (0.45, 1.15))
    noise = Quality(0.1, 1e-3 * SENSING.encoder_noise_mrad)
    solution = solve(seen(setup, truth, forward, q_rad, noise, rng), setup, forward)
    return solution.X_AC, np.zeros(7) if solution.joints is None else solution.joints.offsets_rad


def pushes(seed: int) -> list[Push]:
    """Random executable actions in the lab of that seed."""
    rng, cell = np.random.default_rng(seed), cell_as_shipped(HARDWARE, "panda")
    q_home, world = home(HARDWARE.X_FT, cell), replace(load_world("wd", TASK), sensing=SENSING)
    with SimulatedLab(TASK, world, seed, cell, home_q_rad=q_home) as lab:
        out = list(islice(pushed(lab, cell, rng, TRIES), PUSHES))
    if len(out) < PUSHES:
        raise RuntimeError(f"seed {seed}: {len(out)} of {PUSHES} pushes were executable in {TRIES} tries")
    return out


def row(result: Result | None, push: Push, offsets_rad: Array, zeros_rad: Array, found_m: Array) -> dict[str, float]:
    if result is None:
        return dict.fromkeys(NAMES, float("nan"))
    q_rad = push.execution.q_at(push.execution.t_start_s)
    tool_m, believed_m = ((forward(q_rad + extra) @ HARDWARE.X_FT)[:2, 3] for extra in (zeros_rad, offsets_rad))
    bottle_m = push.bottle(push.execution.t_start_s)[:2, 3]
    relative_mm = 1e3 * float(np.linalg.norm((tool_m - bottle_m) - (believed_m - found_m)))
    values = (result.found_mm, relative_mm, float(result.xy_mm.mean()), result.rest_mm)
    return dict(zip(NAMES, values, strict=True))


def one(seed: int) -> dict[str, list[dict[str, float]]]:
    """Rows of all pushes of a lab, before and after calibrating it."""
    tracker, eye, cameras = tracker_of(TASK), DepthEye(kinect_model()), np.random.default_rng([seed, 1])
    nominal = nominal_X_BC(replace(load_world("wd", TASK), sensing=SENSING), seed)
    zeros_rad = joint_zeros(seed, SENSING.joint_offset_mrad)
    rows: dict[str, list[dict[str, float]]] = {"before": [], "after": []}
    for push in pushes(seed):
        film = eye.film(push, SensorNoise.draw(cameras), cameras, lambda _: GONE)
        for name, (X_BC, offsets_rad) in (("before", (nominal, np.zeros(7))), ("after", calibrated(seed))):
            result = judged(tracker, eye.model, X_BC, push, film, 1)
            found_m = np.zeros(2) if result is None else np.asarray(tracker.find(film[0], eye.model, X_BC).xy_m)
            rows[name].append(row(result, push, offsets_rad, zeros_rad, found_m))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="JSON lines, written as it goes and read on resuming")
    args = parser.parse_args()
    store = Kept(args.keep)
    rows: dict[str, list[dict[str, float]]] = {"before": [], "after": []}
    for seed in range(args.first, args.first + args.seeds):
        made = store.row("use", seed, partial(one, seed))
        for name, all_rows in rows.items():
            all_rows.extend(made[name])
        print(f"seed {seed}: {rows_in_words(made['before'])}  ->  {rows_in_words(made['after'])}", flush=True)
    print(f"\n{args.seeds} labs, {PUSHES} pushes each; mm: median / 95th percentile")
    print(f"{'':<10}" + "".join(f"{name:>18}" for name in NAMES) + f"{'refused':>12}")
    for name, all_rows in rows.items():
        columns = (np.array([r[key] for r in all_rows]) for key in NAMES)
        cells = "".join(f"{np.nanmedian(c):>10.2f} / {np.nanpercentile(c, 95):<5.2f}" for c in columns)
        print(f"{name:<10}{cells}{sum(np.isnan(r['found_mm']) for r in all_rows):>9} of {len(all_rows)}")


def rows_in_words(rows: list[dict[str, float]]) -> str:
    return ", ".join(f"found {r['found_mm']:.2f} tracked {r['tracked_mm']:.2f}" for r in rows)


if __name__ == "__main__":
    main()
