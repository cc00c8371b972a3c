"""A touch-off of a real lab without its devices: what they are given, who confirms, what is found, who uses it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from cells import cell
from guarded_paths import GUARD, Q_TOP_RAD, TOOL, down
from real_lab import (
    RIG,
    ToyDevices,
    ToyPedal,
    Untouched,
    calibrated,
    calibration,
    quiet,
    said,
    typing,
    write_rig,
)
from touch_rig import few

from adaptsim_cli import config
from adaptsim_cli.bench import calibration_in_use as wiring_calibration
from adaptsim_cli.bench.devices.attended import PersonBeside
from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.touch_off.flow import touch_off
from adaptsim_cli.bench.touch_off.parts import TouchRig
from adaptsim_cli.bench.touch_off.store import SavedTouchOff
from adaptsim_cli.bench.touch_off_in_use import grasp_of, open_touch_rig, touch_offs
from adaptsim_cli.commands import app
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.opening import open_trials
from calib.errors import CalibrationMissing
from calib.saved import OffsetsRecord
from hw.collision import LEVEL, Table
from hw.errors import ArmFault
from hw.fake import FakeArm, FakeClock
from hw.franka.settings import Payload
from hw.grasping import FakeHand
from sim.errors import NotExecutable, UnknownName
from sim.tasks import get_task

pytestmark = pytest.mark.usefixtures("kim")
SCOOPING = get_task("scooping")
TRUE = Table(-0.004, 0.003, -0.002)
BELIEVED = "[table]\nheight_m = -0.002\n"


def resolved(place: Path, text: str = RIG + BELIEVED, task: str = "scooping") -> Resolved:
    write_rig(place, text)
    return config.load({"hw": "panda", "task": task})


@contextmanager
def opened(there: Resolved, devices: ToyDevices) -> Iterator[TouchRig]:
    calibrated(there)
    with open_touch_rig(there.config, there.places, grasp_of(there.config), devices.drivers()) as rig:
        yield rig


def asked(rig: TouchRig, screen: Screen, hand: FakeHand | None = None) -> SavedTouchOff:
    """A touch-off at few places; the person really holds the tool between the fingers of `hand`."""

    def offer(there: bool) -> None:
        rig.tool_there(there)
        if there and hand is not None:
            hand.between_m = rig.grasp.width_m

    few_places = replace(rig, plan=few(), tool_there=offer)
    return touch_off(few_places, screen, unattended=False, created="2026-01-01T00:00:00+00:00")


@pytest.mark.long
def test_a_real_lab_is_touched_off_and_its_trials_use_the_result(place, monkeypatch):
    there, devices = resolved(place), ToyDevices(hand=FakeHand(), plane=TRUE)
    typing(monkeypatch, "panda", "", "panda", "y", "panda")
    with opened(there, devices) as rig:
        assert list(devices.opened) == ["pedal", "arm", "hand"]
        assert devices.opened["hand"] == {"model": "panda", "host": "172.16.0.2", "pedal": devices.pedal}
        assert [box.name for box in devices.opened["arm"]["cell"].keep_out] == [
            "the camera",
            "the person's side (left)",
        ]
        assert devices.opened["arm"]["cell"].table == rig.empty.cell.table == Table(-0.002)
        assert devices.opened["arm"]["pedal"] is devices.pedal
        assert rig.is_real
        saved = asked(rig, quiet(), devices.hand)
    assert [payload.mass_kg for payload in devices.arm.carried] == [0.0, 0.12], "empty, then with the tool"
    assert devices.hand.commands == ["home", "move", "move", "grasp"]
    c = saved.correction()
    assert c.table.height_m == pytest.approx(TRUE.height_m, abs=5e-4)
    assert c.table.slope_x == pytest.approx(TRUE.slope_x, abs=1e-3)
    assert (c.height_m, c.pitch_rad) == (pytest.approx(0.0, abs=3e-4), pytest.approx(0.0, abs=5e-3))
    touch_offs(there.config, there.places).save(saved)
    with open_trials(there.config, there.places, SCOOPING, devices.drivers()) as real:
        assert isinstance(real.rig.attendant, PersonBeside)
        assert real.rig.attendant.mounted.correction == saved.correction(), (
            "not what the rig file says of table and tool"
        )
        assert devices.opened["arm"]["cell"].table == saved.correction().table


def test_a_guarded_motion_is_confirmed_and_waits_for_the_pedal_too(monkeypatch):
    bare, clock, screen = FakeArm(Q_TOP_RAD, FakeClock(), cell(tool=TOOL), plane=LEVEL), FakeClock(), quiet()
    pedal = ToyPedal([False, True]).__enter__()
    arm = ConfirmedArm(bare, Consent(screen, "panda", "empty", "Kim"), pedal, now_s=clock.now_s, pause=clock.sleep)
    with arm:
        typing(monkeypatch, "q")
        with pytest.raises(StoppedByOperator):
            arm.execute_until_contact(down(), GUARD)
        typing(monkeypatch, "panda")
        contact = arm.execute_until_contact(down(), GUARD)
        arm.carry(TOOL, Payload(0.3))
    assert contact.force_N >= GUARD.force_N
    assert "nobody within its reach, empty, a hand on" in said(screen)
    assert "Hold the pedal" in said(screen)
    assert [payload.mass_kg for payload in bare.carried] == [0.3]


def test_after_hands_were_at_the_gripper_nothing_moves_unasked(place, monkeypatch):
    """The rig file says `consent = "command"`: the model is typed for each series, and a key for each grasp."""
    there, devices, screen = resolved(place), ToyDevices(hand=FakeHand(), plane=TRUE), quiet()
    typing(monkeypatch, "panda", "", "", "no", "q")
    with opened(there, devices) as rig, pytest.raises(StoppedByOperator):
        asked(rig, screen, devices.hand)
    assert devices.hand.commands == ["home", "move"]
    assert devices.arm.executed == []
    assert "Enter when it is empty, q to stop" in said(screen)

    devices, screen = ToyDevices(hand=FakeHand(), plane=TRUE), quiet()
    typing(monkeypatch, "panda", "", "panda", "", "y", "", "q")
    with opened(there, devices) as rig:
        with pytest.raises(StoppedByOperator):
            asked(rig, screen, devices.hand)
        assert devices.hand.commands[-1] == "grasp"
        assert rig.arm.state().q_rad == pytest.approx(rig.home_rad), "where the tool was handed over"


def test_the_joint_zeros_of_the_calibration_are_used(place):
    there, devices = resolved(place), ToyDevices(hand=FakeHand())
    zeros_rad = (0.0, 1e-3, 0.0, -2e-3, 0.0, 0.0, 0.0)
    offsets = OffsetsRecord(
        adopted=True, reason="", offsets_rad=zeros_rad, suspected_rad=zeros_rad, sigma_rad=(None,) * 7
    )
    known = calibration().model_copy(update={"joint_offsets": offsets})
    wiring_calibration.calibrations(there.config, there.places).save(known, b"")
    with open_touch_rig(there.config, there.places, grasp_of(there.config), devices.drivers()) as rig:
        for cell in (rig.empty.cell, rig.loaded.cell, devices.opened["arm"]["cell"]):
            assert tuple(cell.arm.zeros_rad) == zeros_rad


def test_a_fault_is_cleared_on_a_word_or_stays(place, monkeypatch):
    there, devices = resolved(place), ToyDevices(hand=FakeHand(), plane=TRUE)
    faulty = devices.drivers_of_a_stopped_arm()
    calibrated(there)
    for answer, fault in (("", "cartesian_reflex"), ("recover", None)):
        typing(monkeypatch, answer, "panda", "", "panda")
        with open_touch_rig(there.config, there.places, grasp_of(there.config), faulty) as rig:
            assert rig.arm.state().fault == fault
            if fault:
                with pytest.raises(ArmFault, match="recover"):
                    asked(rig, quiet())


def test_what_is_refused_before_any_device_is_touched(place):
    def refused(there: Resolved, kind: type[Exception], match: str) -> None:
        with (
            pytest.raises(kind, match=match),
            open_touch_rig(there.config, there.places, grasp_of(there.config), Untouched()),  # type: ignore[arg-type]
        ):
            pass

    refused(resolved(place), CalibrationMissing, "adaptsim calibrate --hw panda")
    calibrated(resolved(place))
    pusher = RIG + "[tools.pushing.payload]\nmass_kg = 0.15\n"
    refused(resolved(place, pusher, task="pushing"), UnknownName, "no corners to touch")
    refused(resolved(place, RIG + "[table]\nx_m = [0.3, 0.6]\n"), NotExecutable, r"outside of the work area.*\[table\]")


def test_nothing_moves_unless_the_model_is_typed(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there, devices = resolved(place), ToyDevices(hand=FakeHand(), plane=TRUE)
    typing(monkeypatch, "clear", "q")
    with opened(there, devices) as rig, pytest.raises(StoppedByOperator, match="nothing has moved"):
        asked(rig, quiet())
    assert devices.arm is not None
    assert devices.arm.executed == []
    assert devices.hand.commands == []


def test_the_command_refuses_yes_and_names_a_missing_driver(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    calibrated(resolved(place))
    monkeypatch.setattr("adaptsim_cli.bench.devices.lab.makers_drivers", Untouched)
    assert app.run(["touch-off", "--hw", "panda", "--yes"]) == 2
    assert "--yes never confirms the motion of a real arm" in capfd.readouterr().err
    for lacking in ("arm", "hand", "pedal"):
        devices = ToyDevices(hand=FakeHand(), lacking=lacking)
        monkeypatch.setattr("adaptsim_cli.bench.devices.lab.makers_drivers", devices.drivers)
        assert app.run(["touch-off", "--hw", "panda", "--automatic"]) == 3
        assert f"pip install {lacking}-driver==1.0" in capfd.readouterr().err
        assert devices.arm is None or not devices.arm.executed
    assert not list(place.glob("**/touch-off.json"))
