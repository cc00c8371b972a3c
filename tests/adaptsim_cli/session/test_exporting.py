from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from pages import files
from toy_session import NAME

from adaptsim_cli.commands import app
from adaptsim_cli.session import exporting, formats, motion_table, recording, replaying, topics
from adaptsim_cli.session.best_scene import scene_files
from hw.quantities import QUANTITIES


def messages(file: Path) -> dict[str, list[bytes]]:
    found: dict[str, list[bytes]] = {}
    with file.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            found.setdefault(channel.topic, []).append(message.data)
    return found


@pytest.fixture(scope="module")
def exported(undisturbed, tmp_path_factory) -> tuple[Path, ...]:
    """A file for each trial, and the layout that shows them."""
    return tuple(formats.export(undisturbed, "mcap", tmp_path_factory.mktemp("exported") / "mcap", scene_files))


def test_one_file_holds_everything_of_a_trial(store, exported):
    *files, layout = exported
    assert len(files) == len(store.trials(0))
    found, record = messages(files[0]), store.trials(0)[0]
    assert set(found) >= {*recording.TOPICS, *topics.AFTERWARDS} - {"/after/colour", "/after/depth"}
    assert len(found["/object"]) == len(record.track.t_s)
    assert json.loads(topics.decode("std_msgs/msg/String", found["/outcome"][0]).data)["reward"] == record.reward
    assert any(b"outcome: " in line for line in found["/events"])
    assert b"<robot" in found["/robot_description"][0]
    with files[0].open("rb") as stream:
        (about,) = list(make_reader(stream).iter_metadata())
    assert (about.metadata["session"], about.metadata["trial"]) == (NAME, "1")
    stored = replaying.open_trial(store, record).stored
    configured = json.loads(layout.read_text())["configById"]
    shown = {
        configured[key]["imageMode"][which]
        for key in configured
        if "Image!" in key
        for which in ("imageTopic", "calibrationTopic")
    }
    assert shown | set(configured["3D!scene"]["topics"]) <= set(found)
    depth = topics.decode(topics.DEPTH, found["/camera/depth"][0])
    assert depth.encoding == "16UC1"
    pixels = np.frombuffer(depth.data, "<u2").reshape(depth.height, depth.width)
    assert np.array_equal(pixels, stored.frames[0].depth_mm)


def test_every_channel_has_a_standard_schema_and_every_frame_its_transform(exported):
    file, *_ = exported
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    schemas = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
    assert schemas == {**recording.TOPICS, **topics.AFTERWARDS}
    found = messages(file)
    transforms = b"".join(found["/tf"])
    for frame in ("base", "tool", "camera_colour", "camera_depth", *topics.FRAMES):
        assert frame.encode() + b"\0" in transforms, frame
    for topic, holds in (("/joints/measured", (7, 7, 0)), ("/joints/commanded", (7, 7, 0))):
        state = topics.decode(topics.JOINTS, found[topic][0])
        assert state.name[0] == "panda_joint1"
        assert (len(state.position), len(state.velocity), len(state.effort)) == holds


def test_joints_have_the_velocity_and_torque_of_their_motion():
    t_s = np.arange(0.0, 2.0, 1e-3)
    q = np.tile([0.0, -0.5, 0.0, -2.0, 0.0, 1.8, 0.7], (len(t_s), 1))
    q[:, 0] += 0.3 * np.sin(2.0 * t_s)
    speed = topics.derivative(t_s, q, 1)
    assert np.abs(speed[50:-50, 0] - 0.6 * np.cos(2.0 * t_s[50:-50])).max() < 1e-3
    assert np.abs(speed[:, 1:]).max() < 1e-9
    assert topics.derivative(t_s[:3], q[:3], 1).tolist() == np.zeros((3, 7)).tolist()


def test_every_column_of_a_table_has_its_meaning_in_the_reference(store):
    quantities = ("parameter_", "context_", "action_")
    plain = [column for column in exporting.rows(store)[0] if not column.startswith(quantities)]
    assert plain == [*files.COLUMNS, "duration_s"]


def test_a_table_has_a_row_for_each_trial(store):
    assert app.run(["sessions", "export", NAME]) == 0
    rows = list(csv.DictReader(Path(f"{NAME}.csv").read_text().splitlines()))
    assert [float(row["reward"]) for row in rows] == [trial.reward for trial in store.trials(0)]


def test_a_replay_is_a_video_with_every_frame(store, tmp_path, capfd):
    assert app.run(["replay", NAME, "2", "--out", str(tmp_path / "v.webm")]) == 0
    assert capfd.readouterr().err == "", "no library speaks on the terminal"
    trial = replaying.open_trial(store, store.trials(0)[1])
    video = cv2.VideoCapture(str(tmp_path / "v.webm"))
    frames = 0
    while video.read()[0]:
        frames += 1
    assert frames == len(trial.stored.frames)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sessions", "export", NAME, "--format", "xls"], "csv, parquet, mcap, lerobot, rerun, sdf, ranges, mjcf"),
        (["replay", NAME, "99"], "trial 99 of"),
    ],
)
def test_what_cannot_be_exported_is_refused(store, arguments, message, refused):
    assert message in refused(2, *arguments)


def test_a_motion_is_a_row_for_each_cycle_with_everything_that_the_arm_measured(store):
    trial = replaying.open_trial(store, store.trials(0)[0])
    played = trial.stored.execution
    assert played.measured == {}, "the simulated lab measures no torque"
    (first, *rows) = csv.reader(motion_table.as_table(trial).decode().splitlines())
    assert first == ["t_s", *(f"q_{kind}_{n}_rad" for kind in ("commanded", "measured") for n in range(1, 8))]
    assert np.array_equal(np.array(rows, dtype=float)[:, 8:], played.q_measured_rad)
    values = {q.name: np.arange(len(played.t_s) * q.size, dtype=float).reshape(-1, q.size) for q in QUANTITIES}
    whole = replace(trial, stored=replace(trial.stored, execution=replace(played, measured=values)))
    (first, *rows) = csv.reader(motion_table.as_table(whole).decode().splitlines())
    assert first[15:] == [label for q in QUANTITIES for label in q.labels]
    assert {"joint_torque_7_Nm", "external_torque_1_Nm", "external_force_z_N", "external_torque_z_Nm"} <= set(first)
    assert np.array_equal(np.array(rows, dtype=float)[:, 15:22], values["joint_torque_Nm"])


def test_the_exported_file_has_the_quantities_on_their_topics(store, tmp_path):
    trial = replaying.open_trial(store, store.trials(0)[0])
    played = trial.stored.execution
    values = {q.name: np.full((len(played.t_s), q.size), 0.5) for q in QUANTITIES}
    whole = replace(trial, stored=replace(trial.stored, execution=replace(played, measured=values)))
    (file := tmp_path / "whole.mcap").write_bytes(replaying.encode(whole))
    found = messages(file)
    assert list(topics.decode(topics.JOINTS, found["/joints/measured"][0]).effort) == [0.5] * 7
    assert list(topics.decode(topics.JOINTS, found["/joints/external"][0]).effort) == [0.5] * 7
    assert topics.decode(topics.WRENCH, found["/wrench/external"][0]).wrench.torque.z == 0.5
    assert all(q.meaning == whole.metadata()[q.name] for q in QUANTITIES)
