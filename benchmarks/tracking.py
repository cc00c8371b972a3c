"""How well the object is tracked against the truth of the simulated lab.

    python benchmarks/tracking.py [--task scooping|pushing] [--trials N] [--sweeps N] [--seed S]
    python benchmarks/tracking.py --worlds raisin carrot cucumber sprout mushroom-slice oreo --trials 20 --sweeps 0

Prints XY errors in mm, once with the camera's true pose and once with a nominal calibration, and the cost of one
frame on one core. Scooping: scoops by the whole arm in `--worlds` (calibration off by 1 mm, 0.1 degrees), then
errors over the share of the piece that the tool hides (`--sweeps`). Pushing: pushes by the whole arm in `wd` and
`ood-2` (calibration off by 2 mm, 0.2 degrees), then with a hand that passes through the picture.
"""

from __future__ import annotations

import argparse

from tracked import pushing, scooping


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=("scooping", "pushing"), default="scooping")
    parser.add_argument("--trials", type=int, default=None, help="by the arm; default 12 scoops, 24 pushes")
    parser.add_argument("--sweeps", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--worlds", nargs="+", default=["wd"], help="of scooping; default wd")
    args = parser.parse_args()
    if args.task == "scooping":
        scooping.run(12 if args.trials is None else args.trials, args.sweeps, args.seed, args.worlds)
    else:
        pushing.run(24 if args.trials is None else args.trials, args.seed)


if __name__ == "__main__":
    main()
