"""`adaptsim setup`: what it asks, what it writes, when a step is done, and where it goes on."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import pytest
from real_lab import ToyDevices, calibrated, quiet, said, typing

from adaptsim_cli import config
from adaptsim_cli.bench.calibration import running as calibrating
from adaptsim_cli.bench.devices import drivers
from adaptsim_cli.bench.doctor import checks, readings, table
from adaptsim_cli.bench.doctor.checks import CHECKS
from adaptsim_cli.bench.doctor.readings import serial_ports
from adaptsim_cli.bench.doctor.table import DoctorCheck, Examined, Finding, missing, ok
from adaptsim_cli.bench.rig_file.description import ArmPart, KeepOutPart, RigDescription
from adaptsim_cli.bench.rig_file.reading import read
from adaptsim_cli.commands.setup_steps import describing, moving, walk
from adaptsim_cli.commands.setup_steps.answers import Answers, begun
from adaptsim_cli.errors import PreflightFailed, StoppedByOperator, UsageError
from adaptsim_cli.screen.console import Screen
from hw.camera import probe

ARDUINO, FTDI = "/dev/serial/by-id/usb-Arduino_LLC-if00", "/dev/serial/by-id/usb-FTDI_FT232R-if00"


@pytest.fixture
def answers(tmp_path, monkeypatch, kim) -> Answers:
    monkeypatch.setattr(describing, "serial_ports", lambda _: (ARDUINO, FTDI))
    monkeypatch.setattr(describing, "_Drawn", lambda _: None)
    there = config.load({"hw": "panda"})
    rig = RigDescription("lab", ArmPart("panda", "172.16.0.2"))
    return Answers(there.config, there.places, tmp_path / "rig.toml", rig, quiet(), False)


def test_enter_takes_what_the_machine_has(answers, monkeypatch):
    monkeypatch.setattr(
        readings,
        "cameras",
        lambda _: probe.ProbeReport("x", "1", "Orbbec", True, (probe.FoundDevice(0, "000123", ""),), None, None),
    )
    typing(monkeypatch, *[""] * 12, "lamp", "", "", "", "", "")
    for step in (describing.arm, describing.pedal, describing.camera, describing.table, describing.tool):
        step(answers)
    answers.save()
    rig = read(answers.file)
    assert (rig.name, rig.arm.address, rig.camera.serial) == ("lab", "172.16.0.2", "000123")
    assert rig.pedal is not None and rig.pedal.port == ARDUINO
    assert rig.balance is not None and (rig.balance.port, rig.balance.protocol) == (FTDI, "mt-sics")
    assert rig.person is not None and (rig.person.side, rig.person.from_m) == ("left", 0.6)
    assert rig.waivers == () and [box.name for box in rig.keep_out] == ["lamp"]
    payload = rig.tool("scooping").payload
    assert payload is not None and payload.mass_kg == pytest.approx(0.12)
    assert "# where that side begins, m, 0.2 to 1.9" in answers.file.read_text()


def test_wrong_answers_are_explained_and_asked_again(answers, monkeypatch):
    typing(monkeypatch, "two words", "lab-2", "http://arm", "arm.local", "7", "/dev/ttyACM3", "/dev/ttyACM3", "1",
           "rs232", "sbi")  # fmt: skip
    describing.arm(answers)
    describing.pedal(answers)
    assert (answers.rig.name, answers.rig.arm.address) == ("lab-2", "arm.local")
    assert answers.rig.pedal is not None and answers.rig.pedal.port == "/dev/ttyACM3"
    assert answers.rig.balance is not None and answers.rig.balance.port == ARDUINO
    told = said(answers.screen)
    for problem in (
        "letters, digits",
        "only the name or IP address",
        "'7' is not a path",
        "share the port",
        "'rs232': choose one",
    ):
        assert told.count(problem) == 1, problem
    assert "The arm stops by itself at 80 N, and at 60 60 54 54 10 10 10 Nm in joints 1 to 7." in told


def test_enter_waives_nothing(answers, monkeypatch):
    """Enter at everything, on a computer without a pedal: each question without a default is asked again."""
    monkeypatch.setattr(describing, "serial_ports", lambda _: ())
    typing(monkeypatch, *[""] * 40)
    with pytest.raises(StoppedByOperator):
        describing.pedal(answers)
    typing(monkeypatch, *[""] * 40)
    with pytest.raises(StoppedByOperator):
        describing.table(answers)
    assert answers.rig.waivers == () and answers.rig.pedal is None and answers.rig.keep_out == ()
    told = said(answers.screen)
    assert "there is no default" in told and "There is no box yet" in told


@pytest.mark.parametrize("reason", ["", "short"])
def test_a_waiver_needs_a_typed_reason(reason, answers, monkeypatch):
    typing(monkeypatch, "waive", reason, "1", "none", *[""] * 3, "waive", reason, "left", "", "waive", reason, "lamp",
           "", "", "")  # fmt: skip
    describing.pedal(answers)
    describing.table(answers)
    assert answers.rig.waivers == ()
    assert "Nothing is waived" in said(answers.screen)


def test_a_waiver_has_reason_name_and_day_in_the_file_and_ends_when_the_safeguard_is_there(answers, monkeypatch):
    answers.config = answers.config.model_copy(update={"operator": "Kim"})
    why = "the pedal is ordered"
    typing(monkeypatch, "waive", why, "none", *[""] * 3, "waive", "nobody enters", "waive", "an empty room")
    describing.pedal(answers)
    describing.table(answers)
    answers.save()
    rig = read(answers.file)
    assert [waiver.safeguard for waiver in rig.waivers] == ["pedal", "person", "keep_out"]
    assert (rig.waivers[0].reason, rig.waivers[0].by) == (why, "Kim")
    assert rig.waivers[0].counts(datetime.now(UTC).date())
    old = replace(rig.waivers[0], on="2026-01-01")
    answers.rig = replace(rig, waivers=(old, *rig.waivers[1:]))
    typing(monkeypatch, "1", "none")
    describing.pedal(answers)
    assert [waiver.safeguard for waiver in answers.rig.waivers] == ["person", "keep_out"]


def test_a_step_is_not_done_while_its_safeguard_is_missing(answers, monkeypatch):
    step = next(step for step in walk.STEPS if step.name == "pedal")
    monkeypatch.setattr(checks, "examine", lambda *_: iter(()))
    assert walk._missing(answers, step) == ["pedal"]


def test_a_setup_drops_the_waivers_of_an_older_version_and_asks_again(tmp_path, kim):
    (tmp_path / "home").mkdir()
    file = tmp_path / "home/rig.toml"
    file.write_text('name = "lab"\nwaived = ["pedal"]\n[arm]\nmodel = "panda"\naddress = "a"\n')
    screen = quiet()
    assert begun(config.load({"hw": "panda"}), screen, yes=False).rig.waivers == ()
    assert "waives pedal in the way of an older version" in said(screen)


@pytest.mark.parametrize(("typed", "count"), [(["the tool is screwed on"], 1), ([""], 0)])
def test_one_safeguard_is_waived_alone(typed, count, tmp_path, kim, monkeypatch):
    answers = begun(config.load({"hw": "panda"}), quiet(), yes=False)
    typing(monkeypatch, *typed)
    walk.waive(answers, "hand")
    assert len(answers.rig.waivers) == count and answers.file.is_file() == bool(count)
    with pytest.raises(UsageError, match="--waive lamp: choose one of pedal, hand"):
        walk.waive(answers, "lamp")


def test_a_side_where_a_task_works_is_refused_and_a_box_there_is_named(answers, monkeypatch):
    typing(monkeypatch, "0.01", "0.2 1", "-0.5 x", "-0.5 0.5", "front", "0.6", "1.3",
           "lamp", "0.6 -0.1 0", "0.8 0.1", "0.5 0.1 0.4", "0.8 0.1 0.4", "")  # fmt: skip
    describing.table(answers)
    assert (answers.rig.table.height_m, answers.rig.table.x_m, answers.rig.table.y_m) == (0.01, (0.2, 1), (-0.5, 0.5))
    assert answers.rig.person is not None and answers.rig.person.from_m == 1.3
    assert answers.rig.keep_out == (KeepOutPart("lamp", (0.6, -0.1, 0.0), (0.8, 0.1, 0.4)),)
    told = said(answers.screen)
    assert "over x 0.65 to 0.95 m" in told and "stand further out" in told
    assert "'-0.5 x': 2 numbers belong here" in told and "is not below" in told
    assert "name it again to correct it" in told
    typing(monkeypatch, *[""] * 5, "lamp", "0.5 -0.9 0", "0.7 -0.7 0.4", "")
    describing.table(answers)
    assert [box.low_m for box in answers.rig.keep_out] == [(0.5, -0.9, 0.0)]


@pytest.fixture
def short(answers: Answers, monkeypatch) -> list[str]:
    """A walk of three steps; the middle one is ready once it was done twice. Returns what was done."""
    done: list[str] = []

    def step(name: str, needed: int = 0) -> walk.Step:
        def probe(_: Examined) -> Finding:
            return ok("there") if done.count(name) >= needed else missing("gone", "plug it in")

        monkeypatch.setitem(CHECKS, name, DoctorCheck("x", name, "", lambda _: "", probe))
        return walk.Step(name, lambda _: done.append(name), (name,))

    monkeypatch.setattr(walk, "STEPS", (step("arm"), step("camera", 2), step("trial")))
    return done


def test_a_step_is_done_once_its_check_passes(answers, short, monkeypatch):
    typing(monkeypatch, "", "a")
    walk.walk(answers)
    assert short == ["arm", "camera", "camera", "trial"]
    told = said(answers.screen)
    assert told.count("camera: plug it in") == 2  # checked again before it was answered again
    assert "The lab is set up" in told
    walk.walk(answers)
    assert len(short) == 4, "everything is done already"


def test_a_walk_goes_on_where_it_was_stopped_or_where_a_check_fails(answers, short, monkeypatch):
    typing(monkeypatch, "q")
    with pytest.raises(StoppedByOperator, match="every completed step is kept") as stopped:
        walk.walk(answers)
    assert stopped.value.__notes__ == ["Go on with: adaptsim setup --task scooping --hw panda"]
    assert answers.known_arm.read().steps == ("arm",)
    typing(monkeypatch, "")
    walk.walk(answers)
    assert short == ["arm", "camera", "camera", "trial"]
    del short[1:3]  # the camera is gone
    typing(monkeypatch, "a")
    walk.walk(answers)
    assert short == ["arm", "trial", "camera", "camera", "trial"], "what follows a step is done again after it"


def test_a_walk_can_begin_again_at_a_step(answers, short):
    short.append("camera")
    walk.walk(answers)
    walk.walk(answers, begin="camera")
    assert short == ["camera", "arm", "camera", "trial", "camera", "trial"]
    with pytest.raises(UsageError, match="--from lamp: choose one of arm, camera, trial"):
        walk.walk(answers, begin="lamp")
    unasked = replace(answers, defaults=True)
    short.clear()
    with pytest.raises(PreflightFailed, match="not ready: camera"):
        walk.walk(unasked, begin="camera")


def test_a_real_lab_is_never_set_up_unattended(tmp_path, refused, kim):
    assert "leave out --yes" in refused(2, "setup", "--hw", "fr3", "--yes")
    (tmp_path / "home").mkdir()
    (tmp_path / "home/rig.toml").write_text('name = "lab"\n[arm]\nmodel = "panda"\naddress = "a"\n')
    assert "is the rig file of a panda" in refused(2, "setup", "--hw", "fr3")


def test_a_setup_writes_the_users_own_rig_file_and_a_practised_one_beside_the_project(tmp_path, monkeypatch, kim):
    assert begun(config.load({"hw": "fr3"}), quiet(), yes=False).file == tmp_path / "home/rig.toml"
    assert begun(config.load({}), quiet(), yes=False).file == tmp_path / "home/practice.toml"
    (tmp_path / "here/adaptsim.toml").write_text("")
    assert begun(config.load({}), quiet(), yes=False).file == tmp_path / "here/practice.toml"
    assert begun(config.load({"hw": "fr3"}), quiet(), yes=False).file == tmp_path / "home/rig.toml"
    foreign = tmp_path / "here/rig.toml"
    foreign.write_text('name = "lab"\n[arm]\nmodel = "fr3"\naddress = "a"\n')
    with pytest.raises(UsageError, match="a setup writes your own rig file") as refusal:
        begun(config.load({"hw": "fr3"}), quiet(), yes=False)
    assert f"cp {foreign} {tmp_path / 'home/rig.toml'}" in str(refusal.value)
    monkeypatch.setenv("ADAPTSIM_RIG", "other.toml")
    assert begun(config.load({"hw": "fr3"}), quiet(), yes=False).file == tmp_path / "here/other.toml"


def test_a_setup_says_which_answer_it_expects_to_who_sets_it_up(monkeypatch, kim):
    monkeypatch.delenv("ADAPTSIM_OPERATOR")
    typing(monkeypatch, "", "", "Q. Lee")
    screen = quiet()
    assert begun(config.load({"hw": "fr3"}), screen, yes=False).config.operator == "Q. Lee"
    assert said(screen).count("Enter alone names nobody. Type a name or initials") == 2
    typing(monkeypatch, "", "q")
    with pytest.raises(StoppedByOperator, match="nothing has been written"):
        begun(config.load({"hw": "fr3"}), quiet(), yes=False)


def test_ports_are_listed_by_the_name_that_lasts(tmp_path):
    by_id = tmp_path / "serial/by-id"
    by_id.mkdir(parents=True)
    for name in ("ttyACM0", "ttyUSB0", "ttyS0"):
        (tmp_path / name).touch()
    (by_id / "usb-Arduino-if00").symlink_to(tmp_path / "ttyACM0")
    assert serial_ports(tmp_path) == (str(by_id / "usb-Arduino-if00"), str(tmp_path / "ttyUSB0"))
    assert serial_ports(tmp_path / "none") == ()


def test_the_stop_button_is_checked_with_the_arm_alone(answers, monkeypatch):
    devices = ToyDevices()
    monkeypatch.setattr(drivers, "makers_drivers", devices.drivers)
    typing(monkeypatch, "", "q")
    with pytest.raises(StoppedByOperator, match="nothing has moved"):
        describing.stop_button(answers)
    assert list(devices.opened) == ["arm"]
    told = said(answers.screen)
    assert told.count("Press the arm's stop button now (nothing moves).") == 2
    assert "The arm reports: ready to move" in told, "nobody has pressed it"
    assert answers.known_arm.read().stop_button == ""
    answers.known_arm.stop_button_checked("Kim")
    describing.stop_button(answers)  # asks nothing


def test_the_first_calibration_of_a_real_lab_is_guided_by_hand_and_later_ones_are_slow(answers, monkeypatch):
    asked: list[tuple[bool, float]] = []

    def calibrate(resolved: config.Resolved, *_: object, guide: bool, yes: bool) -> None:
        asked.append((guide, resolved.config.pace))

    monkeypatch.setattr(calibrating, "calibrate", calibrate)
    answers.config = answers.config.model_copy(update={"rig": str(answers.file)})
    answers.save()
    moving.calibrate(answers)
    calibrated(answers.resolved)
    typing(monkeypatch, "", "r")
    moving.calibrate(answers)  # kept
    moving.calibrate(answers)
    assert asked == [(True, 0.3), (False, 0.3)]


def test_a_practised_lab_lacks_nothing_that_it_cannot_have(kim):
    practice = begun(config.load({}), quiet(), yes=True)
    describing.table(practice)
    describing.tool(practice)
    practice.save()
    found = checks.examine(practice.resolved, ("rig file", "safeguards", "motion"))
    assert table.missing_in(tuple(found)) == []


def test_a_question_mark_explains_with_unit_and_sign(answers, monkeypatch, capsys):
    answers.screen = Screen()
    typing(monkeypatch, "?", "", "?", "", "?", "", "?", "left", "?", "", "?", "lamp", "?", "", "?", "", "")
    describing.table(answers)
    said = " ".join(capsys.readouterr().out.split())
    for words in (
        "in m. A table top below that plate is negative",
        "Two numbers in m from the middle of the arm's foot: the near edge",
        "The arm's left is positive, so the first one is negative.",
        "The arm's left is +y, its right is -y",
        "In m, from the axis of joint 1 outwards, always positive.",
        "One word for the record, e.g. lamp.",
        "Three numbers in m from the middle of the arm's foot",
        "Enter takes 0.6; q leaves.",
    ):
        assert words in said
