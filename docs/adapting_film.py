"""Make the film at the head of README.md: the same goal before and after adapting, side by side.

    python docs/adapting_film.py FOLDER

Runs both sessions and one rollout of each in pushing's simulated lab, with all data in FOLDER (six minutes on two idle
cores), then writes docs/figures/adapting.webp. The world is one of the drawn ones; the goal was fixed first.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from adaptsim_cli import api
from adaptsim_cli.bench.rig import Image as Picture
from adaptsim_cli.session.film import write
from adaptsim_cli.session.store import SessionStore
from hw.poses import inverse
from hw.types import Array, CameraModel
from sim.lab.drawn import as_toml, drawn_world
from sim.tasks import get_task

FILM = Path(__file__).parent / "figures/adapting.webp"
SIDE_PX, STEP, FRAME_S, REST_S = 400, 2, 1 / 30, 1.5
"""Side of each picture, frames from one picture to the next, time of a frame, and how long the last picture stays."""
SEEN_M = ((0.42, -0.30), (1.02, 0.30))
"""Two corners of the shown part of the table, in the arm's base frame."""
MOST_BYTES = 300_000
TITLES = {"udr": "UDR: one policy for all", "adapted": "adapted, after 8 trials"}


WORLD, GOAL = (2, 36), ("goal_x=0.9", "goal_bearing=0.1")
"""Seed and number of the drawn world (drawn-2-36), and the goal."""
SESSIONS = {"udr": ["--method", "udr"], "adapted": ["--iterations", "2"]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder for the sessions")
    folder = parser.parse_args().folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    sides = [pictures(rolled_out(folder, name), title) for name, title in TITLES.items()]
    count = max(map(len, sides))
    both = [np.hstack([side[min(i, len(side) - 1)] for side in sides]) for i in range(count)]
    first, *others = map(Image.fromarray, both)
    durations = [int(1e3 * STEP * FRAME_S)] * (count - 1) + [int(1e3 * REST_S)]
    for quality in (70, 55, 40, 25):
        first.save(FILM, save_all=True, append_images=others, duration=durations, loop=0, quality=quality, method=6)
        if FILM.stat().st_size <= MOST_BYTES:
            break
    print(f"Written: {FILM}, {FILM.stat().st_size / 1e3:.0f} kB, {count} pictures")


def rolled_out(folder: Path, name: str) -> Path:
    """The folder of a rollout with the best policy of a session; both are run unless they exist."""
    task, shown = get_task("pushing"), folder / f"shown-{name}"
    world = folder / "drawn.toml"
    world.write_text(as_toml(task, drawn_world(task, *WORLD)), encoding="utf-8")
    environment = os.environ | {"ADAPTSIM_HOME": str(folder)} | ({"ADAPTSIM_PARTICLES": "1"} if name == "udr" else {})

    def run(*words: str) -> None:
        subprocess.run([sys.executable, "-m", "adaptsim_cli", *words, "--yes"], check=True, env=environment)

    if not shown.is_dir():
        lab = ["--task", task.name, "--world", str(world), "--seed", "0"]
        run("run-iteration", *lab, *SESSIONS[name], "--session", f"push-{name}")
        goal = [word for value in GOAL for word in ("--context", value)]
        run("rollout", "--session", f"push-{name}", "--best", *goal, "--seed", "0", "--out", str(shown))
    return shown


def pictures(folder: Path, title: str) -> list[Picture]:
    """(SIDE_PX, SIDE_PX, 3) RGB pictures of the first trial of a rollout, with the goal and at last the reward."""
    store = SessionStore.open(folder.parent, folder.name)
    (trial, *_) = store.trials(0)
    stored = api.read_recording(store.trial_folder(*trial.position) / "recording.mcap")
    shown = [
        picture(frame.colour, stored.model, stored.X_BC, np.array(trial.goal_m)) for frame in stored.frames[::STEP]
    ]
    for one in shown:
        write(one, title, (10, 24), 0.6)
    write(shown[-1], f"reward {trial.reward:.2f}", (10, SIDE_PX - 14), 0.7)
    return shown


def picture(colour: Picture, model: CameraModel, X_BC: Array, goal_m: Array) -> Picture:
    """The shown part of a frame, with a ring of 3 cm at the goal."""
    (x0, y0), (x1, y1) = SEEN_M
    corners = pixels(model, X_BC, np.array([(x, y, 0.0) for x in (x0, x1) for y in (y0, y1)]))
    middle, half = corners.mean(axis=0), np.ptp(corners, axis=0).max() / 2
    left, top = np.floor(middle - half).astype(int).clip(0)
    right, bottom = np.ceil(middle + half).astype(int)
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    ring = pixels(
        model, X_BC, np.column_stack([goal_m + 0.03 * np.column_stack([np.cos(turn), np.sin(turn)]), 0 * turn])
    )
    drawn = np.array(colour, np.uint8)
    cv2.polylines(drawn, [np.round(ring).astype(np.int32)], True, (230, 40, 40), 2, cv2.LINE_AA)
    cut = drawn[top:bottom, left:right]
    side = min(cut.shape[:2])
    return np.asarray(cv2.resize(cut[:side, :side], (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA), np.uint8)


def pixels(model: CameraModel, X_BC: Array, p_m: Array) -> Array:
    """(N, 3) in the base frame -> (N, 2) in the colour image."""
    X_CB, lens = inverse(X_BC), model.colour
    rotation, _ = cv2.Rodrigues(X_CB[:3, :3])
    projected, _ = cv2.projectPoints(p_m, rotation, X_CB[:3, 3], lens.K, lens.distortion)
    return np.asarray(projected.reshape(-1, 2), np.float64)


if __name__ == "__main__":
    main()
