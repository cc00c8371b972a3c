"""The rig file: what it may say, what it is told when it is wrong, and that what is written can be read."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from real_lab import RIG, write_rig

from adaptsim_cli import config
from adaptsim_cli.bench.devices.mounted import mounted_task_of
from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.bench.rig_file.reading import described, flat, read, rig_of
from adaptsim_cli.bench.rig_file.template import template
from adaptsim_cli.errors import UsageError
from hw.camera.k4a_device import ColourSettings
from hw.franka.settings import FrankaSettings
from hw.kinematics import forward
from hw.serial.balance import PROTOCOLS
from sim.tasks import get_task

ARM = {"model": "fr3", "address": "172.16.0.2"}
LEAST: dict[str, Any] = {"name": "lab", "arm": ARM}
TASKS = ("scooping", "pushing")
DOCS = Path(__file__).parents[4] / "docs" / "guide" / "rig.md"


def test_two_keys_are_enough_and_the_rest_is_what_the_adapters_have():
    rig = described(LEAST, "rig.toml")
    settings, usual = rig.arm.settings(), FrankaSettings("172.16.0.2")
    np.testing.assert_array_equal(settings.joint_impedance_Nm_rad, usual.joint_impedance_Nm_rad)
    np.testing.assert_array_equal(settings.collision.force_collision_N, usual.collision.force_collision_N)
    assert settings.host == usual.host
    assert rig.camera.settings() == ColourSettings()
    assert rig.boxes() == ()
    assert rig.table.plane().height_m == 0.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"arm": {**ARM, "model": "ur5"}}, "arm.model = \"ur5\": it must be one of 'panda', 'fr3' or 'fr3v2'"),
        ({"arm": {"model": "fr3"}}, "arm.address is missing (network address"),
        ({"arm": {**ARM, "address": "https://arm"}}, "give only the name or IP address"),
        ({"arm": {**ARM, "joint_impedance_Nm_rad": [1, 2]}}, "arm.joint_impedance_Nm_rad has 2 values, more belong"),
        ({"arm": {**ARM, "joint_impedance_Nm_rad": [0] * 7}}, "every value must be above 0 and at most 14250"),
        ({"arm": {**ARM, "collision": {"force_collision_N": [1] * 6}}}, "is above collision"),
        ({"name": "lab 1"}, "only letters, digits, dots, - and _"),
        ({"kamera": {}}, "unknown key 'kamera', did you mean 'camera'? Known keys: name, arm, table"),
        ({"camera": {"exposure_us": 100}}, "camera.exposure_us = 100 µs: it must be at least 500"),
        ({"camera": {"exposure_us": 0.5}}, "camera.exposure_us = 0.5 µs: it must be a whole number"),
        ({"camera": {"white_balance_K": 4501}}, "camera.white_balance_K = 4501 K: it must be a multiple of 10"),
        ({"camera": {"serial": 12}}, "camera.serial = 12: it must be a text in quotes"),
        ({"camera": 3}, "camera = 3: it must be a table"),
        ({"table": {"height_m": 0.7}}, "table.height_m = 0.7 m: it must be at most 0.05"),
        ({"table": {"x_m": [1, 0]}}, "x_m = [1, 0] m: the first must be less than the second"),
        ({"table": {"slope_x": float("nan")}}, "table.slope_x = NaN: it must be a finite number"),
        ({"balance": {"port": "a"}, "pedal": {"port": "a"}}, "pedal and balance share the port 'a'"),
        ({"tools": {"scoping": {}}}, "unknown key 'tools.scoping', did you mean 'scooping'? Tools: scooping, pushing"),
        ({"tools": {"scooping": {"X_FT": [[1, 0, 0, 0]] * 4}}}, "X_FT: not a pose"),
        ({"keep_out": [{"name": "a", "low_m": [0, 0, 0], "high_m": [1, 1, 0]}]}, "keep-out box a: the lower corner"),
        ({"keep_out": [{"name": "a", "low_m": [0, 0, 0], "high_m": [1, 1, 1]}] * 2}, "two boxes are called 'a'"),
        ({"keep_out": [{"name": "a", "low": [0, 0, 0]}]}, "unknown key 'keep_out[0].low', did you mean 'low_m'?"),
    ],
)
def test_what_is_wrong_is_named_with_key_value_and_limit(wrong, message):
    with pytest.raises(UsageError, match=re.escape(message)) as caught:
        described(LEAST | wrong, "rig.toml", TASKS)
    assert str(caught.value).startswith("rig.toml: ")


def test_what_is_no_toml_or_not_there_is_said(tmp_path):
    with pytest.raises(UsageError, match="TOML"):
        read(write_rig(tmp_path, "name = "))
    with pytest.raises(UsageError, match=r"no rig file.*adaptsim setup"):
        read(tmp_path / "none.toml")


def test_a_template_reads_as_what_it_was_made_of():
    for text in (RIG, 'name = "lab"\n[arm]\nmodel = "fr3"\naddress = "a.b"\n'):
        rig = described(tomllib.loads(text), "here")
        assert described(tomllib.loads(template(rig, TASKS)), "there", TASKS) == rig


def test_everything_that_a_template_offers_as_a_comment_is_valid():
    written = template(described(LEAST, "here"), TASKS)
    lines = [line[1:] if re.match(r"#[\[A-Za-z]", line) else line for line in written.splitlines()]
    rig = described(tomllib.loads("\n".join(lines)), "there", TASKS)
    assert rig.pedal is not None and rig.balance is not None and rig.person is not None
    assert set(rig.tools) == set(TASKS)
    assert [box.name for box in rig.boxes()] == ["the person's side (left)", "lamp"]


def test_the_balances_that_a_file_may_name_are_those_that_are_spoken():
    for protocol in PROTOCOLS:
        described(LEAST | {"balance": {"port": "/dev/a", "protocol": protocol}}, "rig.toml")


@pytest.mark.long
def test_a_touched_off_tool_hangs_where_it_was_measured():
    task = get_task("scooping")
    part = {"height_m": 0.003, "forward_m": -0.001, "pitch_rad": 0.1}
    table = {"height_m": -0.004, "slope_x": 0.01}
    rig, zeros_rad = described(LEAST | {"tools": {"scooping": part}, "table": table}, "here"), np.full(7, 0.001)
    there = mounted_task_of(task, rig, zeros_rad)
    off = np.linalg.inv(task.require_hardware().X_FT) @ there.hardware.X_FT
    np.testing.assert_allclose(off[:3, 3], [-0.001, 0.0, 0.003], atol=1e-12)
    assert (off @ [1.0, 0.0, 0.0, 0.0])[2] == pytest.approx(-np.sin(0.1)), "the edge points further down"
    motion = there.hardware.plan(task.reference_context, task.action.denormalise(np.full(3, 0.5)))
    planner = there.planner()
    reported = planner.paths(motion)[1]
    tool_in_base = forward(reported.q_rad[0] + zeros_rad) @ there.hardware.X_FT
    height_m = motion.X_BT[0, 2, 3] - 0.004 + 0.01 * tool_in_base[0, 3]
    assert tool_in_base[2, 3] == pytest.approx(height_m, abs=1e-4), "over the table as it is"
    np.testing.assert_allclose(planner.flange(reported.q_rad[0]) @ there.hardware.X_FT, motion.X_BT[0], atol=1e-6)


def load(tmp_path: Path, **flags: object) -> config.Resolved:
    return config.load(flags, {"ADAPTSIM_HOME": str(tmp_path / "home")}, tmp_path / "project")


def test_the_file_is_found_beside_the_settings_or_where_they_say(tmp_path):
    for folder in ("home", "project", "project/labs"):
        (tmp_path / folder).mkdir()
    assert load(tmp_path).config.rig == ""
    user = write_rig(tmp_path / "home")
    assert load(tmp_path).config.rig == str(user)
    project = write_rig(tmp_path / "project")
    assert load(tmp_path).config.rig == str(project)
    other = write_rig(tmp_path / "project/labs")
    (tmp_path / "project/adaptsim.toml").write_text('rig = "labs/rig.toml"\n')
    assert load(tmp_path).config.rig == str(other)
    assert load(tmp_path, rig="elsewhere.toml").config.rig == str(Path.cwd() / "elsewhere.toml")


def test_a_real_arm_needs_the_rig_file_of_its_own_model(tmp_path):
    (tmp_path / "project").mkdir()
    with pytest.raises(UsageError, match=r"there is no rig file.*adaptsim setup --hw fr3"):
        rig_of(load(tmp_path, hw="fr3").config)
    write_rig(tmp_path / "home")
    assert rig_of(load(tmp_path, hw="panda").config).name == "lab-1"
    with pytest.raises(UsageError, match=r"belongs to a lab with arm.model = 'panda'"):
        rig_of(load(tmp_path, hw="fr3").config)


def test_the_file_is_shown_key_by_key():
    shown = dict(flat({"name": "lab", "arm": {"model": "fr3"}, "pedal": None, "keep_out": [{"name": "lamp"}]}))
    assert shown == {"name": "lab", "arm.model": "fr3", "keep_out.name": "lamp"}


def test_the_example_of_the_documentation_is_a_rig_file():
    (block,) = re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    rig = described(tomllib.loads(block), "docs/guide/rig.md", TASKS)
    assert isinstance(rig, RigDescription)
    assert rig.pedal is not None and rig.balance is not None and rig.keep_out and rig.tools
    known = {line.split(" = ")[0].lstrip("#") for line in template(rig, TASKS).splitlines() if " = " in line}
    assert {key for key in known if not key.startswith(" ")} <= set(re.findall(r"^#?(\w+) = ", block, re.MULTILINE))
