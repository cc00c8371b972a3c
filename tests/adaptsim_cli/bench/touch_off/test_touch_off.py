"""The command `adaptsim touch-off`: what it asks and stores in the simulated lab, what it refuses, what it reads."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from real_lab import quiet, said, typing
from touch_rig import HARDWARE
from typer.testing import CliRunner

from adaptsim_cli import config
from adaptsim_cli.bench.touch_off import guiding
from adaptsim_cli.bench.touch_off.store import SavedTouchOff, TouchOffStore
from adaptsim_cli.bench.touch_off_in_use import grasp_of, open_guided_rig, touch_off_of, touch_offs
from adaptsim_cli.commands.app import app
from adaptsim_cli.errors import PreflightFailed, SessionError, StoppedByOperator, UsageError
from sim.errors import UnknownName
from sim.panda.setting_down import set_downs
from sim.panda.tool import touchable
from sim.tasks import get_task

PLACES = set_downs(touchable(HARDWARE).feelers, touchable(HARDWARE).centre_m)
WORLD = ("--task", "scooping", "--world", "steep-mount", "--seed", "0")


@pytest.fixture
def resolved(tmp_path: Path) -> config.Resolved:
    return config.load({"task": "scooping", "world": "steep-mount"}, {"ADAPTSIM_HOME": str(tmp_path)}, tmp_path)


def saved(resolved: config.Resolved) -> SavedTouchOff:
    with open_guided_rig(resolved.config, resolved.places, grasp_of(resolved.config)) as rig:
        return guiding.touch_off(rig, quiet(), unattended=True, created="2026-01-01T00:00:00+00:00")


def test_the_latest_counts_with_the_joint_zeros_that_it_was_made_with(resolved: config.Resolved) -> None:
    record, store = saved(resolved), touch_offs(resolved.config, resolved.places)
    zeros_rad, task = np.array(record.joint_zeros_rad), get_task("scooping")
    assert touch_off_of(resolved.config, resolved.places, task, zeros_rad) is None
    first, second = store.save(record), store.save(record)
    assert (first.name, second.name) == ("touch-off-0001", "touch-off-0002")
    assert store.current() == record
    assert touch_off_of(resolved.config, resolved.places, task, zeros_rad + 5e-5) == record
    with pytest.raises(PreflightFailed, match=r"joint 2 is 1\.00 mrad off .*Touch off again"):
        touch_off_of(resolved.config, resolved.places, task, zeros_rad + 1e-3 * np.eye(7)[1])
    (second / "touch-off.json").write_text("{")
    with pytest.raises(SessionError, match=r"touch-off-0002.*remove it with its images.*touch-off restore"):
        store.current()


def test_one_that_the_arm_felt_for_by_itself_is_still_read_bit_for_bit(
    resolved: config.Resolved, tmp_path: Path
) -> None:
    """Earlier versions felt for the table, repeated each touch, and pressed the tool to see whether it slips."""
    table = json.loads(saved(resolved).content())
    table |= {"repeat_m": 4e-5, "slip": {"moved_m": 1e-4, "pressed_N": 15.0, "grasp_force_N": 40.0}}
    content = (json.dumps(table, indent=1) + "\n").encode()
    folder = tmp_path / "touch-offs" / "touch-off-0001"
    folder.mkdir(parents=True)
    (folder / "touch-off.json").write_bytes(content)
    record = TouchOffStore(folder.parent).current()
    assert record is not None
    assert record.content() == content, "so a session that names its hash goes on"
    assert record.correction() == saved(resolved).correction()


@pytest.mark.parametrize(
    ("typed", "commands"),
    [
        ([""] * 9, []),
        (["panda", *[""] * 9], []),
        (["y", "y", *[""] * 9], []),
        (["panda", "y", *[""] * 9], ["home"]),
        (["panda", "y", "y", *[""] * 9], ["home", "move"]),
        (["panda", "y", "y", "y", *[""] * 3], ["home", "move", "grasp"]),
    ],
)
def test_whoever_stands_beside_the_simulated_hand_is_asked_as_beside_a_real_one(
    typed: list[str], commands: list[str], monkeypatch: pytest.MonkeyPatch, resolved: config.Resolved
) -> None:
    """Enter alone does not move the fingers; `y` releases one of their motions."""
    screen = quiet()
    with open_guided_rig(resolved.config, resolved.places, grasp_of(resolved.config), screen=screen) as rig:
        assert rig.holding is not None
        typing(monkeypatch, "", *typed)
        with pytest.raises(StoppedByOperator):
            guiding.touch_off(rig, screen, unattended=False, created="")
        assert rig.holding.hand._hand.commands == commands  # type: ignore[attr-defined]
    assert ("Place 1 of 7" in said(screen)) == ("grasp" in commands)


def test_what_the_command_refuses_at_once(tmp_path: Path) -> None:
    for arguments, kind in (
        (["--task", "pushing", "--world", "wd", "--yes"], UnknownName),
        (["--world", "wd"], UsageError),  # no terminal to confirm at
    ):
        result = CliRunner().invoke(app, ["touch-off", *arguments])
        assert isinstance(result.exception, kind), arguments
    assert not list(tmp_path.glob("**/touch-off.json"))


def test_the_command_prints_one_object_and_stores_it() -> None:
    result = CliRunner().invoke(app, ["touch-off", *WORLD, "--yes", "--json"])
    assert result.exit_code == 0, result.stderr
    data = json.loads(result.stdout)
    assert (Path(data["folder"]) / "touch-off.json").is_file()
    assert 0.0 < data["tool_pitch_deg"]["within_95"] < 2.5
    assert data["touches"] == 5 + 2 * len(PLACES)
    assert "truth" not in result.stdout
