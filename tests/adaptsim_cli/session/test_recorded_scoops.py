"""Recorded trials that carry their end in the tool, or their reward."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from adaptsim_cli.session.recorded.folder import read_recorded
from sim.errors import RecordingsRefused
from sim.tasks import get_task

SCOOPS = 'task = "scooping"\n\n[tables]\nstate = ["x", "y", "z"]\n'


def scoops(folder: Path, end: str, reward: str = "") -> Path:
    """Nine recorded scoops that ended on the blade, with these cells of their ends, as another lab would write them."""
    task = get_task("scooping")
    folder.mkdir()
    (folder / "recorded.toml").write_text(SCOOPS)
    names = [*task.context.names, *task.action.names]
    ends = "end_in_tool_x_m,end_in_tool_y_m,end_in_tool_z_m" if end else ""
    head = ",".join(filter(None, ["trial", "outcome", *names, ends, "reward" if reward else ""]))
    lines, samples = [head], ["trial,t_s,x,y,z"]
    rng = np.random.default_rng(0)
    for i in range(9):
        context, action = (
            task.context.spread(rng.random(len(task.context))),
            task.action.spread(rng.random(len(task.action))),
        )
        row = [f"{i}", "on_blade", *(f"{v!r}" for v in (*map(float, context), *map(float, action)))]
        lines.append(",".join([*row, *filter(None, [end, reward])]))
        samples += [
            f"{i},{t:.2f},{context[0] + (0.04 + 0.01 * i) * min(t, 1.0):.5f},{context[1]:.5f},0.01"
            for t in np.arange(0.0, 3.0, 0.1)
        ]
    (folder / "trials.csv").write_text("\n".join(lines) + "\n")
    (folder / "trajectories.csv").write_text("\n".join(samples) + "\n")
    return folder


def test_recorded_scoops_carry_their_end_in_the_tool_and_are_scored_by_it(tmp_path):
    task = get_task("scooping")
    found = read_recorded(task, scoops(tmp_path / "with", "-0.04,0.005,0.01"))
    assert all(np.array_equal(track.end_in_tool_m, [-0.04, 0.005, 0.01]) for track in found.tracks)
    assert all(
        np.isfinite(task.score(track, context)) for track, context in zip(found.tracks, found.contexts, strict=True)
    )


@pytest.mark.parametrize(
    ("end", "reward", "message"),
    [
        (
            "",
            "",
            r"trial 0: it ended on_blade, and its reward needs.*give end_in_tool_x_m, end_in_tool_y_m, end_in_tool_z",
        ),
        ("nan,0.0,0.0", "", "trial 0: end_in_tool_x_m = nan is not finite"),
        ("-0.04,,0.01", "", "trial 0: end_in_tool_y_m = '' is not a number"),
        ("-0.04,0.005,0.01", "0.01", "trial 0: its recorded reward is 0.010, and the task scores it"),
    ],
)
def test_scoops_without_a_finite_score_are_refused(tmp_path, end, reward, message):
    with pytest.raises(RecordingsRefused, match=message):
        read_recorded(get_task("scooping"), scoops(tmp_path / "without", end, reward))
