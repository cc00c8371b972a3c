"""What a person is asked before a real arm moves, and that all of it is written down."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import cell, stick
from players import InstantArm
from real_lab import READY_RAD, RIG, WAIVED, ToyDevices, calibrated, quiet, said, typing, waiver, waivers, write_rig
from toy_rig import ToyLab, rig_target, toy_parts
from toy_session import unattended

from adaptsim_cli import config
from adaptsim_cli.bench.devices.confirmed import ConfirmedArm
from adaptsim_cli.bench.devices.consent import Consent
from adaptsim_cli.bench.devices.known_arm import KnownArm, SetUp, folder_of, setup_of
from adaptsim_cli.bench.devices.released import ReleasedArm
from adaptsim_cli.bench.doctor import checks
from adaptsim_cli.bench.doctor.checks import CHECKS
from adaptsim_cli.bench.doctor.table import Examined, Severity, ok
from adaptsim_cli.bench.rig_file.description import as_shipped
from adaptsim_cli.bench.rig_file.reading import gaps, read
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.log import read as read_log
from adaptsim_cli.screen.release import Release
from adaptsim_cli.session.opening import open_trials
from adaptsim_cli.session.watching import SessionLog
from hw.errors import CameraError
from hw.ports import Arm, ArmWrapper
from hw.types import ArmState, Execution, JointPath
from sim.adaptation.stages import TrialKey
from sim.tasks import get_task

STILL = JointPath(np.arange(11, dtype=np.float64) * 1e-3, np.tile(np.asarray(READY_RAD, dtype=np.float64), (11, 1)))
NOW = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


def arm_with(consent: Consent) -> tuple[ConfirmedArm, InstantArm]:
    bare = InstantArm(READY_RAD, cell())
    return ConfirmedArm(bare, consent, None), bare


def test_every_question_answer_and_rate_is_in_the_log_with_the_operators_name(tmp_path, monkeypatch):
    screen = quiet()
    screen.note("The processor may fall asleep")  # before the session has its log
    screen.add_listener(SessionLog(tmp_path, screen))
    typing(monkeypatch, "Kim", "yes", "panda")
    arm, bare = arm_with(Consent(screen, "panda at 10.0.0.1"))
    with arm:
        arm.execute(STILL)
    assert len(bare.executed) == 1
    lines = read_log(tmp_path)
    assert [line.data["answer"] for line in lines if line.event == "answered"] == ["Kim", "yes", "panda"]
    noted = " / ".join(line.text for line in lines if line.event == "noted")
    for words in ("The processor may fall asleep", "operator: Kim", "panda at 10.0.0.1", "100.0 % of the commands"):
        assert words in noted
    assert all(datetime.fromisoformat(line.at) for line in lines)


def test_a_real_lab_asks_on_the_commands_screen_and_logs_it_for_the_arm_too(tmp_path, monkeypatch, place, kim):
    devices, screen = ToyDevices(), quiet()
    write_rig(place.parent / "home")
    there = config.load({"hw": "panda", "task": "scooping"})
    calibrated(there)
    session = tmp_path / "session"
    session.mkdir()
    screen.add_listener(SessionLog(session, screen))
    typing(monkeypatch, "panda")
    with open_trials(there.config, there.places, get_task("scooping"), devices.drivers(), screen=screen) as real:
        real.rig.arm.execute(STILL)
        facts = real.rig.attendant.facts()
    assert facts.operator == "Kim"
    assert [(one.safeguard, one.by) for one in facts.waivers] == [(name, "Kim") for name in WAIVED]
    assert all(one.reason == "a lab of the tests" and one.on < one.until for one in facts.waivers)
    assert facts.consent is not None
    for folder in (session, folder_of(there.places, read(place.parent / "home" / "rig.toml"))):
        said_there = [line.data.get("answer") for line in read_log(folder) if line.event == "answered"]
        assert said_there == ["panda"], folder


def test_each_motion_is_agreed_to_if_the_rig_asks_for_it(monkeypatch):
    screen = quiet()
    arm, bare = arm_with(Consent(screen, "panda", operator="Kim", each="motion"))
    typing(monkeypatch, "panda", "", "y", "", "y", "", "q")
    with arm:
        arm.execute(STILL)
        arm.await_enabled("makes its motion", STILL)  # asked before the camera records
        arm.execute(STILL)
        with pytest.raises(StoppedByOperator):
            arm.execute(STILL)
    assert len(bare.executed) == 2
    assert said(screen).count("Type y to start") == 6, "Enter alone asks again"


def slowly(place: Path, text: str, **settings: object) -> tuple[config.Resolved, ToyDevices]:
    write_rig(place.parent / "home", text)
    there = config.load({"hw": "panda", "task": "scooping", **settings})
    calibrated(there)
    return there, ToyDevices()


def test_the_rig_files_consent_to_whole_commands_counts_once_the_tasks_own_motion_was_slow(monkeypatch, place, kim):
    """A motion that is not the task's own (the way home, a small one) changes nothing; a new tool asks again."""
    text = RIG.replace(waivers("slow_start"), "")
    heavier = text.replace("mass_kg = 0.12", "mass_kg = 0.13")
    cases = (
        (text, 0.3, False, "motion"),
        (text, 0.3, True, "motion"),
        (text, 1.0, True, "command"),
        (text + waivers("hand"), 1.0, True, "command"),
        (text.replace('consent = "command"\n', ""), 1.0, False, "motion"),
        (heavier, 0.3, False, "motion"),
    )
    for content, pace, own, each in cases:
        there, devices = slowly(place, content, pace=pace)
        typing(monkeypatch, *(["Kim"] if each == "" else []), "panda", "y")
        with open_trials(there.config, there.places, get_task("scooping"), devices.drivers(), screen=quiet()) as real:
            assert real.release.each == each, (pace, own)
            if pace < 1.0:
                real.rig.arm.execute(STILL)
                assert len(devices.arm.executed) == 1
            if own:
                real.release.completed()  # as the task's own motion does at its end


