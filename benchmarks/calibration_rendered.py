"""Whole calibrations in the rendered lab compared with its truth, and how much better the object is then found.

    python benchmarks/calibration_rendered.py --seeds 30 --case noise
    python benchmarks/calibration_rendered.py --seeds 30 --case arm

`noise`: image noise alone. `arm`: encoder noise 0.1 mrad, joint offsets 0.5 mrad, and 15 % of the views with joints of
another moment. Both start from a nominal pose that is off by 3 mm and 0.3°. Prints one line per seed, then these
statistics: worst and 95th percentile of the error, coverage of the stated one, outliers dropped and good views lost,
and the error of the object's place before and after calibrating.
"""

from __future__ import annotations

import argparse
import io
import json
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kept import Kept
from rich.console import Console

from adaptsim_cli.bench.calibration import board_mover, flow, solving
from adaptsim_cli.bench.calibration.parts import CalibrationRig
from adaptsim_cli.bench.calibration.store import CalibrationStore
from adaptsim_cli.bench.calibration_in_use import BOARD_HOME_RAD, ways
from adaptsim_cli.bench.devices.trackers import tracker_of
from adaptsim_cli.screen.console import Screen
from calib.errors import CalibrationRejected
from calib.geometry import angle_deg, distance_mm
from calib.saved import SavedCalibration
from hw.collision import camera_box
from hw.types import Array
from perception.board import draw
from perception.board.types import Board
from perception.errors import PerceptionError
from sim.lab.board import HeldBoard
from sim.lab.calibrating import CalibrationLab, nominal_X_BC
from sim.lab.kinect import default_X_BC
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Sensing, World, load_world
from sim.panda.planning import home
from sim.panda.tool import cell_as_shipped
from sim.tasks import get_task

CASES = {
    "noise": Sensing(extrinsic_error_mm=3.0, extrinsic_error_deg=0.3),
    "arm": Sensing(extrinsic_error_mm=3.0, extrinsic_error_deg=0.3, encoder_noise_mrad=0.1, joint_offset_mrad=0.5),
}
SPOILT = {"noise": 0.0, "arm": 0.15}
PLACES_M = ((0.60, -0.02), (0.62, 0.02), (0.66, 0.0), (0.68, -0.015), (0.70, 0.015))
TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()


Row = dict[str, Any]


def calibrated(world: World, seed: int, spoilt: float, folder: Path) -> tuple[SavedCalibration, list[str]]:
    """-> the record, and the names of the views that were spoilt."""
    board = Board()
    print_of = HeldBoard(draw(board, 112), board.size_m)
    rough, home_rad = nominal_X_BC(world, seed), np.array(BOARD_HOME_RAD)
    cell = replace(cell_as_shipped(HARDWARE, "panda").holding(print_of.tool()), keep_out=(camera_box(rough),))
    with CalibrationLab(TASK, world, seed, print_of, cell, home_q_rad=home_rad) as lab:
        rig = CalibrationRig(
            "fake", "lab", "lab", lab.arm, lab.camera, board, print_of.X_FM, rough,
            ways(cell, home_rad),
            lambda _: None, lab.hands,
        )  # fmt: skip
        screen = Screen(console=Console(file=io.StringIO()))
        going = board_mover.Automatic(rig, screen, board_mover.plan(rig, 25), home_rad, unattended=True)
        try:
            record = flow.calibrate(rig, CalibrationStore(folder), going, screen, fresh=True, unattended=True)[0].record
        except CalibrationRejected:
            record = solved(folder)
    if not spoilt:
        return record, []
    names = spoil(folder / "views-0001", spoilt, seed)
    return solved(folder), names


def solved(folder: Path) -> SavedCalibration:
    return solving.solve_folder(folder / "views-0001", hw="fake").record


def spoil(views: Path, share: float, seed: int) -> list[str]:
    """Give some views joints that are off by a few hundredths of a rad: taken before the arm had settled."""
    rng = np.random.default_rng([seed, 15])
    paths = sorted(views.glob("view-*.json"))
    chosen = rng.choice(len(paths), round(share * len(paths)), replace=False)
    for i in chosen:
        record = json.loads(paths[i].read_text())
        record["q_rad"] = (np.array(record["q_rad"]) + rng.normal(0, 0.04, 7)).tolist()
        paths[i].write_text(json.dumps(record))
    return [paths[i].stem.removeprefix("view-") for i in chosen]


