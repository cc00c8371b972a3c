"""A session with the edge 2 mm too high in cucumber: after four trials it asks, on the screen and in JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from lab_session import run

WORLD = """\
task = "scooping"
description = "a slice of cucumber, the tool 2 mm higher in the hand than anybody knows"
[params]
mu = 0.30
e = 1.0e+06
g = 1
h = 0.6
[nuisance]
radius = 0.018
[unmodelled]
density_scale = 0.95
edge = [0.0011, 3000.0]
colour = [0.34, 0.5, 0.14]
[sensing]
camera = "small"
[mount]
tool_height_mm = 2.0
"""


@pytest.mark.slow
def test_the_first_iteration_asks_whether_the_edge_is_too_high(tmp_path: Path) -> None:
    world = tmp_path / "high.toml"
    world.write_text(WORLD)
    done = run(tmp_path / "home", world)
    assert done.returncode == 0, done.stderr
    iteration = json.loads(done.stdout.splitlines()[0])
    assert iteration["suspicion"]["question"] == "Is the edge too high?"
    assert "strip of paper" in iteration["suspicion"]["look"]
    shown = " ".join(done.stderr.split())
    assert "Is the edge too high? The first 4 scoops failed alike" in shown
    assert "adaptsim touch-off --task scooping" in shown
