"""The runs of the double pendulum from the public recordings: python -m swing.convert CHECKOUT FOLDER.

CHECKOUT is https://github.com/dfki-ric-underactuated-lab/double_pendulum at commit 1e8544e. The experiment uses every
second identification run of design C.1, in the order of their times, from the second one on.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

RUNS = "data/experiment_records/design_C.1/sys_id"


def convert(checkout: Path, folder: Path) -> Sequence[Path]:
    """Write one NPZ file per run, with the columns of its CSV file; the files. Raises ValueError without runs."""
    runs = sorted((checkout / RUNS).glob("*/*/trajectory.csv"))[1::2]
    if not runs:
        raise ValueError(f"{checkout / RUNS} has no runs: check out commit 1e8544e of double_pendulum")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for run in runs:
        names = run.read_text(encoding="utf-8").splitlines()[0].split(",")
        columns = np.loadtxt(run, delimiter=",", skiprows=1, dtype=np.float32, ndmin=2).T
        day, time = run.parts[-3:-1]
        written.append(folder / f"design_C.1__sys_id__{day}__{time}__trajectory.npz")
        np.savez_compressed(written[-1], allow_pickle=False, **dict(zip(names, columns, strict=True)))
    return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the runs of the double pendulum from the public recordings.")
    parser.add_argument("checkout", type=Path, help="checkout of double_pendulum")
    parser.add_argument("folder", type=Path, help="folder for the NPZ files")
    arguments = parser.parse_args()
    for path in convert(arguments.checkout, arguments.folder):
        print(f"Written: {path}")
