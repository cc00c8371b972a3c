"""Make the film at the head of README.md: the same goal before and after adapting, side by side.

    python docs/adapting_film.py BEFORE AFTER

Each argument is the folder of a rollout in pushing's simulated lab (`adaptsim rollout --session NAME --best`), with the
same context. Writes docs/figures/adapting.webp.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from adaptsim_cli import api
from adaptsim_cli.session.film import write
from adaptsim_cli.session.store import SessionStore
from hw.poses import inverse
from hw.types import Array, CameraModel

FILM = Path(__file__).parent / "figures/adapting.webp"
SIDE_PX, STEP, FRAME_S, REST_S = 400, 2, 1 / 30, 1.5
"""Side of each picture, frames from one picture to the next, time of a frame, and how long the last picture stays."""
SEEN_M = ((0.42, -0.30), (1.02, 0.30))
"""Two corners of the shown part of the table, in the arm's base frame."""
MOST_BYTES = 300_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="folder of a rollout with UDR's policy")
    parser.add_argument("after", type=Path, help="folder of a rollout with the adapted policy")
    asked = parser.parse_args()
    sides = [pictures(asked.before, "UDR: one policy for all"), pictures(asked.after, "adapted")]
    count = max(map(len, sides))
    both = [np.hstack([side[min(i, len(side) - 1)] for side in sides]) for i in range(count)]
    first, *others = map(Image.fromarray, both)
    durations = [int(1e3 * STEP * FRAME_S)] * (count - 1) + [int(1e3 * REST_S)]
    for quality in (70, 55, 40, 25):
        first.save(FILM, save_all=True, append_images=others, duration=durations, loop=0, quality=quality, method=6)
        if FILM.stat().st_size <= MOST_BYTES:
            break
    print(f"Written: {FILM}, {FILM.stat().st_size / 1e3:.0f} kB, {count} pictures")


def pictures(folder: Path, title: str) -> list[Array]:
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


def picture(colour: Array, model: CameraModel, X_BC: Array, goal_m: Array) -> Array:
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
    drawn = np.array(colour)
    cv2.polylines(drawn, [np.round(ring).astype(np.int32)], True, (230, 40, 40), 2, cv2.LINE_AA)
    cut = drawn[top:bottom, left:right]
    side = min(cut.shape[:2])
    return cv2.resize(cut[:side, :side], (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)


def pixels(model: CameraModel, X_BC: Array, p_m: Array) -> Array:
    """(N, 3) in the base frame -> (N, 2) in the colour image."""
    X_CB, lens = inverse(X_BC), model.colour
    rotation, _ = cv2.Rodrigues(X_CB[:3, :3])
    return cv2.projectPoints(p_m, rotation, X_CB[:3, 3], lens.K, lens.distortion)[0].reshape(-1, 2)


if __name__ == "__main__":
    main()
