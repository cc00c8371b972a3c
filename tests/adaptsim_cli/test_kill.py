"""SIGKILL at any durable step, then the same command again, comes to the same end."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

KILLS = 20


def test_a_session_killed_at_twenty_moments_resumes_to_the_same_end(tmp_path: Path) -> None:
    script = Path(__file__).parent / "kill_session.py"
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(KILLS)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["steps"] > 60
    assert result["files"] > 20
    assert len(result["outcomes"]) == KILLS
    assert all(outcome["killed"] for outcome in result["outcomes"])
    assert [o["at"] for o in result["outcomes"] if not o["same"]] == []
    assert {len(o["before"]) for o in result["outcomes"]} >= {0, 2, 4}, "the kills should fall all over the iteration"
