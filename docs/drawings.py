"""Draw the figures of the guide that show no screen: the rig with its distances, and the pedal with its wires.

    python docs/drawings.py

Every distance comes from the program; a test compares the committed drawings.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

from adaptsim_cli.bench.rig_file.description import PersonPart, TablePart
from sim.lab.kinect import default_X_BC
from sim.tasks import get_task

FIGURES = Path(__file__).parent / "figures"
RIG, PEDAL = "rig.svg", "pedal-wiring.svg"
REACH_M = 0.9
"""From the arm's axis to the farthest point that its flange reaches."""
INK, PALE, FOOD, BOTTLE, PERSON = "#2b2b2b", "#dcd8d0", "#2e7d55", "#0a6ebd", "#b34700"


def main() -> None:
    for name, draw in ((RIG, rig), (PEDAL, pedal)):
        print(f"Written: {write(FIGURES / name, draw)}")


def write(path: Path, draw: object) -> Path:
    """Draw into a file, with the same bytes every time."""
    assert callable(draw)
    with mpl.rc_context({"svg.hashsalt": "adaptsim", "font.size": 9, "svg.fonttype": "none"}):
        figure = draw()
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)
    return path


def rig() -> plt.Figure:
    """The table from above and from the side, in cm of the arm's base frame."""
    figure, (above, side) = plt.subplots(2, 1, figsize=(7.2, 8.2), height_ratios=(1.55, 1.0), layout="constrained")
    camera_m = default_X_BC()[:3, 3]
    _from_above(above, camera_m)
    _from_the_side(side, camera_m)
    above.set_xlabel("Y to the left of the arm's axis, cm")
    side.set_xlabel("X ahead of the arm's axis, cm")
    for axes in (above, side):
        axes.set_aspect("equal")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _from_above(axes: Axes, camera_m: np.ndarray) -> None:
    table, person = TablePart(), PersonPart("left")
    (x0, x1), (y0, y1) = 100 * np.array(table.x_m), 100 * np.array(table.y_m)
    axes.set_title("From above", loc="left")
    axes.add_patch(Rectangle((y0, x0), y1 - y0, x1 - x0, facecolor=PALE, edgecolor="none"))
    axes.text(y0 + 1, x1 - 1, f"table, free and smooth: {x0:.0f} to {x1:.0f} ahead,\n{y1:.0f} to each side", va="top")
    axes.add_patch(Circle((0, 0), 100 * REACH_M, fill=False, linestyle=":", edgecolor=INK))
    axes.text(-62, 66, f"reach {100 * REACH_M:.0f} + tool", rotation=42, ha="center", color=INK)
    axes.add_patch(Rectangle((-9.5, -14), 19, 21, facecolor=INK))
    axes.text(0, -17, "arm", ha="center", va="top")
    places = get_task("scooping").context
    _box(axes, 100 * places.low, 100 * places.high, FOOD, "near side of the piece")
    goals = get_task("pushing")
    assert goals.goal_m is not None
    ends = 100 * np.array([goals.goal_m(goals.context.denormalise(np.array(corner))) for corner in _corners(goals)])
    _box(axes, ends.min(axis=0), ends.max(axis=0), BOTTLE, "goals of a push")
    axes.plot(0, 56, "o", color=BOTTLE)
    axes.text(3, 56, "bottle, 56 ahead", color=BOTTLE, va="center")
    _camera(axes, (0.0, 100 * camera_m[0]), (0.0, -1.0), f"camera, {100 * camera_m[0]:.0f} ahead")
    axes.axvline(-100 * person.from_m, color=PERSON, linestyle="--")
    begins = f"{100 * person.from_m:.0f} from the axis begins\nthe person's side: arm and\ntool stay out of it"
    axes.text(-100 * person.from_m - 2, 4, begins, ha="right", color=PERSON)
    axes.set_xlim(-150, 98)
    axes.set_ylim(-32, 142)
    axes.set_ylabel("X ahead, cm")
    axes.set_xticks(range(-100, 101, 20), [f"{-value}" for value in range(-100, 101, 20)])


