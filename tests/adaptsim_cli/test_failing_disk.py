"""A disk that fails at any call, then the same command again, comes to the same end; and two commands at once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

WAYS = ("killed before", "killed after", "full", "broken")
SAMPLES = {"session": 20, "calibration": 6}
WANTED = {"full": "DiskFull: the disk is full: ", "broken": "SessionError: "}
FURTHER = {"full": "free some space and run the same command again", "broken": "Input/output error"}
SILENT = ("unlink", "rmdir")
"""What a failed removal leaves behind is removed by the next run: it may be passed over."""
ONE_THREAD = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OPENCV_FOR_THREADS_NUM": "1"}
"""A child that is forked from several threads may wait for ever for a lock that one of them held."""
LOG = "log.jsonl"
"""No record: the screen notes that a line is missing, and the session goes on."""


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("what", SAMPLES)
def test_a_disk_that_fails_at_some_calls_costs_nothing(what, tmp_path):
    result, outcomes = fail(what, tmp_path, str(SAMPLES[what]))
    assert len(outcomes) == SAMPLES[what]
    assert len({outcome["completed"] for outcome in outcomes}) > 2, "the failures should fall all over it"
    judge(result, outcomes)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("what", SAMPLES)
def test_a_disk_that_fails_at_any_call_costs_nothing(what, way, tmp_path):
    result, outcomes = fail(what, tmp_path, way)
    assert [outcome["at"] for outcome in outcomes] == list(range(len(result["calls"])))
    judge(result, outcomes)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("what", SAMPLES)
def test_a_disk_that_fails_wherever_the_code_writes_costs_nothing(what, tmp_path):
    """In every way, at the first and last call from each place of the code: the calls between differ in names alone."""
    result, outcomes = fail(what, tmp_path, "places")
    assert len({outcome["at"] for outcome in outcomes}) >= result["places"] > 20
    assert len(outcomes) == len(WAYS) * len({outcome["at"] for outcome in outcomes})
    judge(result, outcomes)


def fail(what: str, folder: Path, which: str) -> tuple[Any, list[Any]]:
    script = Path(__file__).parents[1] / "support" / f"failing_disk_{what}.py"
    command = [sys.executable, str(script), str(folder), which]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=ONE_THREAD)
    assert done.returncode == 0, done.stderr
    *outcomes, result = map(json.loads, done.stdout.splitlines())
    return result, outcomes


def judge(result: Any, outcomes: list[Any]) -> None:
    kinds = Counter(call.split()[0] for call in result["calls"])
    assert min(kinds[kind] for kind in ("open", "write_bytes", "fsync", "rename", "mkdir")) > 0, kinds
    assert result["files"] > 20
    for outcome in outcomes:
        assert not outcome["lost"], outcome
        assert outcome["again"][0] == 0, outcome
        assert not outcome["different"], outcome
        assert not outcome["damage"], outcome
        if outcome["way"].startswith("killed"):
            assert outcome["status"] is None, outcome
        elif outcome["status"] == 0:
            kind, path = outcome["call"].split()[:2]
            assert kind in SILENT or path.endswith(LOG), outcome
        else:
            assert WANTED[outcome["way"]] in outcome["message"], outcome
            assert FURTHER[outcome["way"]] in outcome["message"], outcome


REFUSED = (2, 8)
"""Exit codes: another process holds the session; it was moved, deleted or begun by the other one."""


@pytest.mark.long
@pytest.mark.parametrize(
    "races",
    [
        pytest.param(3, marks=pytest.mark.timeout(600)),
        pytest.param(200, marks=[pytest.mark.slow, pytest.mark.timeout(1800)]),
    ],
)
def test_two_commands_at_once_cost_nothing(races, tmp_path):
    script = Path(__file__).parents[1] / "support" / "racing_commands.py"
    command = [sys.executable, str(script), str(tmp_path), str(races)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=ONE_THREAD)
    assert done.returncode == 0, done.stderr
    outcomes = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(outcomes) == races
    for outcome in outcomes:
        assert outcome["end"] is not None, outcome
        assert outcome["damage"] == outcome["left"] == [], outcome
        assert 0 in outcome["codes"], outcome
        for code, said in zip(outcome["codes"], outcome["said"], strict=True):
            assert code in (0, *REFUSED), outcome
            assert said.count("Error: ") == (code in REFUSED), outcome
    assert any(code in REFUSED for outcome in outcomes for code in outcome["codes"]), "some should meet"
