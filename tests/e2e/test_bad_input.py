"""What an operator can get wrong with pushing and the pendulum: a clear message, an exit code, and nothing lost."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bottle_bench import MARK, BottleBench, Scene
from lab_session import environment

from adaptsim_cli import app
from adaptsim_cli.wiring import session as wiring
from hw.collision import KeepOut

SESSION = ["run-iteration", "--task", "pushing", "--session", "s", "--yes", "--json"]
ROLLOUT = ["rollout", "--task", "pushing", "--yes"]
Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith("ADAPTSIM_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch) -> Callable[[BottleBench], BottleBench]:
    def use(bench: BottleBench) -> BottleBench:
        monkeypatch.setattr(wiring, "open_parts", bench.open_parts)
        return bench

    return use


def trials(home_folder: Path) -> list[str]:
    """Folders of trials of the session, whole ones and rejected ones."""
    return sorted(p.name for p in home_folder.glob("home/data/sessions/s/iteration-01/trial-*") if p.is_dir())


# What was typed ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--task", "pushing", "--context", "goal_x=1.4"], "goal_x [m] = 1.4 lies outside of [0.7, 1]"),
        (["--task", "pushing", "--context", "goal_bearing=12"], "goal_bearing [rad] = 12 lies outside of [-0.1745"),
        (["--task", "pushing", "--action", "speed=1.5"], "speed [m/s] = 1.5 lies outside of [0.4, 0.8]"),
        (["--task", "pushing", "--action", "speed=nan"], "speed [m/s] = nan lies outside of [0.4, 0.8]"),
        (["--task", "pushing", "--action", "sped=0.5"], "did you mean speed? write name=value, e.g. yaw=0"),
        (["--task", "pushing", "--action", "speed=fast"], "'fast' is not a number"),
        (["--task", "pushing", "--param", "y_p=0.2"], "y_p [m] = 0.2 lies outside of [-0.1, 0.1]"),
        (["--task", "pushing", "--world", "moon"], "no world 'moon' for pushing; there are half-full"),
        (["--task", "pendulum", "--action", "k11=1000"], "k11 [N m/rad] = 1000 lies outside of [0, 160]"),
        (["--task", "pendulum", "--hw", "fr3"], "pendulum runs in simulation only, so no arm can execute it"),
    ],
)
def test_a_wrong_word_is_a_usage_error(arguments: list[str], said: str, tmp_path: Path, capfd: Capture) -> None:
    assert app.run(["rollout", *arguments, "--yes"]) == 2
    shown = capfd.readouterr()
    assert said in shown.err
    assert shown.err.count("Error:") == 1
    assert shown.out.strip() in ("", "Loading the task, the policies and the devices")
    assert not (tmp_path / "home" / "data" / "rollouts").exists()


def test_a_session_of_the_pendulum_needs_no_arm_and_says_so(tmp_path: Path, capfd: Capture) -> None:
    assert app.run(["run-iteration", "--task", "pendulum", "--hw", "fr3", "--yes"]) == 2
    assert "Leave --hw out, or choose another --task" in capfd.readouterr().err
    assert not (tmp_path / "home" / "data" / "sessions").exists()


# What stands on the table --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (Scene(bottles=()), "no bottle: nothing stands in"),
        (Scene(((0.572, -0.009),)), "15 mm from its mark"),
        (Scene((MARK, (0.80, 0.12))), "2 bottles are on the table"),
        (Scene(hand=(0.75, 0.15, 0.08)), "clear the table, and keep hands away"),
        (Scene(hand=(0.56, 0.078, 0.05)), "keep hands and other things away from it"),
    ],
    ids=["no bottle", "misplaced", "two bottles", "a hand beside it", "a hand at it"],
)
def test_a_wrong_table_is_refused_before_anything_moves(
    scene: Scene, said: str, use: Callable[[BottleBench], BottleBench], tmp_path: Path, capfd: Capture
) -> None:
    bench = use(BottleBench(before=lambda trial, attempt: scene))
    assert app.run(SESSION) == 6
    shown = capfd.readouterr()
    assert said in shown.err.partition("Error:")[2]
    assert "Continue with: adaptsim run-iteration --session s" in shown.err
    assert shown.out == ""
    assert bench.arm.executed == []
    assert trials(tmp_path) == []


@pytest.mark.long
def test_a_second_bottle_half_way_costs_no_finished_trial_and_the_session_goes_on(
    use: Callable[[BottleBench], BottleBench], tmp_path: Path, capfd: Capture
) -> None:
    two = Scene((MARK, (0.80, 0.12)))
    bench = use(BottleBench(before=lambda trial, attempt: Scene() if trial == 1 else two))
    assert app.run(SESSION) == 6
    assert "leave one, on the mark" in capfd.readouterr().err
    assert bench.pushes == 1
    assert trials(tmp_path) == ["trial-001-attempt-1"]

    bench = use(BottleBench())
    assert app.run(SESSION) == 0
    summary = json.loads(capfd.readouterr().out)
    assert [len(particle["trials"]) for particle in summary["particles"]] == [2, 2]
    assert bench.pushes == 3, "the finished trial is kept"
    assert trials(tmp_path)[0] == "trial-001-attempt-1"
    assert len(trials(tmp_path)) == 4


def test_the_message_says_where_to_move_the_bottle(use: Callable[[BottleBench], BottleBench], capfd: Capture) -> None:
    use(BottleBench(before=lambda trial, attempt: Scene(((0.572, -0.009),)) if attempt == 0 else Scene()))
    assert app.run(ROLLOUT) == 0
    out = " ".join(capfd.readouterr().out.split())
    assert "5 mm are allowed; move it 12 mm towards the robot and 9 mm to the robot's left" in out


def test_four_millimetres_off_the_mark_are_accepted(use: Callable[[BottleBench], BottleBench], capfd: Capture) -> None:
    bench = use(BottleBench(before=lambda trial, attempt: Scene(((0.5628, 0.0028),))))
    assert app.run([*ROLLOUT, "--context", "goal_x=1.0"]) == 0
    assert bench.pushes == 1
    assert re.search(r"^upright, 2\d\d mm from the goal, reward 0\.00$", capfd.readouterr().out, re.MULTILINE)


@pytest.mark.long
def test_a_hand_in_the_picture_during_the_motion_is_flagged_and_the_trial_kept(
    use: Callable[[BottleBench], BottleBench], capfd: Capture
) -> None:
    use(BottleBench())
    assert app.run([*ROLLOUT, "--json"]) == 0
    alone = json.loads(capfd.readouterr().out)
    use(BottleBench(during=(0.80, 0.22, 0.08)))
    assert app.run([*ROLLOUT, "--json"]) == 0
    shown = capfd.readouterr()
    record = json.loads(shown.out)
    assert alone["flags"] == []
    assert any(flag.startswith("a hand or another object") for flag in record["flags"])
    assert "note: a hand or another object" in shown.err
    assert np.allclose(record["observation"], alone["observation"], atol=0.005), "it is not tracked for the bottle"


# What cannot be executed ---------------------------------------------------------------------------------------------


def test_a_push_into_what_must_be_kept_clear_is_refused(
    use: Callable[[BottleBench], BottleBench], tmp_path: Path, capfd: Capture
) -> None:
    box = KeepOut("the balance", np.array([0.62, -0.10, 0.0]), np.array([0.70, 0.10, 0.2]))
    bench = use(BottleBench(keep_out=(box,)))
    assert app.run([*ROLLOUT, "--action", "speed=0.8", "--action", "yaw=0.1"]) == 4
    said = capfd.readouterr().err
    assert "the balance" in said
    assert "Nothing has moved. Choose another --action: adaptsim preview --task pushing" in said
    assert bench.arm.executed == []
    assert not list((tmp_path / "home" / "data").glob("rollouts/*"))


def test_a_scoop_beyond_the_arm_is_refused_with_joint_value_and_limit(capfd: Capture) -> None:
    where = ["--context", "x=0.64", "--context", "y=-0.03"]
    how = ["--action", "pitch_rate=0.2", "--action", "pitch=0.1745", "--action", "distance=0.005"]
    assert app.run(["preview", "--task", "scooping", "--arm", "fr3", *where, *how, "--json"]) == 4
    shown = capfd.readouterr()
    assert re.search(r"fr3: no joint path keeps every limit .* joint \d at t = .* limit .* another action", shown.err)
    assert shown.out == ""


# The whole lab -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_camera_that_was_moved_stops_the_whole_lab_before_the_arm_moves(tmp_path: Path) -> None:
    world = tmp_path / "moved.toml"
    world.write_text(
        'task = "pushing"\ndescription = "a camera that was pushed aside"\n[params]\nmu = 0.1\ne = 1e5\nmu_p = 0.4\n'
        "y_p = 0.0\n[sensing]\nextrinsic_error_mm = 60.0\n"
    )
    program = [sys.executable, "-c", "from adaptsim_cli.app import main; main()"]
    command = [*program, "run-iteration", "--task", "pushing", "--world", str(world), "--yes", "--json"]
    for _ in range(2):
        done = subprocess.run(
            command, env=environment(tmp_path / "home"), capture_output=True, text=True, check=False, cwd=tmp_path
        )
        assert done.returncode == 6, done.stderr
        assert done.stderr.count("Error:") == 1
        assert "Traceback" not in done.stderr
        assert done.stdout == ""
        assert not [p for p in (tmp_path / "home").rglob("trial-*") if p.is_dir()]