def _from_the_side(axes: Axes, camera_m: np.ndarray) -> None:
    (x0, x1), z = 100 * np.array(TablePart().x_m), 100 * camera_m[2]
    axes.set_title("From the right side", loc="left")
    axes.plot([-20, 130], [0, 0], color=INK)
    axes.text(-18, -3, "table within 5 of the height of the arm's foot", va="top")
    arm, tool = ((0, 0), (0, 33), (14, 63), (44, 58), (52, 50), (52, 30)), ((52, 30), (52, 22), (66, 8))
    axes.plot(*zip(*arm, strict=True), color=INK, linewidth=9, solid_capstyle="round", solid_joinstyle="round")
    axes.plot(*zip(*tool, strict=True), color=FOOD, linewidth=3)
    axes.text(68, 12, "tool", color=FOOD)
    ahead = default_X_BC()[:3, 2]
    down_deg = float(np.degrees(np.arcsin(-ahead[2])))
    _camera(
        axes, (100 * camera_m[0], z), (ahead[0], ahead[2]), f"camera, {z:.0f} above the table,\n{down_deg:.0f}° down"
    )
    way = z / -ahead[2]
    axes.plot([100 * camera_m[0], 100 * camera_m[0] + way * ahead[0]], [z, 0], color=INK, linestyle=":")
    axes.plot([x0, x1], [-12, -12], color=INK, marker="|")
    axes.text((x0 + x1) / 2, -13.5, f"work area {x0:.0f} to {x1:.0f}", ha="center", va="top")
    axes.set_xlim(-25, 165)
    axes.set_ylim(-24, 90)
    axes.set_ylabel("Z, cm")


def _corners(task: object) -> list[tuple[float, ...]]:
    n = len(task.context)  # type: ignore[attr-defined]
    return [tuple(corner) for corner in np.array(np.meshgrid(*[(0.0, 0.5, 1.0)] * n)).reshape(n, -1).T]


def _box(axes: Axes, low: np.ndarray, high: np.ndarray, colour: str, label: str) -> None:
    """A rectangle of places (x, y) in cm; X points up in the drawing, Y to the left."""
    corner, size = (-high[1], low[0]), (high[1] - low[1], high[0] - low[0])
    axes.add_patch(Rectangle(corner, *size, facecolor=colour, alpha=0.35, edgecolor=colour))
    axes.text(
        -low[1] + 2, (low[0] + high[0]) / 2, f"{label},\n{low[0]:g} to {high[0]:g} ahead", color=colour, va="center"
    )


def _camera(axes: Axes, at: tuple[float, float], ahead: tuple[float, float], label: str) -> None:
    direction = np.array(ahead) / np.linalg.norm(ahead)
    across = np.array([-direction[1], direction[0]])
    centre = np.array(at)
    body = [
        centre - 5 * across,
        centre + 5 * across,
        centre + 5 * across - 7 * direction,
        centre - 5 * across - 7 * direction,
    ]
    axes.add_patch(Polygon(body, facecolor=INK))
    axes.text(at[0] + 9, at[1] + 3, label, va="center")


def pedal() -> plt.Figure:
    """The foot switch, the board and the computer."""
    figure, axes = plt.subplots(figsize=(7.2, 2.6), layout="constrained")
    axes.axis("off")
    axes.set_xlim(0, 100)
    axes.set_ylim(0, 34)
    for x, width, label in (
        (2, 22, "foot switch\nnormally open"),
        (41, 26, "Arduino-class board"),
        (82, 17, "computer\n115200 baud, 8N1"),
    ):
        axes.add_patch(FancyBboxPatch((x, 5), width, 22, boxstyle="round,pad=0.4", facecolor=PALE, edgecolor=INK))
        axes.text(x + width / 2, 29, label, ha="center", va="bottom")
    for y, pin, colour in ((21, "pin 2 (INPUT_PULLUP)", BOTTLE), (11, "GND", INK)):
        axes.plot([13, 43], [y, y], color=colour, linewidth=2)
        axes.plot([13, 43], [y, y], "o", color=colour)
        axes.text(45, y, pin, va="center", color=colour)
    axes.plot([13, 13], [11, 14], color=INK, linewidth=2)
    axes.plot([13, 13], [18, 21], color=BOTTLE, linewidth=2)
    axes.plot([13, 17], [14, 18], color=INK, linewidth=2)
    axes.text(4, 7, "pressed: closed", fontsize=8)
    axes.plot([67, 82], [16, 16], color=INK, linewidth=4)
    axes.text(74.5, 18, "USB", ha="center")
    axes.text(74.5, 8, "a line\nevery 20 ms", ha="center", va="center", fontsize=8)
    return figure


if __name__ == "__main__":
    main()
