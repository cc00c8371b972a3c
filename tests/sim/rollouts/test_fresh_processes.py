"""Workers of a script that begins its work without a guard must not begin it again; a script with threads may fork."""

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


FORKED = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
import numpy as np
import torch
from sim.rollouts.executors import process_pool
from sim.tasks import get_task

def computed():
    "A rollout, products of large matrices, and a process of its own."
    task = get_task("pendulum")
    middle = [space.low + 0.5 * (space.high - space.low) for space in (task.parameters, task.context, task.action)]
    ended = task.simulate(*middle, task.nuisance.low).state[-1]
    large = np.outer(np.arange(600.0), np.arange(600.0)) @ np.ones((600, 600))
    with process_pool(1) as pool:
        return ended.tolist(), float(large.sum()), pool.submit(abs, -3).result()

if __name__ == "__main__":
    torch.set_num_threads(4)
    (torch.ones(1500, 1500) @ torch.ones(1500, 1500)).sum()  # its threads wait from here on
    here = computed()
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as forked:
        print(forked.submit(computed).result(timeout=60) == here)
"""


@pytest.mark.long
def test_a_process_forked_beside_the_threads_of_torch_computes_the_same(tmp_path: Path) -> None:
    """As a data loader of torch forks its workers. Locks that such threads hold stay locked in a fork for ever."""
    pytest.importorskip("torch")
    (tmp_path / "forking.py").write_text(FORKED, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "forking.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.split()) == (0, ["True"]), done.stderr


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
