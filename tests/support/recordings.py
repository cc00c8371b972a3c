"""Recorded trials of the pendulum, written as another lab would: CSV tables, or MCAP by the ROS 2 writer of mcap."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from mcap_ros2.writer import Writer

from hw.types import Array
from perception.types import ObjectTrack
from sim.lab.rollout import rollout_in
from sim.lab.world import load_world
from sim.rollouts.draws import cover
from sim.tasks.pendulum import TASK
from sim.tasks.pendulum.solver import LqrSolver

STATE = ("q1", "q2", "v1", "v2", "excess")
"""The columns of the pendulum's track: angles in rad, their rates, and the excess of the cost."""

JOINTS = "std_msgs/Header header\nfloat64[] position\nfloat64[] velocity\nfloat64 excess\n" + "\n".join(
    (
        "=" * 80,
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
        "=" * 80,
        "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
    )
)
COMMAND, TEXT = "float64[] data\n", "string data\n"
LATE_S = 0.04

MANIFEST = """
task = "pendulum"

[mcap]
trajectory = "/joints"
state = ["position[0]", "position[1]", "velocity[0]", "velocity[1]", "excess"]
clock = "header"
late_s = 0.04
start = "/command"

[mcap.fields]
outcome = "/verdict:data"
""" + "".join(f'{name} = "/command:data[{i}]"\n' for i, name in enumerate(TASK.action.names))
"""Of MCAP files."""


def recordings(n: int, world: str = "wd", seed: int = 0) -> tuple[Array, list[ObjectTrack]]:
    """Feedback gains (n, 8) for guesses all over the ranges, and their trials in a world."""
    guesses = cover(TASK.parameters, n, np.random.default_rng(seed))
    policies = LqrSolver(TASK).policies(guesses[:, None], np.random.default_rng(0))
    target = load_world(world, TASK)
    actions = np.stack([policy.gain for policy in policies])
    return actions, [rollout_in(target, np.zeros(0), action) for action in actions]


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


def stamp(t_s: float) -> dict[str, int]:
    ns = round(1e9 * t_s)
    return {"sec": ns // 10**9, "nanosec": ns % 10**9}


def write_mcap(folder: Path, n: int = 24) -> Path:
    """Trials that began at 1000 s, whose joints were stamped 40 ms late; every file also holds what nobody asks for."""
    folder.mkdir()
    (folder / "recorded.toml").write_text(MANIFEST)
    for i, (action, track) in enumerate(zip(*recordings(n), strict=True)):
        with (folder / f"swing-{i:02d}.mcap").open("wb") as file:
            writer = Writer(file)
            text = writer.register_msgdef("std_msgs/msg/String", TEXT)
            command = writer.register_msgdef(
                "lab_msgs/msg/Command", f"std_msgs/Header header\n{COMMAND}{JOINTS[JOINTS.index('=') :]}"
            )
            joints = writer.register_msgdef("lab_msgs/msg/Joints", JOINTS)
            writer.write_message("/chatter", text, {"data": "hello"}, 999 * 10**9)
            writer.write_message("/verdict", text, {"data": track.outcome.value}, 1000 * 10**9)
            head = {"stamp": stamp(1000.0), "frame_id": ""}
            writer.write_message("/command", command, {"header": head, "data": list(action)}, 1000 * 10**9)
            for t_s, state in zip(track.t_s, track.state, strict=True):
                at_s = 1000.0 + float(t_s) + LATE_S
                message = {
                    "header": {"stamp": stamp(at_s), "frame_id": "base"},
                    "position": list(state[:2]),
                    "velocity": list(state[2:4]),
                    "excess": float(state[4]),
                }
                writer.write_message("/joints", joints, message, round(1e9 * (at_s + 0.3)))
            writer.finish()
    return folder