def test_the_tasks_own_motion_makes_its_set_up_known_and_the_way_there_does_not(tmp_path):
    lab, completed = ToyLab(0), list[int]()
    target = rig_target(toy_parts(lab))
    moved = list[int]()

    class Counted(ArmWrapper[Arm]):
        def execute(self, path: JointPath) -> Execution:
            moved.append(1)
            return self._arm.execute(path)

    release = Release(completed=lambda: completed.append(len(moved)))
    target = replace(target, rig=replace(target.rig, arm=Counted(target.rig.arm), release=release))
    placed = target.place(np.array([0.68, 0.0]), TrialKey(1, 0), unattended())
    target.execute(target.plan(placed, np.array([0.5])))
    assert completed == [2], "once, after the second of three motions"


def test_a_trial_that_ends_before_its_motion_began_leaves_nothing_released(monkeypatch):
    target, screen = rig_target(toy_parts(ToyLab(0))), quiet()
    bench, release = target.rig.camera, Release(screen, "panda", True)

    class Dead:
        """The bench's camera, which does not start."""

        def __getattr__(self, name: str) -> Any:
            return getattr(bench, name)

        def start_recording(self) -> None:
            raise CameraError("no frame within 1 s")

    arm = ReleasedArm[Arm](target.rig.arm, release)
    camera: Any = Dead()
    rig = replace(target.rig, arm=arm, camera=camera, release=release, await_enabled=release.path)
    target = replace(target, rig=rig)
    planned = target.plan(target.place(np.array([0.68, 0.0]), TrialKey(1, 0), unattended()), np.array([0.5]))
    typing(monkeypatch, "y", "y")
    release.announced("The arm comes. ", planned.digest, "It moves.", "all is stored")
    with pytest.raises(CameraError):
        target.execute(planned)
    assert said(screen).count("Type y to start") == 2, "the way there was announced, the motion asked for"
    typing(monkeypatch)
    with pytest.raises(StoppedByOperator):
        arm.execute(planned.paths[1])


@dataclass
class Buttoned:
    """An arm whose stop button follows a list, one state a look."""

    states: list[tuple[str | None, bool]]
    recovered: list[None] = field(default_factory=list)
    model: str = "panda"

    def state(self) -> ArmState:
        fault, by_hand = self.states.pop(0) if len(self.states) > 1 else self.states[0]
        return ArmState(0.0, READY_RAD, np.zeros(7), fault, by_hand)

    def recover(self) -> None:
        self.recovered.append(None)
        self.states = [(None, False)]


def test_the_stop_button_is_checked_once_a_day(tmp_path, monkeypatch):
    known = KnownArm(tmp_path / "arm")
    pressed, free = ("the stop button is pressed", True), (None, False)
    screen = quiet()
    typing(monkeypatch, *[""] * 4, "recover", "panda")
    consent = Consent(screen, "panda", operator="Kim", known_arm=known, pace=0.3)
    arm: Any = Buttoned([free, pressed, pressed, ("reflex", False)])
    consent.once(arm)
    assert said(screen).count("Press the arm's stop button now") == 2, "the first time nothing was pressed"
    assert said(screen).count("Release it") == 2
    assert arm.recovered == [None]
    assert known.read().stop_button_by == "Kim"
    typing(monkeypatch, "panda")
    again = quiet()
    Consent(again, "panda", operator="Kim", known_arm=known, pace=0.3).once(arm)
    assert "stop button now" not in said(again)


