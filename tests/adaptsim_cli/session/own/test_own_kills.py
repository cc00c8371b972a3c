"""A session with a robot of one's own is killed at every moment; no trial is made twice, and no answer is lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from campaigns import campaign
from own_robot import NAME, PLACED, PUSHED, program, robot, run, runs

from adaptsim_cli.errors import AnswerRefused
from adaptsim_cli.session.history import trials_of
from adaptsim_cli.session.own import program as programs
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.storage import durable
from sim.tasks.task import Task

WRITING = ("write_file", "replace_file", "write_folder", "complete_folder", "make_folder")
MOMENTS = range(0, 100, 5)


class Killed(BaseException):
    """The process is gone."""


class Fuse:
    """Kills at one writing: before it, or after it."""

    def __init__(self, moment: int) -> None:
        self.at, self.after = divmod(moment, 2)
        self.count = 0

    def wrapped(self, write):
        def writing(*args, **kwargs):
            number = self.count
            self.count += 1
            if number == self.at and not self.after:
                raise Killed
            done = write(*args, **kwargs)
            if number == self.at:
                raise Killed
            return done

        return writing


def numbers(store: SessionStore) -> list[tuple[object, ...]]:
    return [(t.trial, t.attempt, t.context, t.action, t.observation, t.reward) for t in trials_of(store)]


@pytest.fixture(scope="module", params=[PUSHED, PLACED], ids=["pushed", "placed"])
def whole(request, tmp_path_factory) -> tuple[Task, list[tuple[object, ...]], list[str]]:
    """A session that nobody killed."""
    place = tmp_path_factory.mktemp("whole")
    done = run(place / "home", program(robot(place)), request.param)
    return request.param, numbers(done), runs(place)


@pytest.mark.parametrize("moment", campaign(MOMENTS, 3))
def test_killed_at_a_writing_it_goes_on_with_every_trial_made_once(place: Path, whole, moment, monkeypatch) -> None:
    task, trials, asked = whole
    answering = program(robot(place))
    with monkeypatch.context() as patch:
        fuse = Fuse(moment)
        for name in WRITING:
            patch.setattr(durable, name, fuse.wrapped(getattr(durable, name)))
        with pytest.raises(Killed):
            run(place.parent / "home", answering, task)
    done = run(place.parent / "home", answering, task)
    assert numbers(done) == trials
    assert runs(place) == asked, "no question reached the robot twice"


def test_a_program_outlives_adaptsim_and_its_answer_is_taken_without_a_second_run(place: Path) -> None:
    slow = robot(place).replace("robot.py", "slow.py")
    body = (place / "robot.py").read_text()
    wait = f"import os, time\nwhile not os.path.exists({str(place / 'go')!r}): time.sleep(0.01)\n"
    (place / "slow.py").write_text(wait + body)

    def killed(_: float) -> None:
        raise Killed

    with pytest.raises(Killed):
        run(place.parent / "home", program(slow, pause=killed))
    assert runs(place) == []
    (place / "slow.py").write_text(body)  # only a second run would read it
    threading.Timer(0.2, (place / "go").touch).start()
    done = run(place.parent / "home", program(slow))
    assert len(trials_of(done)) == 4
    assert runs(place) == [f"trial {n}.1" for n in range(1, 5)]


CHILD = """
import sys
from pathlib import Path
from own_robot import program, run
run(Path(sys.argv[1]), program(sys.argv[2]))
"""


@pytest.mark.long
def test_a_kill_of_adaptsim_and_of_all_that_it_started_in_its_group_leaves_the_program_alive(place: Path) -> None:
    command = robot(place)
    body = (place / "robot.py").read_text()
    begun, go = place / "begun", place / "go"
    wait = (
        f"import os, time\nopen({str(begun)!r}, 'w').close()\nwhile not os.path.exists({str(go)!r}): time.sleep(0.01)\n"
    )
    (place / "robot.py").write_text(wait + body)
    path = os.pathsep.join(sys.path)
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(place.parent / "home"), command],
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
    )
    while not begun.exists():
        assert child.poll() is None
        threading.Event().wait(0.02)
    os.killpg(child.pid, signal.SIGKILL)
    child.wait()
    go.touch()
    done = run(place.parent / "home", program(command))
    assert [t.attempt for t in trials_of(done)] == [1] * 4
    assert runs(place) == [f"trial {n}.1" for n in range(1, 5)]


def test_after_the_time_limit_nothing_is_killed_and_the_answer_is_taken_later(place: Path) -> None:
    slow = robot(place)
    wait = f"import os, time\nwhile not os.path.exists({str(place / 'go')!r}): time.sleep(0.01)\n"
    (place / "robot.py").write_text(wait + (place / "robot.py").read_text())
    impatient = programs.Program(slow, False, 0.05, None)
    with pytest.raises(AnswerRefused, match=r"not answered within 0.05 s .* it continues, and nothing stops it"):
        run(place.parent / "home", impatient)
    (place / "go").touch()
    assert len(trials_of(run(place.parent / "home", program(slow)))) == 4
    assert runs(place) == [f"trial {n}.1" for n in range(1, 5)]
    assert (place.parent / "home/data/sessions" / NAME / "questions/trial-001-attempt-1/trial.run-1.exit").exists()


def test_a_computer_that_stopped_in_the_middle_asks_again(place: Path) -> None:
    command = robot(place, "import os, signal\nos.kill(os.getppid(), signal.SIGKILL)\nos.kill(os.getpid(), 9)")
    with pytest.raises(AnswerRefused, match="was killed, or the computer stopped, before it answered"):
        run(place.parent / "home", program(command))
    assert len(trials_of(run(place.parent / "home", program(robot(place))))) == 4
