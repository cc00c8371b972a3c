"""Opening a real lab: what is refused before a device is touched, what the devices are given, who confirms what."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from real_lab import (
    HANDLE_M,
    READY_RAD,
    RIG,
    WAIVED,
    ToyBalance,
    ToyDevices,
    Untouched,
    calibrated,
    quiet,
    said,
    typing,
    waivers,
    write_rig,
)
from toy_rig import ToyLab, rig_target, toy_parts
from toy_session import unattended

from adaptsim_cli import config
from adaptsim_cli.bench import calibration_in_use
from adaptsim_cli.bench.devices.attended import AT_HOME_RAD, PersonBeside, Scales
from adaptsim_cli.bench.devices.mounted import mounted_task_of
from adaptsim_cli.bench.facts import RigFacts
from adaptsim_cli.bench.rig_file.reading import read
from adaptsim_cli.config import Resolved
from adaptsim_cli.errors import StoppedByOperator, UsageError
from adaptsim_cli.session import opening, recording
from adaptsim_cli.session.opening import open_trials
from adaptsim_cli.session.operator import Attended
from adaptsim_cli.session.rig_target import RigMotion, RigTarget
from calib.errors import CalibrationMissing
from hw.errors import HandError
from hw.kinematics import forward
from hw.ports import Arm, ArmWrapper
from hw.types import Execution, JointPath
from perception.board.types import Board
from perception.errors import PerceptionError
from sim.adaptation.stages import TrialKey
from sim.errors import NotExecutable
from sim.tasks import get_task

pytestmark = pytest.mark.usefixtures("kim")
SCOOPING = get_task("scooping")
STILL = JointPath(np.linspace(0.0, 0.01, 11), np.tile(READY_RAD, (11, 1)))
KEY = TrialKey(1, 0)


def resolved(place: Path, text: str = RIG) -> Resolved:
    write_rig(place.parent / "home", text)
    return config.load({"hw": "panda", "task": "scooping"})


@contextmanager
def opened(place: Path, devices: ToyDevices, text: str = RIG) -> Iterator[RigTarget]:
    there = resolved(place, text)
    calibrated(there)
    with open_trials(there.config, there.places, SCOOPING, devices.drivers()) as real:
        yield real


def beside(real: RigTarget) -> PersonBeside:
    assert isinstance(real.rig.attendant, PersonBeside)
    return real.rig.attendant


def test_without_a_calibration_no_device_is_touched(place):
    there = resolved(place)
    with (
        pytest.raises(CalibrationMissing, match="adaptsim calibrate --hw panda"),
        open_trials(there.config, there.places, SCOOPING, Untouched()),  # type: ignore[arg-type]
    ):
        pass


def test_without_a_terminal_no_device_is_touched(place, monkeypatch, refused):
    calibrated(resolved(place))
    monkeypatch.undo()
    monkeypatch.chdir(place)
    monkeypatch.setenv("ADAPTSIM_HOME", str(place.parent / "home"))
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert "a person at a terminal confirms it; --yes does not" in refused(
        2, "run-iteration", "--task", "scooping", "--hw", "panda", "--yes"
    )
    assert not (place.parent / "home/data/sessions").exists()


def test_a_broken_rig_file_ends_with_2_and_a_missing_driver_with_3(place, monkeypatch, refused):
    calibrated(resolved(place))
    run = ["rollout", "--task", "scooping", "--hw", "panda"]
    for lacking in ("arm", "hand", "camera", "pedal", "balance"):
        devices = ToyDevices(lacking=lacking)
        monkeypatch.setattr("adaptsim_cli.bench.devices.drivers.makers_drivers", devices.drivers)
        assert f"pip install {lacking}-driver==1.0" in refused(3, *run)
        assert devices.arm is None or not devices.arm.executed
    write_rig(place.parent / "home", RIG.replace("mass_kg = 0.12", "mass_kg = 12"))
    assert "tools.scooping.payload.mass_kg = 12 kg: it must be at most 3.0" in refused(2, *run)
    (place.parent / "home" / "rig.toml").unlink()
    assert "there is no rig file" in refused(2, *run)


def test_the_devices_are_given_what_the_rig_file_says(place):
    devices = ToyDevices()
    with opened(place, devices) as real:
        arm, camera = devices.opened["arm"], devices.opened["camera"]
        assert list(devices.opened) == ["pedal", "hand", "arm", "camera", "balance"]
        assert arm["settings"].host == "172.16.0.2"
        assert arm["settings"].payload.mass_kg == 0.12
        assert arm["pedal"] is devices.pedal
        assert [box.name for box in arm["cell"].keep_out] == ["the camera", "the person's side (left)"]
        assert (camera["part"].serial, camera["infrared"]) == ("000123", False)
        assert devices.opened["pedal"]["port"] == "/dev/ttyACM0"
        assert real.moves and real.needs_consent
        assert "lab-1, panda at 172.16.0.2" in real.title
        assert beside(real).mounted_task.hardware.X_FT[2, 3] != SCOOPING.require_hardware().X_FT[2, 3], (
            "the tool hangs where it was touched off"
        )
        assert all(check.ok for check in real.checks())


def test_a_session_gets_the_task_as_it_is_mounted(place):
    there = resolved(place)
    calibrated(there)
    with opening.open_parts(there.config, place, ToyDevices().drivers()) as parts:
        assert isinstance(parts.target, RigTarget)
        np.testing.assert_array_equal(
            parts.task.require_hardware().X_FT, beside(parts.target).mounted_task.hardware.X_FT
        )
        assert parts.provenance.world_sha256 == ""
        assert parts.provenance.calibration == "calibrated"


def test_the_arm_goes_home_before_the_object_is_placed(place, monkeypatch):
    devices = ToyDevices(balance=ToyBalance([None, 0.4123]))
    typing(monkeypatch, "panda", "", "y", "", "", "")
    with opened(place, devices) as real:
        screen = quiet()
        person = beside(real)
        object.__setattr__(person, "screen", screen)
        person.arm.release.screen = screen
        person.scales._screen = screen
        with pytest.raises(PerceptionError):  # the scripted camera shows a dark room
            real.place(SCOOPING.reference_context, KEY, Attended(screen))
        assert len(devices.arm.executed) == 1
        np.testing.assert_allclose(devices.arm.state().q_rad, beside(real).mounted_task.home_rad, atol=AT_HOME_RAD)
        assert devices.arm.executed[0].duration_s > 1.0, "slowly"
        text = said(screen)
        assert text.index("goes home") < text.index("on the balance") < text.index("Put the piece of food at")
        assert "412.3 g" in text
        facts = person.facts()
        assert facts.object_mass_kg == 0.4123
        assert facts.weighed is not None


def test_who_stops_at_the_way_home_moves_nothing(place, monkeypatch):
    devices = ToyDevices()
    typing(monkeypatch, "panda", "q")
    with opened(place, devices) as real, pytest.raises(StoppedByOperator):
        real.place(SCOOPING.reference_context, KEY, Attended(quiet()))
    assert devices.arm.executed == []


def test_a_fault_is_cleared_only_on_a_word(place, monkeypatch):
    devices = ToyDevices()
    with opened(place, devices) as real:
        devices.arm._fault = "reflex"
        typing(monkeypatch, "")
        assert [check.name for check in real.checks() if not check.ok] == ["arm"]
        typing(monkeypatch, "recover")
        assert all(check.ok for check in real.checks())
        assert devices.arm.executed == []


def test_a_lab_without_pedal_and_balance_asks_less(place):
    devices = ToyDevices()
    text = RIG[: RIG.index("[pedal]")] + RIG[RIG.index("[person]") :]
    with pytest.raises(UsageError, match="pedal"), opened(place, devices, text):
        pass
    with opened(place, devices, text + waivers("pedal", "hand")) as real:
        assert set(devices.opened) == {"arm", "camera"}
        assert devices.opened["arm"]["pedal"] is None
        assert beside(real).scales is None
        facts = beside(real).facts()
        assert {waiver.safeguard for waiver in facts.waivers} == {*WAIVED, "pedal", "hand"}
        assert facts == RigFacts(pedal="waived", tool="waived", operator="Kim", waivers=facts.waivers)


def test_a_tool_that_is_lost_or_slips_is_noticed_before_the_next_motion(place, monkeypatch):
    devices = ToyDevices()
    typing(monkeypatch, "panda")
    with opened(place, devices) as real:
        assert all(check.ok for check in real.checks())
        real.rig.arm.execute(STILL)
        assert beside(real).facts().tool_width_m == HANDLE_M
        for width_m, holds, why in (
            (HANDLE_M - 0.0012, True, "has slipped: the fingers are 43.8 mm apart, 45.0 mm at first"),
            (
                0.0,
                False,
                "does not hold the scooping tool .*clear it away.* adaptsim touch-off --task scooping --hw panda",
            ),
        ):
            devices.hand.width_m, devices.hand.holds = width_m, holds
            with pytest.raises(HandError, match=why):
                real.rig.arm.execute(STILL)
            assert [check.name for check in real.checks() if not check.ok] == ["tool"]
        assert len(devices.arm.executed) == 1
        devices.hand.width_m, devices.hand.holds = HANDLE_M, True
        real.rig.arm.execute(STILL)


def test_weighing_may_be_left_out(monkeypatch):
    typing(monkeypatch, "n")
    scales = Scales(ToyBalance([]), quiet())
    scales.weigh("bottle")
    scales.weigh("bottle")
    assert scales.facts == RigFacts()


def test_a_tool_that_leaves_the_work_area_is_not_planned(place):
    write_rig(place.parent / "home", RIG + "[table]\nx_m = [0.3, 0.7]\n")
    there = mounted_task_of(SCOOPING, read(place.parent / "home" / "rig.toml"), np.zeros(7))
    with pytest.raises(NotExecutable, match=r"outside the work area.*\[table\] of the rig file"):
        there.paths(there.hardware.plan(SCOOPING.reference_context, SCOOPING.action.denormalise(np.full(3, 0.5))))


def test_a_calibration_opens_the_same_lab_with_the_board(place, monkeypatch):
    there, devices = resolved(place), ToyDevices()
    open_rig = calibration_in_use.open_calibration_rig
    with open_rig(there.config, Board(), None, devices.drivers()) as rig:
        assert rig.is_real
        assert rig.key == "panda-lab-1"
        assert rig.rough_X_BC is None, "without an earlier calibration the arm is guided by hand"
        assert devices.opened["camera"]["infrared"]
        assert [box.name for box in devices.opened["arm"]["cell"].keep_out] == ["the person's side (left)"]
        assert devices.opened["arm"]["cell"].tool.name == "calibration board"
        typing(monkeypatch, "q")
        with pytest.raises(StoppedByOperator):
            rig.arm.execute(STILL)
    calibrated(there)
    known = calibration_in_use.current_calibration(there.config, there.places)
    with open_rig(there.config, Board(), known, devices.drivers()) as rig:
        assert rig.rough_X_BC is not None
        assert devices.opened["arm"]["cell"].keep_out[0].name == "the camera"


def test_a_fault_is_cleared_on_a_word_before_a_calibration(place, monkeypatch):
    there, devices = resolved(place), ToyDevices()
    faulty = devices.drivers_of_a_stopped_arm()
    for answer, fault in (("", "cartesian_reflex"), ("recover", None)):
        typing(monkeypatch, answer)
        with calibration_in_use.open_calibration_rig(there.config, Board(), None, faulty) as rig:
            assert rig.arm.state().fault == fault


def test_a_calibration_is_planned_over_the_table_of_the_rig_file(place):
    home_rad = np.array(calibration_in_use.BOARD_HOME_RAD)
    low_rad = np.array([*home_rad[:1], -0.05, *home_rad[2:]])  # the board 47 mm over z = 0
    for text, free in (("", True), ("[table]\nheight_m = 0.05\n", False)):
        there, devices = resolved(place, RIG + text), ToyDevices()
        with calibration_in_use.open_calibration_rig(there.config, Board(), None, devices.drivers()) as rig:
            assert (devices.opened["arm"]["cell"].table.height_m == 0.0) == free
            (found,) = rig.ways.postures(forward(low_rad[None]))
            assert (found is not None) == free
            if free:
                rig.ways.way(home_rad, low_rad)
            else:
                with pytest.raises(NotExecutable, match="table would overlap"):
                    rig.ways.way(home_rad, low_rad)


def test_a_contact_is_planned_against_the_threshold_that_the_arm_itself_keeps_to(place):
    devices = ToyDevices()
    sideways = "[arm.collision]\nforce_collision_N = [30.0, 80.0, 80.0, 40.0, 40.0, 40.0]\n"
    with opened(place, devices, RIG + sideways) as real:
        assert devices.opened["arm"]["settings"].collision.contact_force_limit_N == 30.0
        assert beside(real).mounted_task.cell.stops_at_N == devices.opened["arm"]["cell"].stops_at_N == 30.0


def test_no_recording_runs_while_the_arm_waits_for_its_pedal():
    lab, waited = ToyLab(0), list[bool]()
    target = rig_target(toy_parts(lab))
    rig = replace(target.rig, await_enabled=lambda what, path: waited.append(lab._recording is None))
    executed(replace(target, rig=rig))
    assert waited == [True] * 3


def executed(target: RigTarget) -> RigMotion:
    """One motion to one place."""
    placed = target.place(np.array([0.68, 0.0]), KEY, unattended())
    return target.execute(target.plan(placed, np.array([0.5])))


def test_a_tool_lost_during_the_motion_keeps_its_recording(tmp_path: Path) -> None:
    lab = ToyLab(0)
    target, moved = toy_parts(lab).target, list[JointPath]()
    assert isinstance(target, RigTarget)

    class Watched(ArmWrapper[Arm]):
        def execute(self, path: JointPath) -> Execution:
            moved.append(path)
            if len(moved) == 3:
                raise HandError("the hand does not hold the tool")
            return self._arm.execute(path)

    rig = replace(target.rig, arm=Watched(target.rig.arm))
    done = executed(replace(target, rig=rig))
    assert isinstance(done.stopped, HandError)
    (tmp_path / "recording.mcap").write_bytes(done.files()["recording.mcap"])
    assert len(recording.read(tmp_path / "recording.mcap").execution.t_s), "the motion itself was recorded"


class Weighed:
    """An attendant who has nothing to do but to say what the object weighs."""

    def recover(self) -> None: ...

    def prepare(self, what: str) -> None: ...

    def facts(self) -> RigFacts:
        return RigFacts(object_mass_kg=0.5)


def test_what_the_rig_says_is_kept_beside_the_trial(tmp_path: Path) -> None:
    parts = toy_parts(ToyLab(0))
    target = rig_target(parts)
    rig = replace(target.rig, attendant=Weighed())
    files = executed(replace(target, rig=rig)).files()
    assert json.loads(files["rig.json"])["object_mass_kg"] == 0.5
