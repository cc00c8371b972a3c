"""A touch-off: what it finds, what it refuses, what it keeps."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from real_lab import quiet, said, typing
from touch_rig import MOUNT, PITCH_RAD, on_lab, world
from typer.testing import CliRunner

from adaptsim_cli import config
from adaptsim_cli.bench.touch_off import flow
from adaptsim_cli.bench.touch_off.parts import TouchOffFailed, TouchRig
from adaptsim_cli.bench.touch_off.solving import Result, Touched, solve
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.bench.touch_off_in_use import grasp_of, open_touch_rig, touch_off_of, touch_offs
from adaptsim_cli.commands.app import app
from adaptsim_cli.errors import PreflightFailed, SessionError, StoppedByOperator, UsageError
from adaptsim_cli.screen.console import Screen
from hw.collision import KeepOut, Table
from hw.errors import StoppedByPedal
from hw.types import Array
from sim.errors import UnknownName
from sim.lab.world import Faults, Mount
from sim.panda.model import inverse
from sim.panda.tool import ToolCorrection, touchable
from sim.panda.touching import Probe, table_probes, tool_probes
from sim.tasks import get_task
from sim.tasks.scooping import HARDWARE

TRUE = ToolCorrection(Table(-0.007, 0.004, -0.003), 0.003, -0.0025, 0.05, -0.012)
CENTRE_M = np.array(touchable(HARDWARE).centre_m)


def touches(
    probes: Sequence[Probe], designed: Array, true_X_FT: Array, rng: np.random.Generator, std_m: float
) -> list[Touched]:
    """Where the arm would be: held as planned, lowered until the true feeler is on the true table, twice a place."""
    made = []
    for probe in probes:
        X_BF = probe.X_BT(Table(), 0.02) @ np.linalg.inv(designed)
        lowest = (X_BF @ true_X_FT @ np.append(probe.feeler.p_T_m, 1.0))[:3] - [0.0, 0.0, probe.feeler.radius_m]
        for _ in range(2):
            X = X_BF.copy()
            X[2, 3] -= lowest[2] - TRUE.table.height_at(lowest) + std_m * rng.standard_normal()
            q = inverse(X, np.linspace(-2.5, 2.5, 101)).reshape(-1, 7)
            made.append(Touched(probe, q[np.isfinite(q).all(axis=1)][0]))
    return made


def touch_off(rig: TouchRig, out: Screen | None = None, *, unattended: bool = True) -> SavedTouchOff:
    return flow.touch_off(rig, out or quiet(), unattended=unattended, created="2026-01-01T00:00:00+00:00")


def solved(seed: int, std_m: float) -> tuple[Result, tuple[str, ...]]:
    rng = np.random.default_rng(seed)
    fingers = touches(table_probes(CENTRE_M), np.eye(4), np.eye(4), rng, std_m)
    tool = touches(
        tool_probes(touchable(HARDWARE).feelers, CENTRE_M), HARDWARE.X_FT, TRUE.X_FT(HARDWARE.X_FT), rng, std_m
    )
    return solve(fingers, tool, HARDWARE.X_FT, CENTRE_M)


def test_perfect_touches_give_everything_back():
    found, problems = solved(0, 0.0)
    assert problems == ()
    for name in ("height_m", "forward_m", "pitch_rad", "roll_rad"):
        assert getattr(found, f"tool_{name}").value == pytest.approx(getattr(TRUE, name), abs=1e-6)
    assert found.table_origin_m == pytest.approx(TRUE.table.height_m, abs=1e-9)
    assert found.table_height_m.value == pytest.approx(float(TRUE.table.height_at(CENTRE_M)), abs=1e-9)


def test_the_stated_intervals_hold():
    """With the arm's repeatability: each of six quantities within its interval 19 times of 20, and small enough."""
    inside: list[bool] = []
    for seed in range(40):
        found, _ = solved(seed, 1e-4)
        pairs = (
            (found.table_height_m, float(TRUE.table.height_at(CENTRE_M))),
            (found.tilt_x, TRUE.table.slope_x),
            (found.tool_height_m, TRUE.height_m),
            (found.tool_forward_m, TRUE.forward_m),
            (found.tool_pitch_rad, TRUE.pitch_rad),
            (found.tool_roll_rad, TRUE.roll_rad),
        )
        inside += [abs(measured.value - true) <= measured.within for measured, true in pairs]
        assert found.tool_height_m.within < 5e-4
        assert found.tool_pitch_rad.within < np.deg2rad(0.3)
    assert 0.90 < np.mean(inside) <= 1.0


