"""Make the picture at the head of README.md from two stored sessions: the end of every trial, with its reward.

    make demo && python docs/session_picture.py DEMO-udr DEMO

The first session is UDR's, one policy for all parameters; the second one's iterations stand below. Writes
docs/figures/session.jpg.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from adaptsim_cli import api
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore

PICTURE = Path(__file__).parent / "figures/session.jpg"
GOOD = 0.5
"""Rewards above are written in blue, below in orange; both are also numbers."""

Shown = Sequence[tuple[TrialRecord, Path]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("udr", help="name of a session of the method udr")
    parser.add_argument("session", help="name of a session of adaptsim in the same world")
    asked = parser.parse_args()
    rows = {"UDR: one policy\nfor all parameters": trials(asked.udr)}
    adapted = trials(asked.session)
    for n in sorted({trial.iteration for trial, _ in adapted}):
        when = "before any trial" if n == 1 else f"after {sum(t.iteration < n for t, _ in adapted)} trials"
        rows[f"adaptsim\n{when}"] = [(t, end) for t, end in adapted if t.iteration == n]
    draw(rows)
    print(f"Written: {PICTURE}")


def trials(session: str) -> Shown:
    """The trials of a session with the pictures of their ends."""
    opened = api.open_session(session)
    stored = SessionStore.open(opened.root, session)
    return [(trial, stored.trial_folder(*trial.position) / "moment-end.jpg") for trial in opened.trials]


def draw(rows: dict[str, Shown]) -> None:
    """One row of pictures for each entry."""
    width = max(map(len, rows.values()))
    figure, axes = plt.subplots(len(rows), width, figsize=(1.55 * width + 1.5, 1.8 * len(rows)), squeeze=False)
    for (name, shown), line in zip(rows.items(), axes, strict=True):
        line[0].text(-0.08, 0.5, name, transform=line[0].transAxes, ha="right", va="center", fontsize=9)
        for axis in line:
            axis.axis("off")
        for axis, (trial, end) in zip(line, shown, strict=False):
            picture(axis, trial, end)
    figure.subplots_adjust(
        left=1.5 / figure.get_figwidth(), right=0.995, top=0.94, bottom=0.01, wspace=0.04, hspace=0.2
    )
    figure.savefig(PICTURE, dpi=110, pil_kwargs={"quality": 85})


def picture(axis: Axes, trial: TrialRecord, end: Path) -> None:
    """The end of one trial."""
    image = cv2.imread(str(end))
    if image is None:
        raise SystemExit(f"{end} is not a picture")
    h, w = image.shape[:2]
    axis.imshow(image[h // 5 :, w // 10 : -w // 10, ::-1])
    colour = "#0a6ebd" if trial.reward > GOOD else "#b34700"
    axis.set_title(f"{trial.outcome_words} · {trial.reward:.2f}", fontsize=9, color=colour, pad=3)


if __name__ == "__main__":
    main()
