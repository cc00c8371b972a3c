"""The wheel, built and installed in an empty environment outside of the checkout, works."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_wheel_works_outside_of_the_checkout() -> None:
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(["make", "package"], cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    said = done.stdout + done.stderr
    assert "Next: adaptsim run-iteration" in said
    assert "Report: " in said
    assert str(ROOT / "build/package/home") in said.replace("\n", "")
    (wheel,) = (ROOT / "build/package").glob("adaptsim-*.whl")
    assert wheel.stat().st_size < 30_000_000
