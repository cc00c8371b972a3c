"""The benchmarks: `make results` with its page, and a foreign lab that shares no code with the product."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest
import results
from documents import ROOT


@pytest.mark.long
def test_the_short_form_runs_from_nothing_and_continues(tmp_path, monkeypatch):
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    script = str(ROOT / "benchmarks/results.py")
    command = [sys.executable, script, "--short", "--folder", str(tmp_path), "--workers", "1"]
    for _ in range(2):  # the second time everything is there
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    page = (tmp_path / "methods.md").read_text()
    assert "## Pendulum" in page
    line = next(line for line in page.splitlines() if line.startswith("| `adaptsim` |"))
    _, _, sessions, reward, _, curve, _ = line.split("|")
    assert int(sessions) == 1
    assert 0.5 < float(reward.strip(" *")) <= 1.0
    assert len(curve.split(",")) == 3
    assert "benchmark --task pendulum --targets wd,ood-1" in page
    assert len(results.read(tmp_path / "sessions.csv")) == 10


def test_a_reward_is_bold_where_it_is_the_best_of_the_methods():
    earned = results.by_world([session("a", 0.2), session("a", 0.4, seed=1), session("b", 1.0)], "udr")
    assert earned == {"a": {0: 0.2, 1: 0.4}, "b": {0: 1.0}}
    assert results.reward(earned, 0.65, is_limit=False) == "**0.650**"
    assert results.reward(earned, 0.65, is_limit=True) == "0.650"


def test_a_lead_is_paired_by_world_and_seed_and_names_its_least_world():
    ours = {"a": {0: 0.5, 1: 0.9}, "b": {0: 0.2, 1: 0.2}}
    assert results.lead(ours, {"a": {0: 0.4}, "b": {0: 0.4}}) == "-0.050; -0.20 in b"


def test_only_whole_sets_are_compared_and_the_page_comes_from_the_table(tmp_path):
    part = results.SHORT[0]
    methods = [("adaptsim", "a"), ("adaptsim", "b"), ("random", "a"), ("udr", "a"), ("udr", "b")]
    table = tmp_path / "sessions.csv"
    results.write(table, [session(world, 0.5, method) for method, world in methods])
    page = results.written([part], results.read(table), short=True)
    assert "| `udr` |" in page
    assert "| `random` |" not in page


def session(world: str, reward: float, method: str = "udr", seed: int = 0) -> results.Session:
    return results.Session("pendulum", world, method, seed, reward, ((2, 0.1), (4, reward)))


LAB = ROOT / "benchmarks/foreign_lab"
OURS = {"adaptsim_cli", "calib", "hw", "perception", "sim"}
OFFERED_TO = "program.py"


def imported(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").partition(".")[0])
    return found


@pytest.mark.parametrize("path", sorted(LAB.glob("*.py")), ids=lambda path: path.name)
def test_only_the_program_imports_ours(path):
    assert bool(imported(path) & OURS) == (path.name == OFFERED_TO)
