"""How often is a tracked outcome wrong? Drawn worlds of colour, light and noise, through arm, camera and recording.

    python benchmarks/outcomes.py --folder FOLDER [--worlds 40] [--trials N] [--seed S] [--film-only]

Films are kept in FOLDER (50 MB each) and are not made again; a run that was stopped continues. Prints a row per task:
trials, refused before the motion and after it (these are made again), outcomes that count, the wrong ones among them,
those of them that no flag doubts, and how far the place at the end is off, median / p95. A piece has any hue and a
luminance from 0.004 to 0.7; the light changes by a factor of seven, its colour by 17 % each way, half of the rooms
flicker or have sun; the depth noise is 0.5 to 8 times that of a Kinect; half of the cameras lose up to 40 % of frames.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from sensing.drawing import draw_worlds
from sensing.filming import film
from sensing.judging import Judged, judged

from sim.tasks import get_task


def tell(name: str, trials: list[Judged]) -> None:
    """A line for each trial that is refused, wrong or doubted, and the row of the table."""
    for one in trials:
        if one.refused or one.is_wrong or one.is_doubted:
            what = f"refused: {one.refused}" if one.refused else f"tracked as {one.tracked}; {'; '.join(one.flags)}"
            print(f"  {one.name}: {one.true}, {what}")
    counted = [one for one in trials if not one.refused]
    wrong = [one for one in counted if one.is_wrong]
    sure = [one for one in wrong if not one.is_doubted]
    before = [one for one in trials if one.refused and np.isnan(one.found_mm)]
    ends = {end: sum(one.true == end for one in counted) for end in sorted({one.true for one in trials})}
    off_mm = np.array([one.end_mm for one in counted])
    print(
        f"| {name} | {len(trials)} | {len(before)} | {len(trials) - len(counted) - len(before)} | {len(counted)} "
        f"({', '.join(f'{count} {end}' for end, count in ends.items())}) | {len(wrong)} | {len(sure)} "
        f"({len(sure) / max(len(counted), 1):.1%}) | {np.median(off_mm):.1f} / {np.percentile(off_mm, 95):.1f} mm |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--tasks", nargs="+", default=["scooping", "pushing"])
    parser.add_argument("--worlds", type=int, default=40)
    parser.add_argument("--trials", type=int, default=1, help="in each world")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--film-only", action="store_true")
    args = parser.parse_args()
    for name in args.tasks:
        task = get_task(name)
        worlds = draw_worlds(task, args.seed, args.worlds)
        for trials in range(1, 1 + args.trials):
            for lit in worlds:
                for folder in film(task, lit, args.seed, trials, args.folder):
                    print(folder.name, flush=True)
        if not args.film_only:
            folders = [f for lit in worlds for f in film(task, lit, args.seed, args.trials, args.folder)]
            tell(name, [judged(task, folder) for folder in folders])


if __name__ == "__main__":
    main()
