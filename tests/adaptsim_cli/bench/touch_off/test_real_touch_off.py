"""A touch-off of a real lab without its devices: what they are given, who confirms, what is found, who uses it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from real_lab import (
    HANDLE_M,
    RIG,
    ToyDevices,
    Untouched,
    calibrated,
    calibration,
    quiet,
    said,
    typing,
    waivers,
    write_rig,
)
from touch_rig import CREATED, Guided, plain, shown, world

from adaptsim_cli import config
from adaptsim_cli.bench import calibration_in_use
from adaptsim_cli.bench.devices.attended import PersonBeside
from adaptsim_cli.bench.touch_off import guiding
from adaptsim_cli.bench.touch_off.parts import GuidedTouchRig
from adaptsim_cli.bench.touch_off_in_use import grasp_of, open_guided_rig, touch_offs
from adaptsim_cli.commands import app
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.opening import open_trials
from calib.errors import CalibrationMissing
from calib.saved import OffsetsRecord
from hw.collision import Table
from hw.grasping import FakeHand
from sim.errors import NotExecutable, UnknownName
from sim.tasks import get_task

pytestmark = pytest.mark.usefixtures("kim")
SCOOPING = get_task("scooping")
BELIEVED = "[table]\nheight_m = -0.002\n"


def resolved(place: Path, text: str = RIG + BELIEVED, task: str = "scooping") -> Resolved:
    write_rig(place.parent / "home", text)
    return config.load({"hw": "panda", "task": task})


@contextmanager
def opened(there: Resolved, devices: ToyDevices, screen: Screen | None = None) -> Iterator[GuidedTouchRig]:
    calibrated(there)
    grasp = grasp_of(there.config)
    with open_guided_rig(there.config, there.places, grasp, devices.drivers(), screen or quiet()) as rig:
        yield replace(rig, pause=lambda _: None)


@pytest.mark.parametrize("text", [RIG + BELIEVED, RIG + BELIEVED + waivers("hand")], ids=["held", "screwed on"])
def test_a_real_lab_is_touched_off_and_its_trials_use_the_result(
    place: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    there, devices, screen = resolved(place, text), ToyDevices(), quiet()
    with opened(there, devices, screen) as rig:
        held = rig.holding is not None
        assert list(devices.opened) == (["pedal", "arm", "hand"] if held else ["pedal", "arm"])
        assert held == ("waives" not in text and "hand" in devices.opened)
        names = [box.name for box in devices.opened["arm"]["cell"].keep_out]
        assert names == ["the camera", "the person's side (left)"]
        assert devices.opened["arm"]["cell"].table == rig.table == Table(-0.002)
        assert devices.opened["arm"]["pedal"] is devices.pedal
        Guided(monkeypatch, devices.arm, plain(shown(world())))
        saved = guiding.touch_off(rig, screen, unattended=False, created=CREATED)
        assert devices.arm.executed == [], "the arm is guided by hand alone"
    assert devices.hand.commands == [], "it held the tool"
    assert (saved.hw, saved.tool) == ("panda", "scooping tool")
    touch_offs(there.config, there.places).save(saved)
    with open_trials(there.config, there.places, SCOOPING, devices.drivers()) as real:
        assert isinstance(real.rig.attendant, PersonBeside)
        assert real.rig.attendant.mounted_task.correction == saved.correction(), "not the rig file's table and tool"
        assert devices.opened["arm"]["cell"].table == saved.correction().table


def test_an_empty_hand_takes_the_tool_and_no_finger_moves_unasked(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there = resolved(place)
    for answers, commands in (
        (("clear", "q"), []),
        (("", "no", "q"), []),
        (("", "panda", "", "no", "q"), ["home", "move"]),  # the rig file says `consent = "command"`
    ):
        devices, screen = ToyDevices(hand=FakeHand()), quiet()
        typing(monkeypatch, *answers)
        with opened(there, devices, screen) as rig, pytest.raises(StoppedByOperator):
            guiding.touch_off(rig, screen, unattended=False, created=CREATED)
        assert devices.hand.commands == commands, answers
        assert devices.arm.executed == []
    assert "the hand closes with 40 N" in said(screen)


def test_a_hand_that_takes_the_tool_holds_it_then(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there, devices, screen = resolved(place), ToyDevices(hand=FakeHand()), quiet()
    with opened(there, devices, screen) as rig:
        guided = Guided(monkeypatch, devices.arm, plain(shown(world())))
        first = iter(["", "panda", "y"])

        def answer() -> str:
            text = next(first, None)
            if text is None:
                return guided.answer()
            if devices.hand.commands[-1:] == ["move"]:
                devices.hand.between_m = HANDLE_M
            return f"{text}\n"

        monkeypatch.setattr("adaptsim_cli.screen.console.read_line", answer)
        saved = guiding.touch_off(rig, screen, unattended=False, created=CREATED)
    assert devices.hand.commands == ["home", "move", "grasp"]
    assert devices.hand.force_N == 40.0
    assert saved.touches


def test_the_joint_zeros_of_the_calibration_are_used(place: Path) -> None:
    there, devices = resolved(place), ToyDevices()
    zeros_rad = (0.0, 1e-3, 0.0, -2e-3, 0.0, 0.0, 0.0)
    offsets = OffsetsRecord(
        adopted=True, reason="", offsets_rad=zeros_rad, suspected_rad=zeros_rad, sigma_rad=(None,) * 7
    )
    known = calibration().model_copy(update={"joint_offsets": offsets})
    calibration_in_use.calibrations(there.config, there.places).save(known, b"")
    grasp = grasp_of(there.config)
    with open_guided_rig(there.config, there.places, grasp, devices.drivers(), quiet()) as rig:
        for arm in (rig.model, devices.opened["arm"]["cell"].arm):
            assert tuple(arm.zeros_rad) == zeros_rad


def test_what_is_refused_before_any_device_is_touched(place: Path) -> None:
    def refused(there: Resolved, kind: type[Exception], match: str) -> None:
        with (
            pytest.raises(kind, match=match),
            open_guided_rig(there.config, there.places, grasp_of(there.config), Untouched()),  # type: ignore[arg-type]
        ):
            pass

    refused(resolved(place), CalibrationMissing, "adaptsim calibrate --hw panda")
    calibrated(resolved(place))
    pusher = RIG + "[tools.pushing.payload]\nmass_kg = 0.15\n"
    refused(resolved(place, pusher, task="pushing"), UnknownName, "no corners to touch")
    refused(resolved(place, RIG + "[table]\nx_m = [0.3, 0.6]\n"), NotExecutable, r"outside of the work area.*\[table\]")


def test_the_command_names_a_missing_driver(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    calibrated(resolved(place))
    monkeypatch.setattr("adaptsim_cli.screen.console.require_terminal", lambda *said: None)
    for lacking in ("arm", "hand", "pedal"):
        devices = ToyDevices(hand=FakeHand(), lacking=lacking)
        monkeypatch.setattr("adaptsim_cli.bench.devices.drivers.makers_drivers", devices.drivers)
        typing(monkeypatch, "q")
        assert app.run(["touch-off", "--hw", "panda"]) == 3
        assert f"pip install {lacking}-driver==1.0" in capfd.readouterr().err
        assert devices.arm is None or not devices.arm.executed
    assert not list(place.glob("**/touch-off.json"))
