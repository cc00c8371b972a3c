"""A world's `[mount]`: what it means, and that a nominal one changes nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hw.kinematics import forward
from sim.errors import WorldError
from sim.lab import mounting
from sim.lab.simulated import READY_RAD
from sim.lab.world import Mount, list_worlds, load_world
from sim.panda.correction import ToolCorrection
from sim.tasks import get_task

TASK = get_task("scooping")
HARDWARE = TASK.require_hardware()
HEAD = 'task = "scooping"\n[params]\nmu = 0.3\ne = 5e4\ng = 1\nh = 2.0\n[mount]\n'


def test_shipped_worlds_have_a_nominal_mount_which_is_exactly_none() -> None:
    assert all(load_world(name, TASK).mount == Mount() for name in list_worlds(TASK))
    np.testing.assert_array_equal(mounting.X_WB(Mount()), np.eye(4))
    np.testing.assert_array_equal(mounting.X_FT(HARDWARE.X_FT, Mount()), HARDWARE.X_FT)


def test_a_world_file_says_how_table_and_tool_are_off(tmp_path: Path) -> None:
    path = tmp_path / "off.toml"
    path.write_text(HEAD + "table_height_mm = -6.0\ntable_tilt_mrad = [3.0, -2.0]\ntool_height_mm = 2.0\n")
    mount = load_world(str(path), TASK).mount
    assert mount == Mount(-6.0, (3.0, -2.0), 2.0)
    for line, match in (("table_height_mm = 80.0", "table_height_mm"), ("tool_hight_mm = 1.0", "tool_height_mm")):
        path.write_text(HEAD + line + "\n")
        with pytest.raises(WorldError, match=match):
            load_world(str(path), TASK)


def test_a_correction_with_the_truth_puts_the_tool_where_it_is() -> None:
    """Planning through the correction and standing on the true base come to the same place over the table."""
    mount = Mount(-6.0, (3.0, -2.0), 2.0, 8.0)
    found = ToolCorrection(mounting.true_table(mount), 2e-3, 0.0, 0.0, 8e-3)
    true_X_WT = mounting.X_WB(mount) @ forward(READY_RAD) @ mounting.X_FT(HARDWARE.X_FT, mount)
    np.testing.assert_allclose(found.X_WB @ forward(READY_RAD) @ found.X_FT(HARDWARE.X_FT), true_X_WT, atol=1e-12)
    np.testing.assert_allclose(found.X_BW @ found.X_WB, np.eye(4), atol=1e-12)
