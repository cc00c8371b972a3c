"""How often is a tracked outcome wrong? Trials by arm, camera and recording of the simulated lab, in twelve conditions.

    python benchmarks/outcomes.py --out outcomes.jsonl [--worlds 4] [--camera kinect|small] [--tasks scooping pushing]

Each trial is a random action by the whole arm in a drawn world of its own, filmed by the lab's camera under one
condition (`sensing/conditions.py`), and tracked from its recording as in a session. OUT stores a line for each trial,
so that a stopped run can continue. `small` is a camera with a quarter of the resolution. Prints a row per condition:
trials, refused before the motion and after it (these are made again), outcomes that count, the wrong ones among them,
those of them that no flag doubts, and how far the place at the end is off, median / p95; then the sum, with the 95 %
interval (Clopper-Pearson) of the share that is wrong without a doubt. Nobody looks at the pictures here; in a session a
person confirms them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from kept import Kept
from scipy.stats import beta
from sensing.conditions import CONDITIONS
from sensing.drawing import LitWorld, draw_worlds
from sensing.filming import film
from sensing.judging import Judged, judged

from sim.tasks import get_task
from sim.tasks.task import Task


def trial_row(task: Task, lit: LitWorld) -> dict[str, Any]:
    """The trial of a world, filmed and judged."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / lit.name
        if refused := film(task, lit, place):
            return asdict(Judged(lit.name, "", "", refused, (), float("nan"), 0.0, lit.luminance))
        return asdict(judged(task, place))


def write_row(name: str, trials: list[Judged]) -> None:
    """A row of the table."""
    counted = [one for one in trials if not one.refused]
    wrong = [one for one in counted if one.is_wrong]
    sure = [one for one in wrong if not one.is_doubted]
    before = [one for one in trials if one.refused and np.isnan(one.found_mm)]
    ends = {end: sum(one.true == end for one in counted) for end in sorted({one.true for one in counted})}
    off_mm = np.array([one.end_mm for one in counted])
    places = f"{np.median(off_mm):.1f} / {np.percentile(off_mm, 95):.1f}" if counted else "-"
    truths = ", ".join(f"{count} {end}" for end, count in ends.items()) or "-"
    numbers = (len(trials), len(before), len(trials) - len(counted) - len(before), f"{len(counted)} ({truths})")
    cells = (name, *numbers, len(wrong), len(sure), places)
    sys.stdout.write(f"| {' | '.join(map(str, cells))} |\n")


def write_sum(trials: list[Judged]) -> None:
    """The share of counted trials that are wrong without a flag, and its interval."""
    counted = [one for one in trials if not one.refused]
    n, k = len(counted), sum(one.is_wrong and not one.is_doubted for one in counted)
    low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
    sys.stdout.write(f"{k} of {n} counted outcomes are wrong without a doubt: 95 % interval {low:.1%} to {high:.1%}\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--tasks", nargs="+", default=["scooping", "pushing"])
    parser.add_argument("--conditions", nargs="+", choices=list(CONDITIONS), default=list(CONDITIONS))
    parser.add_argument("--worlds", type=int, default=4, help="for each condition and task")
    parser.add_argument("--camera", choices=("kinect", "small"), default="kinect")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    store, done = Kept(args.out), dict[tuple[str, str], list[Judged]]()
    for number in range(args.worlds):
        for name in args.tasks:
            for condition in args.conditions:
                lit = draw_worlds(get_task(name), args.seed, args.worlds, condition, args.camera)[number]
                row = store.row(f"{args.camera} {lit.name}", args.seed, partial(trial_row, get_task(name), lit))
                one = Judged(**{**row, "flags": tuple(row["flags"])})
                done.setdefault((name, condition), []).append(one)
                if one.refused or one.is_wrong or one.is_doubted:
                    what = (
                        f"refused: {one.refused}"
                        if one.refused
                        else f"tracked as {one.tracked}: {'; '.join(one.flags)}"
                    )
                    sys.stdout.write(f"  {one.name}: {one.true or '-'}, {what}\n")
                    sys.stdout.flush()
    for (name, condition), trials in done.items():
        write_row(f"{name}, {condition}", trials)
    write_sum([one for trials in done.values() for one in trials])


if __name__ == "__main__":
    main()
