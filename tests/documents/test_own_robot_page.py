"""The two programs of docs/guide/own-robot.md that reach another computer: a file drop, and a ROS 2 node.

ROS 2 is no package of Python: its messages come from files here, by modules of the same names.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from documents import marked

from adaptsim_cli.screen.outputs.exchange import Question
from adaptsim_cli.session.own.reading import read_answer, track_of
from sim.tasks.pushing import TASK

REPORT = TASK.require_report()
QUESTION = Question(
    ask="trial", session="s", task="pushing", trial=3, attempt=1, context={"goal_x": 0.85, "goal_bearing": 0.0},
    action={"yaw": 0.1, "speed": 0.6}, goal_m=(0.85, 0.0), units={}, times_s=tuple(TASK.observation.times_s.tolist()),
    state=REPORT.columns, outcomes=REPORT.outcomes, success=REPORT.successes, needs=(),
)  # fmt: skip

RCLPY = """
import json, types
from pathlib import Path

FOLDER = Path(__file__).parent
NOW_S = 100.0


class Node:
    def create_subscription(self, kind, topic, take, depth):
        self.take = take

    def create_publisher(self, kind, topic, depth):
        sent = FOLDER / "sent.json"
        return types.SimpleNamespace(publish=lambda message: sent.write_text(json.dumps(message.data)))

    def get_clock(self):
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(nanoseconds=NOW_S * 1e9))


messages = iter(json.loads((FOLDER / "bottle.json").read_text()))
init = lambda: None
create_node = lambda name: Node()


def spin_once(node):
    t_s, x, y, z, w = next(messages)
    stamp = types.SimpleNamespace(sec=int(NOW_S + t_s), nanosec=round((NOW_S + t_s - int(NOW_S + t_s)) * 1e9))
    point, turn = types.SimpleNamespace(x=x, y=y, z=z), types.SimpleNamespace(w=w)
    pose = types.SimpleNamespace(position=point, orientation=turn)
    node.take(types.SimpleNamespace(header=types.SimpleNamespace(stamp=stamp), pose=pose))
"""


def written(name: str, folder: Path) -> Path:
    """A program of the page, in a file; thirty lines at most."""
    (code,) = [code for _, path, code in marked("guide/own-robot.md") if path == name]
    assert len([line for line in code.splitlines() if line.strip()]) <= 30
    (folder / name).write_text(code)
    return folder / name


def answered(*command: str, **more: Any) -> bytes:
    return subprocess.run(
        command, input=QUESTION.model_dump_json().encode(), capture_output=True, check=True, timeout=30, **more
    ).stdout


def test_a_file_drop_waits_for_the_other_computer(tmp_path: Path) -> None:
    drop = tmp_path / "drop"
    drop.mkdir()
    asked, answer = drop / "s-3-1-trial.question.json", drop / "s-3-1-trial.answer.json"

    def other_computer() -> None:
        while not asked.exists():
            threading.Event().wait(0.01)
        question = json.loads(asked.read_text())
        told = {"trial": question["trial"], "end": [0.8, 0.0, 0.035], "outcome": "upright"}
        (drop / "part").write_text(json.dumps(told))
        (drop / "part").rename(answer)

    thread = threading.Thread(target=other_computer)
    thread.start()
    output = answered(sys.executable, str(written("file_drop.py", tmp_path)), str(drop))
    thread.join()
    track = track_of(read_answer(output, QUESTION), QUESTION, TASK)
    assert track.state[-1].tolist() == [0.8, 0.0, 0.035]


@pytest.mark.parametrize(("w", "outcome"), [(1.0, "upright"), (0.7, "tipped")])
def test_a_ros_2_node_publishes_the_action_and_reports_the_poses(tmp_path: Path, w: float, outcome: str) -> None:
    (tmp_path / "rclpy.py").write_text(RCLPY)
    for package, names in (("geometry_msgs", "PoseStamped"), ("std_msgs", "Float64MultiArray")):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
        message = f"from types import SimpleNamespace\nclass {names}(SimpleNamespace): pass\n"
        (tmp_path / package / "msg.py").write_text(message)
    poses = [[0.05 * i, 0.56 + 0.01 * min(i, 20), 0.0, 0.035, w] for i in range(60)]
    (tmp_path / "bottle.json").write_text(json.dumps(poses))
    output = answered(sys.executable, str(written("ros_robot.py", tmp_path)), env={"PYTHONPATH": str(tmp_path)})
    assert json.loads((tmp_path / "sent.json").read_text()) == [0.1, 0.6]
    track = track_of(read_answer(output, QUESTION), QUESTION, TASK)
    assert track.outcome == outcome
    assert track.state[0].tolist() == [0.56, 0.0, 0.035]
    assert track.state[-1, 0] == pytest.approx(0.76)
