"""What light commands import: one line too much, and every command waits seconds for its first output."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("cv2", "matplotlib", "mujoco", "open3d", "pydrake", "scipy", "torch")
PROGRAM = "import sys; {}; sys.stderr.write(' '.join(m for m in {} if m in sys.modules))"


@pytest.mark.parametrize(
    ("program", "needed"),
    [
        ("from adaptsim_cli.app import run; run(['--help'])", ""),
        ("from adaptsim_cli.app import run; run(['config', 'path'])", ""),
        ("from adaptsim_cli.app import run; run(['lab', 'list'])", "pydrake"),
        ("import sim.tasks, hw.workcell", ""),
        ("import adaptsim_cli.session.store", ""),
        ("import adaptsim_cli.wiring.session, adaptsim_cli.wiring.hindsight", "cv2 scipy"),
        ("import sim.tasks.scooping, sim.lab.simulated, adaptsim_cli.wiring.session", "cv2 pydrake scipy"),
    ],
)
def test_nothing_heavy_is_imported_that_is_not_needed(program, needed):
    line = [sys.executable, "-c", PROGRAM.format(program, HEAVY)]
    done = subprocess.run(line, check=True, capture_output=True, text=True)
    assert done.stderr == needed
