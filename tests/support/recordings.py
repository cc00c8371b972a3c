"""Recorded trials of the pendulum, written as another lab would: tables, or MCAP files by the ROS 2 writer."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from hw.types import Array
from perception.types import ObjectTrack
from sim.lab.world import load_world, rollouts_in
from sim.rollouts.draws import cover
from sim.tasks.pendulum import TASK
from sim.tasks.pendulum.solver import LqrSolver

STATE = ("q1", "q2", "v1", "v2", "excess")
"""The columns of the pendulum's track: angles in rad, their rates, and the excess of the cost."""


def recordings(n: int, world: str = "wd", seed: int = 0) -> tuple[Array, list[ObjectTrack]]:
    """Feedback gains (n, 8) for guesses all over the ranges, and their trials in a world."""
    guesses = cover(TASK.parameters, n, np.random.default_rng(seed))
    policies = LqrSolver(TASK).policies(guesses[:, None], np.random.default_rng(0))
    there, target = rollouts_in(load_world(world, TASK)), load_world(world, TASK)
    actions = np.stack([policy.gain for policy in policies])
    return actions, [there(target.parameters, np.zeros(0), action, target.nuisance) for action in actions]


def write_tables(folder: Path, n: int = 24, manifest: str = "", **changes: str) -> Path:
    """A folder with `recorded.toml`, `trials.csv` and `trajectories.csv`."""
    folder.mkdir(parents=True, exist_ok=True)
    actions, tracks = recordings(n)
    text = manifest or 'task = "pendulum"\n\n[tables]\nstate = ["q1", "q2", "v1", "v2", "excess"]\n'
    (folder / "recorded.toml").write_text(text)
    with (folder / "trials.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["trial", "outcome", "operator", *TASK.action.names])
        for i, (action, track) in enumerate(zip(actions, tracks, strict=True)):
            table.writerow([f"run{i}", track.outcome.value, "Ada", *map(repr, map(float, action))])
    with (folder / "trajectories.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["trial", "t_s", *STATE])
        for i, track in enumerate(tracks):
            for t_s, state in zip(track.t_s, track.state, strict=True):
                table.writerow([f"run{i}", *map(repr, map(float, (t_s, *state)))])
    for name, content in changes.items():
        (folder / name.replace("_csv", ".csv")).write_text(content)
    return folder
