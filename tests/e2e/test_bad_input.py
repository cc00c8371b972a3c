"""What an operator can get wrong with pushing and the pendulum: a clear message, an exit code, and nothing lost."""

from __future__ import annotations

import re
import subprocess

import pytest
from lab_session import ADAPTSIM, environment

from adaptsim_cli import app


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--task", "pushing", "--context", "goal_x=1.4"], "goal_x [m] = 1.4 lies outside of [0.7, 1]"),
        (["--task", "pushing", "--action", "speed=nan"], "speed [m/s] = nan lies outside of [0.4, 0.8]"),
        (["--task", "pushing", "--action", "sped=0.5"], "did you mean speed? write name=value, e.g. yaw=0"),
        (["--task", "pushing", "--action", "speed=fast"], "'fast' is not a number"),
        (["--task", "pushing", "--param", "y_p=0.2"], "y_p [m] = 0.2 lies outside of [-0.1, 0.1]"),
        (["--task", "pushing", "--world", "moon"], "no world 'moon' for pushing; there are half-full"),
        (["--task", "pendulum", "--hw", "fr3"], "pendulum runs in simulation only, so no arm can execute it"),
    ],
)
def test_a_wrong_word_is_a_usage_error(arguments, said, tmp_path, capfd):
    assert app.run(["rollout", *arguments, "--yes"]) == 2
    shown = capfd.readouterr()
    assert said in shown.err
    assert shown.err.count("Error:") == 1
    assert shown.out.strip() in ("", "Loading the task, the policies and the devices")
    assert not (tmp_path / "home" / "data" / "rollouts").exists()


def test_a_scoop_beyond_the_arm_is_refused_with_joint_value_and_limit(capfd):
    where = ["--context", "x=0.64", "--context", "y=-0.03"]
    how = ["--action", "pitch_rate=0.2", "--action", "pitch=0.1745", "--action", "distance=0.005"]
    assert app.run(["preview", "--task", "scooping", "--arm", "fr3", *where, *how, "--json"]) == 4
    shown = capfd.readouterr()
    assert re.search(r"fr3: no joint path keeps every limit .* joint \d at t = .* limit .* another action", shown.err)
    assert shown.out == ""


@pytest.mark.slow
def test_a_camera_that_was_moved_stops_the_whole_lab_before_the_arm_moves(tmp_path):
    world = tmp_path / "moved.toml"
    world.write_text(
        'task = "pushing"\ndescription = "a camera that was pushed aside"\n[params]\nmu = 0.1\ne = 1e5\nmu_p = 0.4\n'
        "y_p = 0.0\n[sensing]\nextrinsic_error_mm = 60.0\n"
    )
    command = [*ADAPTSIM, "run-iteration", "--task", "pushing", "--world", str(world), "--yes", "--json"]
    for _ in range(2):
        done = subprocess.run(
            command, env=environment(tmp_path / "home"), capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert done.returncode == 6, done.stderr
        assert done.stderr.count("Error:") == 1
        assert "Traceback" not in done.stderr
        assert done.stdout == ""
        assert not [p for p in (tmp_path / "home").rglob("trial-*") if p.is_dir()]
