"""The first session of a new rig at a terminal where only Enter is pressed: nothing moves, and nothing is waived."""

from __future__ import annotations

import os
import pty
from collections.abc import Iterator

import pytest
from real_lab import RIG, ToyDevices, calibrated, waivers, write_rig

from adaptsim_cli import config
from adaptsim_cli.bench.devices.known_arm import KnownArm, folder_of
from adaptsim_cli.bench.doctor import checks
from adaptsim_cli.bench.rig_file.reading import read
from adaptsim_cli.commands import app
from adaptsim_cli.commands.setup_steps import describing
from hw.grasping import FakeHand

BOX = '[[keep_out]]\nname = "lamp"\nlow_m = [0.5, -0.9, 0.6]\nhigh_m = [0.7, -0.7, 1.0]\n'
NEW = RIG[: RIG.index("[[waivers]]")].replace('consent = "command"\n', "") + BOX
"""A rig file that states everything and waives nothing."""
ENTERS = 30


class OnlyEnter:
    """A terminal: every question gets Enter, and after `ENTERS` of them q."""

    def __init__(self, ours: int, terminal: int) -> None:
        self._ours, self._lines, self.asked = ours, os.fdopen(terminal, encoding="utf-8"), 0

    def isatty(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._lines.fileno()

    def readline(self) -> str:
        self.asked += 1
        os.write(self._ours, b"\n" if self.asked <= ENTERS else b"q\n")
        return self._lines.readline()

    def close(self) -> None:
        self._lines.close()


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[OnlyEnter]:
    ours, theirs = pty.openpty()
    keyboard = OnlyEnter(ours, theirs)
    monkeypatch.setattr("sys.stdin", keyboard)
    yield keyboard
    keyboard.close()
    os.close(ours)


@pytest.fixture
def devices(monkeypatch: pytest.MonkeyPatch) -> ToyDevices:
    toys = ToyDevices(hand=FakeHand(0.012, holds=True))
    monkeypatch.setattr("adaptsim_cli.bench.devices.drivers.makers_drivers", toys.drivers)
    monkeypatch.setattr(describing, "serial_ports", lambda _: ())
    monkeypatch.setattr(describing, "_Drawn", lambda _: None)
    monkeypatch.setattr(checks, "examine", lambda *_: iter(()))  # a computer and devices that lack nothing
    return toys


def still(devices: ToyDevices) -> bool:
    return (devices.arm is None or devices.arm.executed == []) and devices.hand.commands == []


@pytest.mark.parametrize("button", [False, True])
def test_a_setup_with_only_enter_waives_nothing_and_moves_nothing(button, place, kim, terminal, devices):
    file = place.parent / "home" / "rig.toml"
    settings = config.load({"hw": "panda"})
    if button:  # somebody has pressed the stop button, so the walk goes on to the pedal
        write_rig(place.parent / "home", 'name = "lab"\n[arm]\nmodel = "panda"\naddress = "172.16.0.2"\n')
        KnownArm(folder_of(settings.places, read(file))).stop_button_checked("Kim")
    assert app.run(["setup", "--hw", "panda"]) == 7
    assert terminal.asked > ENTERS
    assert still(devices)
    assert not file.is_file() or read(file).waivers == ()
    assert list(devices.opened) == ["arm"]


@pytest.mark.parametrize("step", ["table and boxes", "tool"])
def test_no_step_of_a_setup_waives_anything(step, place, kim, terminal, devices):
    write_rig(place.parent / "home", NEW.replace(BOX, ""))
    assert app.run(["setup", "--hw", "panda", "--from", step]) == 7
    assert read(place.parent / "home" / "rig.toml").waivers == () and still(devices)


@pytest.mark.long
@pytest.mark.parametrize(
    "command",
    [
        ["run-iteration", "--task", "scooping"],
        ["rollout", "--task", "scooping"],
        ["touch-off", "--task", "scooping"],
        ["calibrate", "--guide"],
        ["doctor"],
    ],
)
@pytest.mark.parametrize("text", [NEW, NEW + waivers("stop_button", "slow_start")])
def test_no_command_moves_anything_with_only_enter(command, text, place, kim, terminal, devices):
    file = write_rig(place.parent / "home", text)
    calibrated(config.load({"hw": "panda"}))
    assert app.run(["calibrate", "board", "--out", "board.pdf"]) == 0
    before = file.read_text()
    code = app.run([*command, "--hw", "panda"])
    assert still(devices)
    assert file.read_text() == before
    assert code in ((0,) if command == ["doctor"] else (3, 7))
