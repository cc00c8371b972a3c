"""The paper's additional studies, one command each: a table on the screen, and a figure.

    python benchmarks/study.py omega --figure docs/figures/study-omega.svg
    python benchmarks/study.py particles --seeds 10

omega           ranges that move away from the truth (Figure A3)
trajectories    one action, a world's path among simulated ones (A4)
particles       N from 1 to 4 against real trials (A5)
step            the adaptation step from .05 to .20 (A6)
goals           two goals, one bottle, what is inferred (A7)
reuse           reuse of task policies, with NAF in the loop (A2.2)

Finished rows and checkpoints stay in the folder: the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

from studies.shared import Asked

STUDIES = ("omega", "trajectories", "particles", "step", "goals", "reuse")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=STUDIES)
    parser.add_argument("--seeds", type=int, default=10, help="sessions of each case (default 10)")
    parser.add_argument("--trainings", type=int, default=1, help="training seeds of everything that is trained")
    parser.add_argument("--folder", type=Path, help="default: build/study-NAME")
    parser.add_argument("--figure", type=Path)
    asked = parser.parse_args()
    folder = asked.folder or Path("build") / f"study-{asked.name}"
    import_module(f"studies.{asked.name}").run(Asked(asked.name, asked.seeds, asked.trainings, folder, asked.figure))


if __name__ == "__main__":
    main()
