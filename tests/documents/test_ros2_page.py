"""docs/guide/ros2.md on bags of the ROS 2 writer: trials are read by its manifest, views are made by its program."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import real_views
from mcap_ros2.writer import Writer

from adaptsim_cli import app
from adaptsim_cli.wiring.recorded.folder import read_recorded
from sim.tasks import get_task

PAGE = (Path(__file__).parents[2] / "docs/guide/ros2.md").read_text(encoding="utf-8")
HEADER = "\n".join(("std_msgs/Header header", "{}", "=" * 80, "MSG: std_msgs/Header",
                    "builtin_interfaces/Time stamp\nstring frame_id", "=" * 80, "MSG: builtin_interfaces/Time",
                    "int32 sec\nuint32 nanosec", "{}"))  # fmt: skip
POSE = HEADER.format("geometry_msgs/Pose pose", "\n".join((
    "=" * 80, "MSG: geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation", "=" * 80,
    "MSG: geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z", "=" * 80, "MSG: geometry_msgs/Quaternion",
    "float64 x\nfloat64 y\nfloat64 z\nfloat64 w")))  # fmt: skip
IMAGE = HEADER.format("string format\nuint8[] data", "")
HEAD = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
(CODE,) = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
(MANIFEST,) = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def posed(p_m: np.ndarray, xyzw: np.ndarray) -> dict[str, object]:
    position, orientation = dict(zip("xyz", p_m.tolist(), strict=True)), dict(zip("xyzw", xyzw.tolist(), strict=True))
    return {"header": HEAD, "pose": {"position": position, "orientation": orientation}}


def test_trials_are_read_by_the_manifest_of_the_page(tmp_path: Path) -> None:
    task, rng = get_task("pushing"), np.random.default_rng(0)
    (tmp_path / "recorded.toml").write_text(MANIFEST)
    actions = task.action.sample(rng, 8)
    for i, action in enumerate(actions):
        with (tmp_path / f"push-{i:02d}.mcap").open("wb") as file:
            writer = Writer(file)
            command = writer.register_msgdef("std_msgs/msg/Float64MultiArray", "float64[] data\n")
            pose = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE)
            writer.write_message("/command", command, {"data": action.tolist()}, 10**12)
            for t_s in np.arange(0.0, 1.5, 0.05):
                place = posed(np.array([0.56 + 0.1 * t_s, 0.0, 0.05]), np.array([0.0, 0.0, 0.0, 1.0]))
                writer.write_message("/bottle", pose, place, 10**12 + round(1e9 * t_s))
            writer.finish()
    found = read_recorded(task, tmp_path)
    assert np.allclose(found.actions, actions)
    assert found.tracks[0].at(np.array([1.0]))[0] == pytest.approx([0.66, 0.0, 0.05])


def test_views_from_bags_calibrate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    made = real_views.picture_folder(tmp_path / "made")
    for folder in ("my-views", "board-views"):
        (tmp_path / folder).mkdir()
    (tmp_path / "my-views/setup.toml").write_text((made / "setup.toml").read_text())
    wanted = {}
    for file in sorted(made.glob("view-*.json")):
        view = json.loads(file.read_text())
        name = file.stem.removeprefix("view-")
        wanted[f"view-{name}.json"] = view["position_m"]
        with (tmp_path / f"board-views/{name}.mcap").open("wb") as stream:
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
    exec(CODE, {})
    found = {file.name: json.loads(file.read_text())["position_m"] for file in Path("my-views").glob("view-*.json")}
    assert found == wanted
    said = []
    for folder in ("made", "my-views"):
        assert app.run(["calibrate", "solve", folder]) == 3, "one marker of unknown size: solved, and not good enough"
        said.append(capsys.readouterr().err.replace(f"/{folder}/", "/"))
    assert "not accepted: stated error" in said[0]
    assert said[0] == said[1]
