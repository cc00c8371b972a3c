"""docs/guide/ros2.md on bags of the ROS 2 writer: trials are read by its manifest, views are made by its program."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import real_views
from documents import ROOT, code_in, commands, read
from mcap_ros2.writer import Writer

from adaptsim_cli import api
from adaptsim_cli.commands import app
from adaptsim_cli.session.recorded.folder import read_recorded
from calib.files import read_folder
from calib.foreign.chains import any_arm
from hw.types import Array
from perception.types import ObjectTrack, Outcome
from sim.lab.rollout import rollout_in
from sim.research.benchmark.worlds import targets_of
from sim.tasks import get_task

PAGE = "docs/guide/ros2.md"
HEADER = "\n".join(("std_msgs/Header header", "{}", "=" * 80, "MSG: std_msgs/Header",
                    "builtin_interfaces/Time stamp\nstring frame_id", "=" * 80, "MSG: builtin_interfaces/Time",
                    "int32 sec\nuint32 nanosec", "{}"))  # fmt: skip
POSE = HEADER.format("geometry_msgs/Pose pose", "\n".join((
    "=" * 80, "MSG: geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation", "=" * 80,
    "MSG: geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z", "=" * 80, "MSG: geometry_msgs/Quaternion",
    "float64 x\nfloat64 y\nfloat64 z\nfloat64 w")))  # fmt: skip
IMAGE = HEADER.format("string format\nuint8[] data", "")
HEAD = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
(CODE,), (MANIFEST,) = code_in(PAGE, "python"), code_in(PAGE, "toml")


def posed(p_m: np.ndarray, xyzw: np.ndarray) -> dict[str, object]:
    position, orientation = dict(zip("xyz", p_m.tolist(), strict=True)), dict(zip("xyzw", xyzw.tolist(), strict=True))
    return {"header": HEAD, "pose": {"position": position, "orientation": orientation}}


def write_bags(folder: Path, actions: Array, tracks: Sequence[ObjectTrack]) -> None:
    folder.mkdir()
    (folder / "recorded.toml").write_text(MANIFEST)
    for i, (action, track) in enumerate(zip(actions, tracks, strict=True)):
        with (folder / f"push-{i:02d}.mcap").open("wb") as file:
            writer = Writer(file)
            command = writer.register_msgdef("std_msgs/msg/Float64MultiArray", "float64[] data\n")
            pose = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE)
            writer.write_message("/command", command, {"data": action.tolist()}, 10**12)
            for t_s, place_m in zip(track.t_s, track.state[:, :3], strict=True):
                place = posed(place_m, np.array([0.0, 0.0, 0.0, 1.0]))
                writer.write_message("/bottle", pose, place, 10**12 + round(1e9 * t_s))
            writer.finish()


def pushes(n: int) -> tuple[Array, list[ObjectTrack]]:
    """Random actions in a drawn world, and true rollouts of those under which the bottle stays upright."""
    task = get_task("pushing")
    (target,) = targets_of(task, ["drawn-2-0"])
    actions = task.action.sample(np.random.default_rng(0), n)
    tracks = [rollout_in(target.world, task.reference_context, action) for action in actions]
    upright = [track.outcome is Outcome.UPRIGHT for track in tracks]
    return actions[upright], [track for track, stands in zip(tracks, upright, strict=True) if stands]


def test_trials_are_read_by_the_manifest_of_the_page(tmp_path):
    actions, tracks = pushes(12)
    write_bags(tmp_path / "my-pushes", actions, tracks)
    found = read_recorded(get_task("pushing"), tmp_path / "my-pushes")
    assert np.allclose(found.actions, actions)
    for seen, track in zip(found.tracks, tracks, strict=True):
        assert seen.state == pytest.approx(track.state[:, :3], abs=1e-9)


@pytest.mark.long
def test_the_session_of_the_page_runs_on_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    actions, tracks = pushes(32)
    write_bags(tmp_path / "my-pushes", actions, tracks)
    (command,) = [line for line in commands(read(ROOT / PAGE)) if "run-iteration" in line]
    assert app.run(command.split()[1:]) == 0
    taken = [trial.action_array for trial in api.open_session("pushing-my-pushes").trials]
    assert len(taken) == 4
    assert all(np.abs(actions - action).max(axis=1).min() < 1e-12 for action in taken)


def bagged(place: Path) -> Path:
    """A folder of views in `place`, and the same views as bags in `board-views`, with an empty `my-views` for them."""
    made = real_views.picture_folder(place / "made")
    for folder in ("my-views", "board-views"):
        (place / folder).mkdir()
    (place / "my-views/setup.toml").write_text((made / "setup.toml").read_text())
    for file in made.glob("view-*.json"):
        view, name = json.loads(file.read_text()), file.stem.removeprefix("view-")
        with (place / f"board-views/{name}.mcap").open("wb") as stream:
            writer = Writer(stream)
            image = writer.register_msgdef("sensor_msgs/msg/CompressedImage", IMAGE)
            pose = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE)
            picture = list((made / view["image"]).read_bytes())
            writer.write_message(
                "/camera/color/image_raw/compressed", image, {"header": HEAD, "format": "jpeg", "data": picture}, 1
            )
            told = posed(np.array(view["position_m"]), np.array(view["quaternion_xyzw"]))
            writer.write_message("/franka_robot_state_broadcaster/current_pose", pose, told, 2)
            writer.finish()
    return made


def test_views_from_bags_are_the_pictures_and_poses_of_the_bags(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = bagged(tmp_path)
    exec(CODE, {})
    assert len(read_folder(Path("my-views"), any_arm).views) == real_views.POSTURES
    for file in made.glob("view-*.json"):
        view = json.loads(file.read_text())
        found = json.loads(Path("my-views", file.name).read_text())
        assert Path("my-views", found.pop("image")).read_bytes() == (made / view.pop("image")).read_bytes()
        assert found == view


@pytest.mark.long
def test_the_command_of_the_page_solves_such_views_as_those_they_came_from(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    made = bagged(tmp_path)
    exec(CODE, {})
    said = []
    for folder in (made.name, "my-views"):
        assert app.run(["calibrate", "solve", folder]) == 3, "one marker of unknown size: solved, and not good enough"
        said.append(capsys.readouterr().err.replace(f"/{folder}/", "/"))
    assert "not accepted: stated error" in said[0]
    assert said[0] == said[1]