def test_who_does_not_check_the_stop_button_moves_nothing(tmp_path, monkeypatch):
    typing(monkeypatch, "q")
    arm: Any = Buttoned([(None, False)])
    with pytest.raises(StoppedByOperator):
        Consent(quiet(), "panda", operator="Kim", known_arm=KnownArm(tmp_path)).once(arm)
    assert KnownArm(tmp_path).read().stop_button == ""


@pytest.mark.parametrize(
    ("age", "verdict"), [(None, Severity.ADVICE), (1.0, Severity.OK), (25.0, Severity.ADVICE), (-3.0, Severity.ADVICE)]
)
def test_the_doctor_says_when_the_check_is_older_than_a_day(age, verdict, tmp_path, monkeypatch):
    lab = Examined(config.load({"hw": "panda"}), {"rig file": ok("")})
    vars(lab)["rig"] = as_shipped("panda")
    monkeypatch.setattr(checks, "folder_of", lambda *_: tmp_path)
    if age is not None:
        at = (datetime.now(UTC) - timedelta(hours=age)).isoformat(timespec="seconds")
        content = {"stop_button": at, "stop_button_by": "Kim", "slow_motions": [], "steps": []}
        (tmp_path / "known.json").write_text(json.dumps(content))
    assert CHECKS["stop button"](lab).verdict is verdict


def test_a_damaged_memory_asks_everything_again(tmp_path):
    no_time = '{"stop_button": "x", "stop_button_by": "", "slow_motions": [], "steps": []}'
    for content in ("{", "[]", '{"stop_button": 3}', no_time):
        (tmp_path / "known.json").write_text(content)
        assert KnownArm(tmp_path).read().stop_button_is_due(NOW)


NEW = SetUp("scooping", "tool", "calibration", "rig")


@pytest.mark.parametrize(("answer", "moves"), [("full", True), ("kim", False), ("", False), ("q", False)])
def test_a_new_set_up_moves_slowly_first_or_by_name(answer, moves, tmp_path, monkeypatch):
    known, screen = KnownArm(tmp_path), quiet()

    def asked(pace: float, into: Screen, setup: SetUp = NEW) -> Consent:
        waived = (waiver("stop_button"),)
        return Consent(into, "panda", operator="Kim", known_arm=known, setup=setup, pace=pace, waivers=waived)

    def moved(consent: Consent, *typed: str, own: bool) -> bool:
        typing(monkeypatch, *typed)
        arm, bare = arm_with(consent)
        with arm, suppress(StoppedByOperator):
            arm.execute(STILL)
            if own:
                arm.release.completed()
        return bool(bare.executed)

    assert moved(asked(1.0, screen), answer, "panda", own=True) == moves
    assert "add --pace 0.3" in said(screen)
    assert known.read().slow_motions == (), "full speed makes nothing known"
    assert moved(asked(0.3, quiet()), "panda", own=False)
    assert known.read().slow_motions == (), "nor does another motion, as slow as it may be"
    assert moved(asked(0.3, quiet()), "panda", own=True)
    after = quiet()
    assert moved(asked(1.0, after), "panda", own=True)
    assert "Full speed" not in said(after)
    for part, name in (("tool", "tool or table"), ("calibration", "calibration"), ("rig", "rig file")):
        again = quiet()
        assert not moved(asked(1.0, again, replace(NEW, **{part: "another"})), "", own=True)
        assert f"The {name} changed after scooping last moved slowly" in said(again)
    other = quiet()
    assert not moved(asked(1.0, other, replace(NEW, kind="pushing")), "", own=True)
    assert "With this rig file, tool and calibration pushing has not moved" in said(other)


@pytest.mark.parametrize("name", ["Q", "q", "Enter", "?", "full", "y"])
def test_a_name_that_is_a_key_of_a_question_is_harmless(name, tmp_path, monkeypatch):
    for typed, agrees in (("q", False), (name, name == "full"), ("", False)):
        screen = quiet()
        typing(monkeypatch, typed, "panda")
        known, waived = KnownArm(tmp_path), (waiver("stop_button"),)
        consent = Consent(screen, "panda", operator=name, known_arm=known, setup=NEW, waivers=waived)
        with suppress(StoppedByOperator):
            consent.once(arm_with(consent)[0])
        assert (consent.given_at is not None) == agrees
        assert "Full speed nevertheless? Type full to move at full speed on your own account" in said(screen)


def test_the_name_is_asked_for_until_one_is_typed_and_the_question_says_so(monkeypatch):
    screen = quiet()
    typing(monkeypatch, "", "Kim", "panda")
    consent = Consent(screen, "panda")
    consent.once(arm_with(consent)[0])
    assert consent.operator == "Kim" and "Enter alone names nobody. Type a name or initials" in said(screen)


