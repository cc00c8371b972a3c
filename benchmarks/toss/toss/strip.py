"""A film strip: recorded tosses above the same tosses in the simulator, before and after a session."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation, Slerp

from hw.types import Array
from toss.data import RATE_HZ, Tosses
from toss.physics import EDGE_M, Flight, Table

TIMES_S = (0.0, 0.1, 0.2, 0.3, 0.45, 0.8)
COLOURS = ("#d1495b", "#edae49", "#30638e", "#00798c", "#8d6a9f", "#6a994e")
"""Of the faces +x, -x, +y, -y, +z, -z."""

_SIGHT = Rotation.from_euler("ZX", [25.0, -62.0], degrees=True)  # from the table's frame to the picture's
_REACH_M = 0.36


def draw(tosses: Tosses, rows: Sequence[int], settings: Sequence[tuple[str, Array]], path: Path) -> None:
    """Write the strip of these tosses: recorded, then simulated with each of the named parameters (p,)."""
    mpl.rcParams["svg.hashsalt"] = "adaptsim"
    lines = [(number, name, motion) for number in rows for name, motion in _motions(tosses, number, settings)]
    figure = Figure(figsize=(1.25 * len(TIMES_S) + 0.9, 0.98 * len(lines)))
    grid = figure.subplots(len(lines), len(TIMES_S), squeeze=False)
    for i, (number, name, motion) in enumerate(lines):
        real = next(motion for n, label, motion in lines if n == number and label == "recorded")
        goal, _ = at(real, TIMES_S[-1])
        for axes, t_s in zip(grid[i], TIMES_S, strict=True):
            _panel(axes, *at(motion, t_s), goal)
            if i == 0:
                axes.set_title(f"{t_s:g} s", fontsize=8)
        grid[i, 0].set_ylabel(name, fontsize=8, rotation=0, ha="right", va="center")
        if i and name == "recorded":
            grid[i, 0].annotate("", (0, 1.04), (6.6, 1.04), "axes fraction", arrowprops={"arrowstyle": "-", "lw": 0.6})
    figure.subplots_adjust(0.13, 0.01, 0.995, 0.96, 0.03, 0.05)
    figure.savefig(path, dpi=110, pil_kwargs={"quality": 85})


def _motions(tosses: Tosses, number: int, settings: Sequence[tuple[str, Array]]) -> list[tuple[str, Flight]]:
    track, rotation = tosses.trials.tracks[number], tosses.rotations[number]
    found = [("recorded", Flight(np.arange(len(rotation)) / RATE_HZ, np.asarray(track.state[:, :3]), rotation))]
    for name, parameters in settings:
        found.append((name, Table(*map(float, parameters)).toss(np.array(tosses.trials.actions[number]))))
    return found


def at(motion: Flight, t_s: float) -> tuple[Array, Rotation]:
    """Place and rotation; held beyond the end."""
    t = float(np.clip(t_s, motion.t_s[0], motion.t_s[-1]))
    place = np.array([np.interp(t, motion.t_s, column) for column in motion.position_m.T])
    return place, Slerp(motion.t_s, Rotation.from_quat(motion.rotation))(t)


def _panel(axes: Axes, place: Array, rotation: Rotation, goal: Array) -> None:
    """One cube; a cross marks where the recorded one comes to rest."""
    axes.set_xlim(-_REACH_M, _REACH_M)
    axes.set_ylim(-0.2, 0.34)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor("#f2f0ea")
    for spine in axes.spines.values():
        spine.set_visible(False)
    shadow = EDGE_M / 2 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    below = np.array([place[0], place[1], 0.0])
    axes.fill(*_seen(shadow + below).T[:2], color="#d8d4c8", lw=0)
    axes.plot(*_seen(np.array([[goal[0], goal[1], 0.0]])).T[:2], "x", color="#333333", ms=4, mew=0.8)
    faces = []
    for axis, sign in itertools.product(range(3), (1.0, -1.0)):
        others = [a for a in range(3) if a != axis]
        corners = np.zeros((4, 3))
        corners[:, axis] = sign
        corners[:, others[0]], corners[:, others[1]] = (-1, 1, 1, -1), (-1, -1, 1, 1)
        faces.append((2 * axis + (sign < 0.0), _seen(rotation.apply(EDGE_M / 2 * corners) + place)))
    for face, corners in sorted(faces, key=lambda pair: float(pair[1][:, 2].mean())):
        axes.fill(*corners.T[:2], color=COLOURS[face], ec="#222222", lw=0.4)


def _seen(points_m: Array) -> Array:
    """(N, 3) -> right, up and towards the eye."""
    return np.asarray(_SIGHT.apply(points_m))
