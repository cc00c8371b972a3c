"""`make results`: the page of every method in every set of worlds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import results
from documents import ROOT


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
    (line,) = [line for line in page.splitlines() if line.startswith("| `adaptsim` |")]
    assert all(0.5 < float(cell.strip(" *")) <= 1.0 for cell in line.split("|")[2:4])
    assert "benchmark --task pendulum --targets wd,ood-1" in page


def test_columns_and_cells() -> None:
    def row(world: str, kind: str = "named", reward: float = 0.5) -> dict[str, object]:
        return {"set": kind, "target": world, "method": "udr", "reward": reward, "seed": 0}

    assert [results.column_of(row(w)) for w in ("wd", "soft-cheese")] == ["wd", "selected"]
    assert results.column_of(row("drawn-1-3", "drawn")) == "drawn"
    rows = [row("a", "drawn", 0.2), row("a", "drawn", 0.4), row("b", "drawn", 1.0)]
    assert results.by_world(rows, "udr", "drawn") == [[0.2, 0.4], [1.0]]
    assert results.cell([[0.2, 0.4], [1.0]], 0.65, is_limit=False) == "**0.650**"
    assert results.cell([[0.2, 0.4], [1.0]], 0.65, is_limit=True) == "0.650"
    assert results.cell([[0.5], [0.5], [0.5]], 0.9, is_limit=False) == "0.500 (0.50 to 0.50)"
    assert results.cell([], 0.9, is_limit=False) == "–"
