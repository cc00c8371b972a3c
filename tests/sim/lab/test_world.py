"""World files: what is taken, what is refused, and how the refusal reads."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from slider import TASK

from hw.collision import Table
from sim.errors import UnknownName, WorldError
from sim.lab.world import Faults, Mount, Sensing, list_worlds, load_world
from sim.panda.tool import ToolCorrection
from sim.tasks import get_task
from sim.types import Space

PARAMS = "[params]\nmu = 0.3\ne = 1e5\nkind = 1\nh = 2.0\ny = 0.0\n"


def load(tmp_path: Path, text: str):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return load_world(str(path), TASK)


def test_what_is_left_out_is_nominal(tmp_path: Path) -> None:
    world = load(tmp_path, f'task = "slider"\n{PARAMS}')
    assert world.name == "mine"
    np.testing.assert_allclose(world.parameters, [0.3, 1e5, 1, 2.0, 0.0])
    np.testing.assert_allclose(world.nuisance, [0.015])
    assert world.unmodelled == TASK.unmodelled()
    assert world.sensing == Sensing()
    assert world.faults == Faults()


def test_a_parameter_with_a_default_may_be_left_out(tmp_path: Path) -> None:
    """Worlds that were written before a parameter was added stay valid."""
    dimensions = tuple(replace(d, default=2.0) if d.name == "h" else d for d in TASK.parameters.dimensions)
    later = replace(TASK, parameters=Space(dimensions))
    file = tmp_path / "older.toml"
    file.write_text('task = "slider"\n' + PARAMS.replace("h = 2.0\n", ""), encoding="utf-8")
    assert load_world(str(file), later).parameters[3] == 2.0
    with pytest.raises(WorldError, match="has no key 'h'"):
        load_world(str(file), TASK)


def test_everything_can_be_said(tmp_path: Path) -> None:
    world = load(
        tmp_path,
        f'task = "slider"\ndescription = "skewed"\n{PARAMS}[nuisance]\nradius = 0.012\n'
        "[unmodelled]\nscale = [1.2, 0.9]\ndt_s = 0.001\npitch_bias_rad = 0.01\n"
        '[sensing]\ndepth_noise_scale = 2\ncamera = "small"\n[faults]\narm_reflex = [2, 5]\n',
    )
    assert world.description == "skewed"
    assert world.nuisance[0] == 0.012
    assert world.unmodelled == TASK.unmodelled(scale=(1.2, 0.9), dt_s=0.001, pitch_bias_rad=0.01)
    assert world.sensing == Sensing(depth_noise_scale=2.0, camera="small")
    assert world.faults == Faults(arm_reflex=(2, 5))


def test_values_outside_of_the_ranges_are_allowed(tmp_path: Path) -> None:
    world = load(tmp_path, f'task = "slider"\n{PARAMS.replace("h = 2.0", "h = 3.4")}')
    assert world.parameters[3] == 3.4


@pytest.mark.parametrize(
    ("line", "instead", "message"),
    [
        ("mu = 0.3", "nu = 0.3", r"unknown key 'nu' in \[params\]; known are mu, e, kind, h, y"),
        ("mu = 0.3\n", "", r"\[params\] has no key 'mu'"),
        ("mu = 0.3", 'mu = "0.3"', r"'mu' in \[params\] is '0.3'"),
        ("mu = 0.3", "mu = true", r"'mu' in \[params\] is True"),
        ("mu = 0.3", "mu = nan", r"'mu' in \[params\] is nan"),
        ("mu = 0.3", "mu = -0.3", r"mu = -0.3 in \[params\] is not physically possible: it must be positive"),
        ("h = 2.0", "h = 0.02", r"h \[cm\] = 0.02 in \[params\] looks like m, but the unit is cm"),
        ("h = 2.0", "h = 20", r"h \[cm\] = 20 in \[params\] looks like mm, but the unit is cm"),
        ("e = 1e5", "e = 100.0", r"e \[Pa\] = 100 in \[params\] looks like kPa, but the unit is Pa"),
        ("y = 0.0", "y = 5.0", r"y \[m\] = 5 in \[params\] looks like cm, but the unit is m"),
        ("kind = 1", "kind = 0.5", r"'kind' in \[params\] is 0.5"),
        ("kind = 1", "kind = 7", r"kind = 7 in \[params\] is not a kind; choose 0 to 1"),
    ],
)
def test_a_bad_parameter_is_named(tmp_path: Path, line: str, instead: str, message: str) -> None:
    with pytest.raises(WorldError, match=message):
        load(tmp_path, f'task = "slider"\n{PARAMS.replace(line, instead)}')


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ("[unmodeled]\n", r"unknown key 'unmodeled' in the top level \(did you mean unmodelled\?\)"),
        (
            "[unmodelled]\npitch_bias = 0.1\n",
            r"unknown key 'pitch_bias' in \[unmodelled\] \(did you mean",
        ),
        ("[unmodelled]\nscale = [1.0, -1.0]\n", r"\[unmodelled\] scale = \(1.0, -1.0\) must be positive"),
        ("[unmodelled]\nscale = [1.0]\n", r"'scale.1' in \[unmodelled\] is missing"),
        ("[sensing]\nframe_drop = 1.5\n", r"'frame_drop' in \[sensing\] is 1.5: .*less than or equal to 0.9"),
        ('[sensing]\ncamera = "big"\n', r"'camera' in \[sensing\] is 'big'"),
        ("[faults]\npedal_release = [0]\n", r"'pedal_release' in \[faults\] names trial 0; trials are numbered from 1"),
        ("[nuisance]\nradius = 1.2\n", r"radius \[m\] = 1.2 in \[nuisance\] looks like cm"),
    ],
)
def test_a_bad_table_is_named(tmp_path: Path, extra: str, message: str) -> None:
    with pytest.raises(WorldError, match=message):
        load(tmp_path, f'task = "slider"\n{PARAMS}{extra}')


def test_a_world_of_another_task_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="is a world of 'pushing', not of 'slider'"):
        load(tmp_path, f'task = "pushing"\n{PARAMS}')


@pytest.mark.parametrize(("text", "why"), [("task = ", "valid TOML"), ("\udcff", "UTF-8 text")])
def test_what_is_not_toml_is_refused(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(WorldError, match=rf"mine\.toml is not {why}"):
        load_world(str(path), TASK)


def test_a_missing_file_and_an_unknown_name(tmp_path: Path) -> None:
    with pytest.raises(UnknownName, match=re.escape(str(tmp_path / "none.toml"))):
        load_world(str(tmp_path / "none.toml"), TASK)
    with pytest.raises(UnknownName, match="no world 'nowhere' for slider; there are none"):
        load_world("nowhere", TASK)
    assert list_worlds(TASK) == ()


def test_shipped_worlds_have_a_nominal_mount_which_is_exactly_none() -> None:
    scooping = get_task("scooping")
    X_FT = scooping.require_hardware().X_FT
    assert all(load_world(name, scooping).mount == Mount() for name in list_worlds(scooping))
    np.testing.assert_array_equal(Mount().true.X_WB, np.eye(4))
    np.testing.assert_array_equal(Mount().true.X_FT(X_FT), X_FT)


def test_a_world_file_says_how_table_and_tool_are_off(tmp_path: Path) -> None:
    head = f'task = "slider"\n{PARAMS}[mount]\n'
    lines = "table_height_mm = -6.0\ntable_rise_mrad = [3.0, -2.0]\ntool_height_mm = 2.0\ntool_roll_mrad = 8.0\n"
    mount = load(tmp_path, head + lines).mount
    assert mount == Mount(-6.0, (3.0, -2.0), 2.0, 8.0)
    assert mount.true == ToolCorrection(Table(-6e-3, 3e-3, -2e-3), 2e-3, roll_rad=8e-3)
    for line, match in (("table_height_mm = 80.0", "table_height_mm"), ("tool_hight_mm = 1.0", "tool_height_mm")):
        with pytest.raises(WorldError, match=match):
            load(tmp_path, f"{head}{line}\n")