def test_what_does_not_fit_together_is_a_problem():
    rng = np.random.default_rng(0)
    probes = tool_probes(touchable(HARDWARE).feelers, CENTRE_M)
    fingers = touches(table_probes(CENTRE_M), np.eye(4), np.eye(4), rng, 1e-4)
    steep = replace(TRUE, pitch_rad=0.12)
    _, problems = solve(
        fingers, touches(probes, HARDWARE.X_FT, steep.X_FT(HARDWARE.X_FT), rng, 1e-4), HARDWARE.X_FT, CENTRE_M
    )
    assert any("pitch" in problem for problem in problems)
    lifted = np.eye(4)
    lifted[2, 3] = -0.006  # something 6 mm thick lies under one place: the finger is held up
    crumb = touches(table_probes(CENTRE_M)[4:], np.eye(4), lifted, rng, 1e-4)
    tool = touches(probes, HARDWARE.X_FT, TRUE.X_FT(HARDWARE.X_FT), rng, 1e-4)
    _, problems = solve([*fingers[:8], *crumb], tool, HARDWARE.X_FT, CENTRE_M)
    assert any("table place" in problem and "nothing lies there" in problem for problem in problems)
    with pytest.raises(ValueError, match="3 places"):
        solve(fingers[:4], tool, HARDWARE.X_FT, CENTRE_M)


@pytest.fixture
def resolved(tmp_path) -> config.Resolved:
    return config.load({"task": "scooping", "world": "wd"}, {"ADAPTSIM_HOME": str(tmp_path)}, tmp_path)


def latest(resolved: config.Resolved, zeros_rad: Array) -> SavedTouchOff | None:
    return touch_off_of(resolved.config, resolved.places, get_task("scooping"), zeros_rad)


@pytest.mark.long
def test_on_the_lab_it_finds_what_is_hidden_and_keeps_it(resolved):
    with on_lab(world()) as (rig, lab):
        saved = touch_off(rig)
        truth = lab.truth()
    c = saved.correction()
    height_m, slope_x, slope_y = truth["table"]
    table_m = height_m + slope_x * CENTRE_M[0] + slope_y * CENTRE_M[1]
    assert saved.table_height_m.value == pytest.approx(table_m, abs=5e-4)
    assert c.height_m == pytest.approx(1e-3 * MOUNT.tool_height_mm, abs=7e-4)
    assert c.pitch_rad == pytest.approx(PITCH_RAD, abs=np.deg2rad(0.4))
    assert c.roll_rad == pytest.approx(1e-3 * MOUNT.tool_roll_mrad, abs=np.deg2rad(0.4))
    assert abs(saved.slip.moved_m) <= flow.SLIPPED_M

    store = touch_offs(resolved.config, resolved.places)
    zeros_rad = np.array(saved.joint_zeros_rad)
    assert latest(resolved, zeros_rad) is None
    first, second = store.save(saved), store.save(saved)
    assert (first.name, second.name) == ("touch-off-0001", "touch-off-0002")
    assert store.current() == saved
    assert latest(resolved, zeros_rad + 5e-5) == saved
    with pytest.raises(PreflightFailed, match=r"joint 2 is 1\.00 mrad off .*Touch off again"):
        touch_off_of(
            resolved.config,
            resolved.places,
            get_task("scooping"),
            zeros_rad + np.array([0.0, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]),
        )
    (second / "touch-off.json").write_text("{")
    with pytest.raises(SessionError, match=r"touch-off-0002.*remove it with its images.*touch-off restore"):
        store.current()


