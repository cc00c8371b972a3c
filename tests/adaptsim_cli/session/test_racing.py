"""Two commands at once about one session: one of them waits or is refused, and the session comes to one of its ends."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

REFUSED = (2, 8)
"""Exit codes: another process holds the session; it was moved, deleted or begun by the other one."""


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("races", [3, pytest.param(200, marks=pytest.mark.slow)])
def test_two_commands_at_once_cost_nothing(races, tmp_path):
    script = Path(__file__).parents[2] / "support" / "racing_commands.py"
    alone = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # threads do not survive forking
    command = [sys.executable, str(script), str(tmp_path), str(races)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=alone)
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