def test_a_set_up_is_task_rig_file_tool_and_calibration():
    rig, zeros, X_BC = as_shipped("panda"), np.zeros(7), np.eye(4)
    first = setup_of(rig, cell(zeros_rad=zeros), "scooping", X_BC)
    assert first == setup_of(as_shipped("panda"), cell(zeros_rad=zeros), "scooping", X_BC)
    assert first == setup_of(replace(rig, waivers=(waiver("pedal"),)), cell(zeros_rad=zeros), "scooping", X_BC)
    others = {
        setup_of(as_shipped("fr3"), cell(zeros_rad=zeros), "scooping", X_BC),
        setup_of(rig, cell(zeros_rad=zeros + 1e-4), "scooping", X_BC),
        setup_of(rig, cell(tool=stick((0.0, 0.0, 0.2))), "scooping", X_BC),
        setup_of(rig, cell(tool=stick((0.0, 0.0, 0.201))), "scooping", X_BC),
        setup_of(rig, cell(zeros_rad=zeros), "pushing", X_BC),
        setup_of(rig, cell(zeros_rad=zeros), "scooping", 1.001 * X_BC),
    }
    assert len(others | {first}) == 7


def test_a_bare_rig_file_moves_nothing_and_the_doctor_names_every_gap(place, kim):
    bare = 'name = "lab-1"\n[arm]\nmodel = "panda"\naddress = "172.16.0.2"\n'
    rig = read(write_rig(place.parent / "home", bare))
    assert [gap.what for gap in gaps(rig, "scooping")] == ["pedal", "person", "payload", "keep_out"]
    there = config.load({"hw": "panda", "task": "scooping"})
    calibrated(there)
    every = r"pedal.*operator stands.*payload.*keep out"
    with (
        pytest.raises(UsageError, match=every) as refused,
        open_trials(there.config, there.places, get_task("scooping"), ToyDevices().drivers()),
    ):
        pass
    lab = Examined(there, {"rig file": ok("")})
    found = CHECKS["safeguards"](lab)
    assert found.verdict is Severity.MISSING
    assert not re.search("waive", f"{refused.value} {found.detail} {found.fix}"), "no message prints a waiver to paste"
    write_rig(place.parent / "home", bare + waivers("pedal", "person", "payload", "keep_out"))
    lab = Examined(there, {"rig file": ok("")})
    found = CHECKS["safeguards"](lab)
    assert found.verdict is Severity.ADVICE
    assert "pedal is waived until" in found.detail and "a lab of the tests (Kim," in found.detail


@pytest.mark.parametrize(("age_days", "counts"), [(-400, False), (-2, False), (0, True), (30, True), (31, False)])
def test_a_waiver_counts_for_thirty_days_and_then_not(age_days, counts, place, kim):
    on = (datetime.now(UTC) - timedelta(days=age_days)).date().isoformat()
    bare = 'name = "lab-1"\n[arm]\nmodel = "panda"\naddress = "172.16.0.2"\n'
    rig = read(
        write_rig(place.parent / "home", bare + waivers("pedal", "person", "payload", "keep_out", "hand", on=on))
    )
    assert rig.without_hand == counts
    missing = gaps(rig, "scooping")
    assert [gap.what for gap in missing] == ([] if counts else ["pedal", "person", "payload", "keep_out", "hand"])
    assert all(f"its waiver of {on} ended on" in gap.message and "adaptsim setup" in gap.message for gap in missing)


def test_a_waiver_of_an_older_version_is_named_with_the_way_to_renew_it(place, kim, refused):
    write_rig(place.parent / "home", 'waived = ["pedal"]\n' + RIG)
    answer = refused(2, "doctor", "--hw", "panda", "--assessment", "sheet.html")
    assert "waived is a list of an older version" in answer and "adaptsim setup --waive NAME" in answer


def test_every_command_says_and_logs_what_is_waived_and_what_is_not_any_more(place, kim):
    old = (datetime.now(UTC) - timedelta(days=40)).date().isoformat()
    write_rig(place.parent / "home", RIG.replace(waivers("stop_button"), waivers("stop_button", on=old)))
    there = config.load({"hw": "panda", "task": "scooping"})
    calibrated(there)
    screen = quiet()
    with open_trials(there.config, there.places, get_task("scooping"), ToyDevices().drivers(), screen=screen):
        pass
    lines = [
        line.text
        for line in read_log(folder_of(there.places, read(place.parent / "home" / "rig.toml")))
        if line.event == "noted"
    ]
    assert any("Waived: keep_out is waived until" in line and "a lab of the tests (Kim" in line for line in lines)
    assert any(line.startswith("Not waived any more: stop_button, since") for line in lines)