def found_off_mm(world: World, seed: int, X_BC: Array) -> float:
    """The error of the object's place, averaged over a few places."""
    tracker, cell = tracker_of(TASK), cell_as_shipped(HARDWARE, "panda")
    off = []
    with SimulatedLab(TASK, world, seed, cell, home_q_rad=home(HARDWARE.X_FT, cell)) as lab:
        for trial, xy_m in enumerate(PLACES_M, start=1):
            lab.bench.place(np.array(xy_m), trial, 0)
            truth = np.array(lab.truth()["trials"][-1]["X_BO_placed"])[:2, 3]
            try:
                detection = tracker.find(lab.camera.snapshot(), lab.camera.model(), X_BC)
            except PerceptionError:
                continue
            off.append(1e3 * float(np.linalg.norm(np.asarray(detection.xy_m) - truth)))
    return float(np.mean(off)) if off else float("nan")


def one(case: str, seed: int) -> Row:
    """One calibration, and the object's measured place before and after it."""
    world, started = replace(load_world("wd", TASK), sensing=CASES[case]), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        record, spoilt = calibrated(world, seed, SPOILT[case], Path(folder))
    seconds = time.perf_counter() - started
    X, truth = np.array(record.X_AC), default_X_BC()
    points = np.array(record.uncertainty.points_m)
    moved = X @ np.linalg.inv(truth)
    worst_mm = 1e3 * np.linalg.norm(points @ moved[:3, :3].T + moved[:3, 3] - points, axis=1).max()
    used = {view.name for view in record.views if view.used}
    good = {view.name for view in record.views} - set(spoilt)
    nominal = nominal_X_BC(world, seed)
    return {
        "mm": distance_mm(truth, X),
        "deg": angle_deg(truth, X),
        "worst_95_mm": record.uncertainty.worst_95_mm,
        "worst_mm": float(worst_mm),  # true error at the worst corner of the work volume
        "held_out_px": record.held_out_px if record.held_out_px is not None else float("nan"),
        "dropped": 1.0 if not spoilt else 1 - len(used & set(spoilt)) / len(spoilt),
        "lost": len(good - used) / len(good),
        "before_mm": found_off_mm(world, seed, nominal),
        "after_mm": found_off_mm(world, seed, X),
        "offsets": bool(record.joint_offsets and record.joint_offsets.adopted),
        "seconds": seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="JSON lines, written as it goes and read on resuming")
    parser.add_argument("--case", choices=list(CASES), default="noise")
    args = parser.parse_args()
    store = Kept(args.keep)
    rows = list[Row]()
    for seed in range(args.first, args.first + args.seeds):
        row = store.row(args.case, seed, partial(one, args.case, seed))
        rows.append(row)
        print(f"seed {seed}: {row_in_words(row)}", flush=True)
    p95 = {name: float(np.percentile([r[name] for r in rows], 95)) for name in ("mm", "deg", "held_out_px")}
    mean = {name: 100 * float(np.mean([r[name] for r in rows])) for name in ("dropped", "lost")}
    covered = 100 * float(np.mean([r["worst_mm"] <= r["worst_95_mm"] for r in rows]))
    before, after = (np.nanmean([r[name] for r in rows]) for name in ("before_mm", "after_mm"))
    print(f"\n{args.case}, {len(rows)} seeds")
    print(f"p95 {p95['mm']:.3f} mm, {p95['deg']:.4f}°, held out {p95['held_out_px']:.2f} px")
    print(f"stated error covers the true one in {covered:.0f} %")
    print(f"spoilt dropped {mean['dropped']:.0f} %, good lost {mean['lost']:.1f} %")
    print(f"object found {before:.2f} mm off before, {after:.2f} mm after")


def row_in_words(row: Row) -> str:
    adopted = "adopted" if row["offsets"] else "not adopted"
    return (
        "{mm:.3f} mm {deg:.4f}°, worst corner {worst_mm:.2f} mm, stated {worst_95_mm:.2f}, "
        "held out {held_out_px:.2f} px, spoilt dropped {dropped:.0%}, good lost {lost:.0%}, "
        "joint offsets {adopted}, object {before_mm:.2f} -> {after_mm:.2f} mm, {seconds:.0f} s"
    ).format(**row, adopted=adopted)


if __name__ == "__main__":
    main()