def test_a_missing_table_and_a_forgotten_book_are_named():
    with on_lab(world(Mount(table_height_mm=-45.0))) as (rig, _), pytest.raises(TouchOffFailed, match="nothing was"):
        touch_off(rig)
    book = KeepOut("book", np.array([0.5, -0.25, 0.0]), np.array([0.62, -0.07, 0.018]))
    with (
        on_lab(world(Mount()), (book,)) as (rig, _),
        pytest.raises(TouchOffFailed, match="Clear away anything"),
    ):
        touch_off(rig)


def test_a_released_pedal_stops_it():
    with on_lab(world(faults=Faults(pedal_release=(2,)))) as (rig, _), pytest.raises(StoppedByPedal):
        touch_off(rig)


def test_a_tool_that_nobody_holds_is_not_grasped():
    with on_lab(world()) as (rig, _):
        rig.hand.home()
        with pytest.raises(TouchOffFailed, match="does not hold the tool"):
            flow.take_tool(replace(rig, tool_there=lambda there: None))


@pytest.mark.slow
def test_a_weak_grip_is_found_out():
    weak = world(replace(MOUNT, grip_Nm_per_N=0.04))
    with on_lab(weak) as (rig, _), pytest.raises(TouchOffFailed, match="slipped: pressed with 15 N"):
        touch_off(rig)


def test_a_real_arm_is_never_confirmed_by_nobody():
    with on_lab(world()) as (lab_rig, _), pytest.raises(UsageError, match="never confirms"):
        touch_off(replace(lab_rig, name="panda"))


@pytest.mark.parametrize(
    ("typed", "fingers", "arm"),
    [
        ([""] * 9, False, False),
        (["panda", *[""] * 9], False, False),
        (["panda", "", "y", *[""] * 9], True, False),
        (["panda", "", "y", "y", "y", *[""] * 9], True, True),
    ],
)
def test_whoever_stands_beside_the_simulated_arm_is_asked_as_beside_a_real_one(typed, fingers, arm, monkeypatch):
    """Enter alone moves neither fingers nor arm; `y` releases one motion, and the model all that follow it."""
    out, settings = quiet(), config.load({"task": "scooping", "world": "wd"})
    typing(monkeypatch, *typed)
    with open_touch_rig(settings.config, settings.places, grasp_of(settings.config), screen=out) as rig:
        before_rad = rig.arm.state().q_rad
        with pytest.raises(StoppedByOperator):
            touch_off(rig, out, unattended=False)
        assert rig.hand.state().homed == fingers
        assert np.array_equal(rig.arm.state().q_rad, before_rad) == (not arm)
    assert ("Type panda to let it move" in said(out)) == arm, "after the first motion was watched"


def test_what_the_command_refuses_at_once(tmp_path):
    runner = CliRunner()
    cases = (
        (["--hw", "panda", "--yes"], (UsageError,)),
        (["--task", "pushing", "--world", "wd", "--yes"], (UnknownName,)),
        (["--world", "wd"], (UsageError,)),  # no terminal to confirm at
    )
    for arguments, kinds in cases:
        result = runner.invoke(app, ["touch-off", *arguments])
        assert isinstance(result.exception, kinds), arguments
    assert not list(tmp_path.glob("**/touch-off.json"))


@pytest.mark.slow
def test_the_command_prints_one_object_and_stores_it():
    result = CliRunner().invoke(app, ["touch-off", "--world", "steep-mount", "--seed", "0", "--yes", "--json"])
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    assert (Path(told["folder"]) / "touch-off.json").is_file()
    assert 0.0 < told["tool_pitch_deg"]["within_95"] < 0.5
    assert told["touches"] == 26
    assert "truth" not in result.stdout
