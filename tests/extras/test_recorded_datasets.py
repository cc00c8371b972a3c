"""Recorded trials from data sets of robot learning, written by pyarrow and h5py themselves: `make test-extra`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recordings import recordings

from adaptsim_cli.session.recorded.folder import read_recorded
from sim.errors import RecordingsRefused
from sim.tasks.pendulum import TASK

pytestmark = pytest.mark.extra

RATE_HZ = 100.0
ACTIONS, TRACKS = recordings(9)
STATES = [(np.arange(int(RATE_HZ * track.t_s[-1])) / RATE_HZ, track) for track in TRACKS]
ROWS = [(t_s, track.at(t_s)) for t_s, track in STATES]
LEROBOT = """
task = "pendulum"
outcome = "settled"

[lerobot]
state = ["observation.state[0]", "observation.state[1]", "observation.state[2]", "observation.state[3]", "excess"]

[lerobot.fields]
"""
ROBOMIMIC = """
task = "pendulum"
outcome = "settled"

[robomimic]
rate_hz = 100.0
state = ["obs/joints[0]", "obs/joints[1]", "obs/joints[2]", "obs/joints[3]", "obs/excess"]

[robomimic.fields]
"""


def lerobot(folder: Path) -> Path:
    import pyarrow  # noqa: PLC0415 - collected without the extra too
    from pyarrow import parquet  # noqa: PLC0415

    for i, ((t_s, state), action) in enumerate(zip(ROWS, ACTIONS, strict=True)):
        columns = {
            "episode_index": np.full(len(t_s), i),
            "timestamp": t_s,
            "observation.state": list(state[:, :4]),
            "excess": state[:, 4],
            "action": [action] * len(t_s),
        }
        file = folder / "data" / "chunk-000" / f"episode_{i:06d}.parquet"
        file.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pyarrow.table(columns), file)
    fields = "".join(f'{name} = "action[{i}]"\n' for i, name in enumerate(TASK.action.names))
    (folder / "recorded.toml").write_text(LEROBOT + fields)
    return folder


def robomimic(folder: Path) -> Path:
    import h5py  # noqa: PLC0415

    folder.mkdir()
    with h5py.File(folder / "demo.hdf5", "w") as file:
        for i, ((_, state), action) in enumerate(zip(ROWS, ACTIONS, strict=True)):
            demo = file.create_group(f"data/demo_{i}")
            demo["obs/joints"], demo["obs/excess"] = state[:, :4], state[:, 4]
            demo["actions"] = np.tile(action[1:], (len(state), 1))
            demo.attrs[TASK.action.names[0]] = action[0]
    rest = "".join(f'{name} = "actions[{i}]"\n' for i, name in enumerate(TASK.action.names[1:]))
    (folder / "recorded.toml").write_text(f'{ROBOMIMIC}{TASK.action.names[0]} = "attrs/{TASK.action.names[0]}"\n{rest}')
    return folder


@pytest.mark.parametrize("write", [lerobot, robomimic])
def test_episodes_are_trials(tmp_path, write):
    trials = read_recorded(TASK, write(tmp_path / "set"))
    assert np.array_equal(trials.actions, ACTIONS)
    for track, (t_s, state) in zip(trials.tracks, ROWS, strict=True):
        assert track.t_s == pytest.approx(t_s)
        assert np.array_equal(track.state, state)


@pytest.mark.parametrize(
    ("write", "old", "new", "message"),
    [
        (lerobot, '"excess"]', '"pictures"]', "no column 'pictures'"),
        (lerobot, '"excess"]', '"action"]', "has 8 numbers in each row: name one"),
        (lerobot, "state[3]", "state[9]", "is not a number in every row"),
        (robomimic, "obs/excess", "obs/gripper", "not a readable robomimic data set"),
        (robomimic, "joints[3]", "joints[9]", "is not a number in every row"),
        (robomimic, "joints[3]", "joints[]", "names no column"),
        (robomimic, "rate_hz = 100.0", "rate_hz = 0", "rate_hz"),
    ],
)
def test_a_wrong_name_is_named(tmp_path, write, old, new, message):
    folder = write(tmp_path / "set")
    text = (folder / "recorded.toml").read_text()
    assert old in text
    (folder / "recorded.toml").write_text(text.replace(old, new))
    with pytest.raises(RecordingsRefused, match=message.replace("[", r"\[")):
        read_recorded(TASK, folder)


def test_a_damaged_file_is_refused(tmp_path):
    folder = robomimic(tmp_path / "set")
    whole = (folder / "demo.hdf5").read_bytes()
    for content in (b"", whole[: len(whole) // 2], whole[:700] + bytes(200) + whole[900:]):
        (folder / "demo.hdf5").write_bytes(content)
        with pytest.raises(RecordingsRefused, match="not a readable robomimic data set"):
            read_recorded(TASK, folder)
