"""`make results`: the page of every method in every set of worlds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import results
from documents import ROOT


@pytest.mark.long
def test_the_short_form_runs_from_nothing_and_continues(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    command = [
        sys.executable,
        str(ROOT / "benchmarks/results.py"),
        "--short",
        "--folder",
        str(tmp_path),
        "--workers",
        "1",
    ]
    for _ in range(2):  # the second time everything is there
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    page = (tmp_path / "methods.md").read_text()
    assert "## Pendulum" in page
    line, curve = [line for line in page.splitlines() if line.startswith("| `adaptsim` |")]
    assert 0.5 < float(line.split("|")[2].strip(" *")) <= 1.0
    assert len(curve.split(",")) == 3
    assert "| `adaptsim` minus | Table A2 (2 worlds) |" in page
    assert "benchmark --task pendulum --targets wd,ood-1" in page


def test_groups_and_cells() -> None:
    def row(world: str, kind: str = "named", reward: float = 0.5) -> dict[str, object]:
        return {"set": kind, "target": world, "method": "udr", "reward": reward, "seed": 0}

    assert [results.group_of(row(w)) for w in ("wd", "soft-cheese", "oreo")] == ["Table A2", "selected", "foods"]
    assert results.group_of(row("drawn-2-3", "drawn")) == "drawn"
    rows = [row("a", "drawn", 0.2), row("a", "drawn", 0.4), row("b", "drawn", 1.0)]
    assert results.by_world(rows, "udr", "drawn") == [[0.2, 0.4], [1.0]]
    assert results.cell([[0.2, 0.4], [1.0]], 0.65, is_limit=False) == "**0.650**"
    assert results.cell([[0.2, 0.4], [1.0]], 0.65, is_limit=True) == "0.650"
    assert results.cell([[0.5], [0.5], [0.5]], 0.9, is_limit=False) == "0.500 (0.50 to 0.50)"
    assert results.cell([], 0.9, is_limit=False) == "–"


def test_a_lead_is_paired_and_names_its_least_world() -> None:
    told = results.lead(np.array([0.1, -0.2, 0.4]), ["wd", "ood-1", "ood-2"])
    assert told.startswith("+0.100 (")
    assert told.endswith("; -0.20 in ood-1")


def test_only_whole_sets_are_compared() -> None:
    def row(method: str, target: str, reward: float) -> dict[str, object]:
        return {"method": method, "set": "drawn", "target": target, "seed": 0, "reward": reward, "curve": [[2, 0.0]]}

    rows = [row("adaptsim", "a", 0.5), row("adaptsim", "b", 0.7), row("random", "a", 0.1), row("udr", "a", 0.4)]
    lines = results.paired([*rows, row("udr", "b", 0.4)])
    assert "| `random` | – |" in lines
    assert any(line.startswith("| `udr` | +0.200 (") for line in lines)
