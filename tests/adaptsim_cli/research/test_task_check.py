"""A task whose code hangs or crashes: the check ends it and names the line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from adaptsim_cli.commands import app
from adaptsim_cli.research import task_check
from adaptsim_cli.research.task_check import checked
from sim.errors import TaskError
from sim.own.silence import ending

TASK = '''"""A block."""
import ctypes
import itertools
import os
import time

import adaptsim
{top}

@adaptsim.task(
    parameters={{"mu": (0.1, 0.3)}},
    action={{"push": (1.0, 3.0, "m/s")}},
    state={{"x": (0.0, 4.0, "m")}},
    duration=1.0,
    reward=lambda end: max(0.0, 1.0 - abs(end.x - 1.0)),
)
def slide(p, action):
    {body}
    return [0.0, 1.0], [0.0, p.mu * action.push]
'''
HANGS = """
import sys
from pathlib import Path
from sim.own.silence import StepTimer

watchdog = StepTimer(Path(sys.argv[1]))
watchdog.begin("a rollout", 30.0)
watchdog.begin("a rollout with µ = 0.1", 0.3)
exec(compile(sys.argv[2], "/tmp/schön.py", "exec"))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(folder: Path, body: str = "pass", top: str = "") -> str:
    (folder / "slide.py").write_text(TASK.format(top=top, body=body), encoding="utf-8")
    return "slide.py"


@pytest.mark.parametrize(
    ("code", "timed_out", "cause"),
    [
        ("\nimport itertools\nsum(itertools.count())", True, "exit code 1"),  # holds the interpreter
        ("\nimport ctypes\nctypes.string_at(0)", False, "Segmentation fault"),
    ],
)
def test_the_record_says_step_and_line_also_where_compiled_code_hangs_or_crashes(tmp_path, code, timed_out, cause):
    record = tmp_path / "record.txt"
    status = subprocess.run([sys.executable, "-c", HANGS, str(record), code], check=False).returncode
    end = ending(record, "/tmp/schön.py", status)
    assert (end.step, end.line, end.timed_out, end.cause) == ("a rollout with µ = 0.1", 3, timed_out, cause)


@pytest.mark.long
@pytest.mark.parametrize("body", ["while True: pass", "sum(itertools.count())", "os.read(os.pipe()[0], 1)"])
def test_a_rollout_that_hangs_ends_with_its_line_and_the_next_command(folder, monkeypatch, body, capfd):
    assert app.run(["task", "check", written(folder, body), "--limit", "2"]) == 2
    said = " ".join(capfd.readouterr().err.split())
    assert "slide.py, line 18: a rollout with mu = 0.2 has not ended after 20 s." in said
    assert "if it only needs more time: adaptsim task check slide.py --limit 80" in said


@pytest.mark.long
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("os.kill(os.getpid(), 9)", r"slide.py: a rollout with mu = 0.2 ended the process \(signal SIGKILL\)"),
        ("raise KeyboardInterrupt", "slide.py, line 18: KeyboardInterrupt"),
    ],
)
def test_a_rollout_that_ends_the_process_is_named(folder, body, words):
    with pytest.raises(TaskError, match=words):
        checked(written(folder, body), 2.0)


@pytest.mark.long
@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("input()", "slide.py, line 18 calls input: a task may not wait for the keyboard"),
        ("return range(10**6), range(10**6)", "returns 1,000,000 times: at most 200,000 are kept"),
        ("p = type('P', (), dict(mu=0.2 + 0 * time.time()))", "slide.py, line 18 reads the clock"),
    ],
)
def test_a_rollout_that_does_more_than_compute_is_named(folder, body, words):
    details = " ".join(one["detail"] for one in checked(written(folder, body), 2.0)["findings"])
    assert words in details


@pytest.mark.long
def test_a_program_that_the_task_started_ends_with_the_check(folder):
    top = "import subprocess\nsubprocess.Popen(['sh', '-c', 'sleep 987 & echo $! > pid; wait'])"
    answer = checked(written(folder, top=top), 2.0)
    assert any(one["check"] == "the file starts a process" for one in answer["findings"])
    pid = Path("pid").read_text().strip()
    assert not Path(f"/proc/{pid}").exists() or " Z " in Path(f"/proc/{pid}/stat").read_text()


def test_an_interrupt_ends_the_other_process(folder, monkeypatch):
    started = list[subprocess.Popen[bytes]]()

    def interrupted(process: subprocess.Popen[bytes]) -> None:
        started.append(process)
        raise KeyboardInterrupt

    monkeypatch.setattr(task_check, "_wait_without_reaping", interrupted)
    with pytest.raises(KeyboardInterrupt):
        checked(written(folder, "time.sleep(1e6)"), 60.0)
    assert started[0].returncode == -9
