"""A disk that fails at any call, then the same command again, comes to the same end."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SAMPLE = 20


def test_a_disk_that_fails_at_some_calls_costs_nothing(tmp_path: Path) -> None:
    result = fail(tmp_path, SAMPLE)
    assert len(result["outcomes"]) == SAMPLE
    assert {len(o["before"]) for o in result["outcomes"]} >= {0, 2, 4}, (
        "the failures should fall all over the iteration"
    )
    judge(result)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_disk_that_fails_at_any_call_costs_nothing(tmp_path: Path) -> None:
    result = fail(tmp_path, 0)
    assert len(result["outcomes"]) == 4 * (result["calls"] - 1)
    judge(result)


def fail(folder: Path, failures: int) -> Any:
    script = Path(__file__).parents[1] / "support" / "failing_disk_session.py"
    command = [sys.executable, str(script), str(folder), str(failures)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def judge(result: Any) -> None:
    assert result["calls"] > 60
    assert result["files"] > 20
    for outcome in result["outcomes"]:
        assert outcome["same"], outcome
        if outcome["way"].startswith("killed"):
            assert outcome["status"] is None, outcome
        else:
            assert outcome["status"] == 1, outcome
            wanted = "DiskFull: the disk is full: " if outcome["way"] == "full" else "could not be written: "
            assert wanted in outcome["message"], outcome
