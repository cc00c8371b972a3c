"""Every fault through `adaptsim run-iteration`: the exit code, the words, and the same command that goes on.

Arm and camera are those of the toy lab, so that a fault comes at a chosen motion and a session takes a second.
`test_fault_drill_fr3.py` has an FR3 at the network and a pedal on a serial line. docs/guide/faults.md names these
tests.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from lab_session import digest
from toy_rig import ToyLab
from toy_session import call

from hw.errors import ArmFault, CameraError, StoppedByPedal

SESSION = ["run-iteration", "--task", "toy", "--session", "s", "--yes", "--json"]
CONTINUE = "Continue with: adaptsim run-iteration --session s"


def run(home: Path, lab: ToyLab) -> tuple[int, str, str]:
    """The command itself, in this process: exit code, stderr on one line, stdout."""
    home.parent.mkdir(exist_ok=True)
    out = io.StringIO()
    code, said = call(home, SESSION, lab, out)
    return code, said, out.getvalue()


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, object]:
    """The records of a session that nothing disturbs."""
    home = tmp_path_factory.mktemp("whole") / "home"
    assert run(home, ToyLab(0))[0] == 0
    return digest(home)


def stored(home: Path) -> dict[str, bytes]:
    """Every file of every completed trial, byte by byte."""
    root = home / "data/sessions/s/iteration-01"
    return {str(p.relative_to(root)): p.read_bytes() for p in sorted(root.glob("trial-*/*")) if p.is_file()}


def completed(home: Path) -> list[str]:
    """The folders of completed trials."""
    return sorted(path.parent.name for path in home.glob("data/sessions/s/iteration-01/*/trial.json"))


def raising(error: BaseException) -> Callable[[int, int], None]:
    """A hook that raises at the first attempt of the second trial."""

    def fail(trial: int, attempt: int) -> None:
        if (trial, attempt) == (2, 0):
            raise error

    return fail


THEN = "look at the arm and recover it, then redo the trial"
REFLEX = ArmFault(f"fr3 stopped 0.412 s into the path: joint_reflex; {THEN}")
RELEASED = StoppedByPedal(f"fr3: the enabling pedal was released; {THEN}")
NO_FRAME = CameraError("no frame within 1 s; check the camera's cable and power, then redo the trial")


@pytest.mark.parametrize(
    ("moment", "error", "code", "words"),
    [
        ("execute", REFLEX, 5, "recover it, then redo the trial"),
        ("execute", RELEASED, 7, "the enabling pedal was released"),
        ("snapshot", NO_FRAME, 6, "check the camera's cable and power"),
        ("stop_recording", NO_FRAME, 6, "check the camera's cable and power"),
    ],
    ids=["reflex", "pedal", "camera before", "camera half-way"],
)
def test_a_fault_is_told_costs_one_attempt_and_the_same_command_goes_on(moment, error, code, words, whole, tmp_path):
    home = tmp_path / "a/home"
    ended, told, data = run(home, ToyLab(0, hooks={moment: raising(error)}))
    assert (ended, data) == (code, "")
    assert told.count("Error:") == 1
    assert words in told.partition("Error:")[2]
    assert CONTINUE in told
    assert completed(home) == ["trial-001-attempt-1"]
    kept = stored(home)

    afterwards = ToyLab(0)
    ended, told, data = run(home, afterwards)
    assert ended == 0, told
    assert json.loads(data)["iteration"] == 1
    assert completed(home) == [f"trial-00{n}-attempt-{1 + int(n == 2)}" for n in range(1, 5)]
    assert afterwards.executions == [(2, 1), (3, 0), (4, 0)], "the completed trial is not done again"
    assert kept.items() <= stored(home).items(), "and nothing of it is touched"
    assert untouched(digest(home)) == untouched(whole), "every other trial is that of an undisturbed session"


def untouched(records: dict[str, object]) -> dict[str, object]:
    """Without the second trial, which is another attempt, and the result that rests on it."""
    return {name: content for name, content in records.items() if "trial-002" not in name and "result" not in name}


def full(trial: int, attempt: int) -> None:
    def no_space(fd: object) -> None:
        raise OSError(28, os.strerror(28))

    if trial == 2:
        os.fsync = no_space  # from here on, the recording of the second trial included


@pytest.mark.parametrize(
    ("hook", "code", "words"),
    [
        (full, 8, "free some space and run the same command again"),
        (raising(KeyboardInterrupt()), 130, "everything completed is stored"),
    ],
    ids=["disk full", "ctrl-c"],
)
def test_what_stops_the_program_costs_nothing_in_the_simulated_lab(hook, code, words, whole, tmp_path):
    """There an attempt begins from the same state; a real arm's is spent (`test_session_flow.py`)."""
    home = tmp_path / "a/home"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", os.fsync)  # and back
        ended, told, data = run(home, ToyLab(0, hooks={"stop_recording": hook}))
    assert (ended, data) == (code, "")
    assert told.count("Error:") == (code != 130), "a person who stops it is no error"
    assert words in told.rpartition("Error:")[2]
    assert CONTINUE in told
    assert completed(home) == ["trial-001-attempt-1"]
    afterwards = ToyLab(0)
    assert run(home, afterwards)[0] == 0
    assert afterwards.executions == [(2, 0), (3, 0), (4, 0)]
    assert digest(home) == whole
