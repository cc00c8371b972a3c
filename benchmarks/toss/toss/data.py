"""The recorded tosses of ContactNets (`tosses.npz`) as actions and tracks of this task.

python -m toss.data TOSSES FOLDER writes them as a folder for `adaptsim run-iteration --task toss --recorded FOLDER`.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hw.types import Array
from sim.rollouts.recorded import RecordedTrials
from toss import ACTION, STATE, TASK, track_of

RATE_HZ = 148.0
_COLUMNS = 13  # quaternion w x y z, position, angular velocity (body), velocity (world)


@dataclass(frozen=True, eq=False)
class Tosses:
    """Recorded tosses."""

    trials: RecordedTrials  # named by the number of the file in the source
    rotations: tuple[Array, ...]  # (N, 4) quaternions x, y, z, w of each

    def some(self, rows: NDArray[np.int_]) -> Tosses:
        """Only these tosses."""
        return Tosses(self.trials.some(rows), tuple(self.rotations[i] for i in rows))


def read_tosses(path: Path) -> Tosses:
    """Read the file. Raises ValueError naming its defect."""
    try:
        with np.load(path, allow_pickle=False) as file:
            state, start, number = (np.asarray(file[key], dtype=np.float64) for key in ("state", "start", "number"))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not a file of tosses (arrays state, start, number): {error}") from error
    bounds = start.astype(int)
    if state.ndim != 2 or state.shape[1] != _COLUMNS or not np.isfinite(state).all():
        raise ValueError(f"{path}: state must be finite, (T, {_COLUMNS}), not {state.shape}")
    if len(bounds) != len(number) + 1 or (np.diff(bounds) < 2).any() or bounds[0] < 0 or bounds[-1] > len(state):
        raise ValueError(f"{path}: start must give the first row of each of the {len(number)} tosses, and the end")
    runs = [state[low:high] for low, high in itertools.pairwise(bounds)]
    rotations = tuple(run[:, [1, 2, 3, 0]] for run in runs)
    tracks = tuple(
        track_of(np.arange(len(run)) / RATE_HZ, run[:, 4:7], turned)
        for run, turned in zip(runs, rotations, strict=True)
    )
    names, actions = tuple(str(int(n)) for n in number), np.array([_action(run[0]) for run in runs])
    return Tosses(RecordedTrials(TASK, names, None, actions, tracks), rotations)


def _action(row: Array) -> Array:
    """A row of `state` -> rotation vector, position, angular velocity in the body frame, velocity."""
    return np.concatenate([Rotation.from_quat(row[[1, 2, 3, 0]]).as_rotvec(), row[4:7], row[7:10], row[10:13]])


def write_folder(tosses: RecordedTrials, folder: Path, every: int = 1) -> None:
    """Write the tosses in the format of `--recorded`, with every n-th sample and the last one."""
    folder.mkdir(parents=True, exist_ok=True)
    state = ", ".join(f'"{name}"' for name in STATE)
    (folder / "recorded.toml").write_text(f'task = "toss"\noutcome = "settled"\n\n[tables]\nstate = [{state}]\n')
    with (folder / "trials.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["trial", *ACTION.names])
        for name, action in zip(tosses.names, tosses.actions, strict=True):
            table.writerow([name, *(f"{value:.6g}" for value in action)])
    with (folder / "trajectories.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["trial", "t_s", *STATE])
        for name, track in zip(tosses.names, tosses.tracks, strict=True):
            last = len(track.t_s) - 1
            for i in sorted({*range(0, last, every), last}):
                table.writerow([name, f"{track.t_s[i]:.4f}", *(f"{value:.4f}" for value in track.state[i])])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write recorded tosses as a folder for --recorded.")
    parser.add_argument("tosses", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    write_folder(read_tosses(given.tosses).trials, given.folder)
