"""`adaptsim config init`: what it asks, what it writes, and that it replaces nothing unasked."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path

import pytest

from adaptsim_cli import app
from adaptsim_cli.devices.rig_file import writing
from adaptsim_cli.devices.rig_file.description import RigDescription
from adaptsim_cli.devices.rig_file.interview import interview
from adaptsim_cli.devices.rig_file.inventory import Inventory, serial_ports
from adaptsim_cli.devices.rig_file.reading import read
from adaptsim_cli.errors import StoppedByOperator
from adaptsim_cli.screen import console

ARDUINO, FTDI = "/dev/serial/by-id/usb-Arduino_LLC-if00", "/dev/serial/by-id/usb-FTDI_FT232R-if00"
BOTH = Inventory((ARDUINO, FTDI), ("000123",))


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in [name for name in os.environ if name.startswith("ADAPTSIM_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(writing, "look", lambda: BOTH)
    monkeypatch.setattr(writing, "tasks_with_tools", lambda: ("pushing", "scooping"))
    return tmp_path


def typing(monkeypatch: pytest.MonkeyPatch, *answers: str) -> None:
    monkeypatch.setattr(console, "require_terminal", lambda *_: None)
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{answer}\n" for answer in answers)))


def asked(*answers: str, found: Inventory = BOTH) -> tuple[RigDescription | None, list[str]]:
    """The interview with these answers; an empty one takes the default, as do all after the last."""
    left, told = list(answers), list[str]()

    def ask(question: str, default: str) -> str:
        told.append(question)
        return (left.pop(0) if left else "") or default

    return interview(ask, told.append, found, None), told


def test_the_defaults_are_what_the_machine_has() -> None:
    rig, told = asked()
    assert rig is not None
    assert (rig.name, rig.arm.model, rig.arm.address) == ("lab", "fr3", "172.16.0.2")
    assert rig.camera.serial == "000123"
    assert rig.pedal is not None and rig.pedal.port == ARDUINO
    assert rig.balance is not None and (rig.balance.port, rig.balance.protocol) == (FTDI, "mt-sics")
    assert rig.person is not None and rig.person.side == "left"
    assert f"  1  {ARDUINO}" in told


def test_answers_that_cannot_be_are_explained_and_asked_again() -> None:
    rig, told = asked(
        "ur5", "panda", "two words", "lab-2", "http://arm", "arm.local", "", "7", "/dev/ttyACM3", "/dev/ttyACM3", "1",
        "rs232", "sbi", "behind", "none",
    )  # fmt: skip
    assert rig is not None
    assert (rig.name, rig.arm.model, rig.arm.address) == ("lab-2", "panda", "arm.local")
    assert rig.pedal is not None and rig.pedal.port == "/dev/ttyACM3"
    assert rig.balance is not None and (rig.balance.port, rig.balance.protocol) == (ARDUINO, "sbi")
    assert rig.person is None
    for problem in ("'ur5': choose one of", "letters, digits", "address alone", "'7' is not a path", "share the port"):
        assert sum(problem in line for line in told) == 1, problem


def test_a_side_at_which_the_tasks_work_is_asked_again_and_says_which() -> None:
    answers = ("fr3", *[""] * 6, "front", "right")
    rig, told = asked(*answers)
    assert rig is not None
    assert rig.person is not None and rig.person.side == "right"
    (said,) = [line for line in told if "kept clear from 0.6 m on" in line]
    assert "scooping works there, over x 0.65 to 0.95 m" in said
    assert "pushing works there" in said
    assert "from_m" in said


def test_without_an_arm_nothing_more_is_asked() -> None:
    rig, told = asked("none")
    assert rig is None
    assert len(told) == 1


def test_a_machine_without_devices_leaves_their_parts_out() -> None:
    rig, _ = asked(found=Inventory((), ()))
    assert rig is not None
    assert rig.pedal is rig.balance is None
    assert rig.camera.serial == ""


def test_yes_takes_every_default_and_json_tells_what_was_written(
    place: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert app.run(["config", "init", "--yes", "--json"]) == 0
    written = json.loads(capfd.readouterr().out)
    assert written["rig_file"] == str(place / "home/rig.toml")
    assert written["settings_written"]
    assert written["rig"]["pedal"] == {"port": ARDUINO}
    assert read(Path(written["rig_file"])).arm.model == "fr3"
    assert app.run(["config", "show", "--json"]) == 0
    shown = json.loads(capfd.readouterr().out)
    assert shown["settings"]["rig"]["value"] == written["rig_file"]
    assert shown["rig_file"]["arm"]["address"] == "172.16.0.2"
    assert app.run(["config", "show"]) == 0
    assert "arm.address" in capfd.readouterr().out


def test_a_rig_file_is_never_replaced_unasked(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    init = ["config", "init", "--project"]
    assert app.run([*init, "--arm", "panda", "--yes"]) == 0
    before = (place / "rig.toml").read_bytes()
    assert app.run([*init, "--arm", "fr3", "--yes"]) == 2
    assert "exists already and is unchanged" in capfd.readouterr().err
    typing(monkeypatch, "n")
    assert app.run(init) == 7
    assert (place / "rig.toml").read_bytes() == before
    typing(monkeypatch, "y", "fr3", *[""] * 8)
    assert app.run(init) == 0
    assert read(place / "rig.toml").arm.model == "fr3"
    assert app.run([*init, "--arm", "panda", "--yes", "--overwrite"]) == 0
    assert (place / "rig.toml").read_bytes() == before


def test_whoever_stops_half_way_leaves_nothing_behind(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    typing(monkeypatch, "fr3", "lab")
    assert app.run(["config", "init", "--project"]) == 7
    assert "The input ended" in capfd.readouterr().err
    assert list(place.iterdir()) == []


def test_without_a_terminal_nothing_is_asked(capfd: pytest.CaptureFixture[str]) -> None:
    with Path(os.devnull).open() as nothing, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdin", nothing)
        assert app.run(["config", "init"]) == 2
    assert "add --yes for every default" in capfd.readouterr().err
    assert app.run(["config", "init", "--arm", "ur5", "--yes"]) == 2
    assert "choose one of fr3, panda, none" in capfd.readouterr().err


def test_a_broken_rig_file_does_not_hide_the_settings(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (place / "rig.toml").write_text('name = "lab"\n')
    assert app.run(["config", "show"]) == 2
    out, err = capfd.readouterr()
    assert str(place / "rig.toml")[:40] in out.replace("\n", "")
    assert "arm is missing" in err


def test_ports_are_listed_by_the_name_that_lasts(tmp_path: Path) -> None:
    by_id = tmp_path / "serial/by-id"
    by_id.mkdir(parents=True)
    for name in ("ttyACM0", "ttyUSB0", "ttyS0"):
        (tmp_path / name).touch()
    (by_id / "usb-Arduino-if00").symlink_to(tmp_path / "ttyACM0")
    assert serial_ports(tmp_path) == (str(by_id / "usb-Arduino-if00"), str(tmp_path / "ttyUSB0"))
    assert serial_ports(tmp_path / "none") == ()


def test_stopping_is_an_error_of_the_operator() -> None:
    def stop(question: str, default: str) -> str:
        raise StoppedByOperator("stopped")

    with pytest.raises(StoppedByOperator):
        interview(stop, lambda _: None, BOTH, None)
