"""Workers of a script that begins its work without a guard: they must not begin it again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sim.rollouts.executors import _is_guarded

ROOT = Path(__file__).parents[3]
UNGUARDED = """
from sim.rollouts.executors import process_pool

print("begins")
with process_pool(1) as pool:
    print(pool.submit(abs, -3).result())
"""


def test_a_script_without_a_guard_is_not_run_again_by_its_workers(tmp_path: Path) -> None:
    (tmp_path / "study.py").write_text(UNGUARDED, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "study.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, ["begins", "3"], "")


@pytest.mark.parametrize(
    ("text", "guarded"),
    [
        ("if __name__ == '__main__':\n    main()", True),
        ('if "__main__" == __name__: main()', True),
        ("print(type(3).__name__)", False),
        ("main()", False),
    ],
)
def test_a_guard_is_a_comparison_of_the_name(text: str, guarded: bool, tmp_path: Path) -> None:
    file = tmp_path / "script.py"
    file.write_text(text, encoding="utf-8")
    assert _is_guarded(str(file)) is guarded
    assert _is_guarded(None) and _is_guarded(str(tmp_path / "gone.py"))
