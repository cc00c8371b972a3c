"""Every check of the doctor, over readings that are made up; and the checklist as it is shown."""

from __future__ import annotations

import io
import json
import os
import pty
import socket
import threading
import tty
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from arm_urdf import limited
from own_judge import MAKERS
from real_lab import READY_RAD, RIG, calibrated, calibration, write_rig
from replies import output
from rich.console import Console

from adaptsim_cli import config
from adaptsim_cli.bench.doctor import checks, readings, table
from adaptsim_cli.bench.doctor.checks import CHECKS
from adaptsim_cli.bench.doctor.table import Examined, Finding, Severity, ok
from adaptsim_cli.bench.rig_file.description import CameraPart, RigDescription
from adaptsim_cli.bench.rig_file.devices import BalancePart, PedalPart
from adaptsim_cli.commands import app
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen.console import Screen
from calib.saved import SavedCalibration
from hw.camera.probe import FoundDevice, ProbeReport
from hw.camera.process import CameraProcess, served
from hw.errors import DeviceUnavailable
from hw.franka.driver import Reading
from hw.franka.identity import ArmReport, mass_matrix
from hw.franka.playback import Rhythm
from hw.franka.process import Inspection
from hw.franka.starting import Rehearsal
from hw.mass import NOTHING
from hw.serial.pedal_protocol import PERIOD_S, line_for

OK, ADVICE, MISSING, SKIPPED = Severity.OK, Severity.ADVICE, Severity.MISSING, Severity.SKIPPED


def kinect(*serials: str, engine: bool = True, error: str | None = None) -> ProbeReport:
    devices = tuple(FoundDevice(i, serial, "colour 1.6") for i, serial in enumerate(serials))
    return ProbeReport("libk4a.so.1.4", "1.4.1", "Microsoft", engine, devices, error, "plug it in" if error else None)


def bolt(firmware: str) -> ProbeReport:
    """A Femto Bolt through its maker's libk4a."""
    devices = (FoundDevice(0, "34", f"colour {firmware}, depth {firmware}"),)
    return ProbeReport("libk4a.so.1.4", "2.0.11", "Orbbec", True, devices, None, None)


def seen(
    mode: str = "Idle", missed: int = 0, gap_s: float = 0.0012, notes: tuple[str, ...] = (), priority: int = 80
) -> Inspection:
    q_rad = tuple(READY_RAD)
    return Reading(q_rad, q_rad, (0.0,) * 7, mode), Rhythm(1000, missed, gap_s, 5, priority), notes


HAVE = {"numpy": "2.4.0", "torch": "2.13.0", "pylibfranka": "0.21.3", "panda-python": "1.0.0"}


NARROW = limited("fr3", [*list(zip(*MAKERS["fr3"][:3], strict=True))[:6], (-3.0508, 2.0, 5.26)])


def reported(model: str, urdf: str = "") -> ArmReport:
    """What an arm of that model says of itself."""
    return ArmReport(READY_RAD, mass_matrix(model, READY_RAD, NOTHING), NOTHING, urdf)


def always(value: object) -> Callable[..., object]:
    return lambda *_, **__: value


def read_only(folder: Path) -> None:
    raise OSError(30, "Read-only")


def rig_with(**parts: object) -> RigDescription:
    return RigDescription("lab", {"model": "fr3", "address": "127.0.0.1"}, **parts)  # type: ignore[arg-type]


def lab_of(place: Path, hw: str = "fr3", **parts: object) -> Examined:
    """A lab whose rig file can be read."""
    lab = Examined(config.load({"hw": hw}, {"ADAPTSIM_HOME": str(place)}, place))
    vars(lab)["rig"] = rig_with(**parts)
    lab.findings |= {name: ok("") for name in ("rig file", "network", "arm", "arm model", "camera")}
    return lab


CALIBRATION = "adaptsim_cli.bench.doctor.checks.current_calibration"
PEDAL = {"adaptsim_cli.bench.doctor.checks.serial_ports": always(("/dev/b",)), "rig": {"pedal": PedalPart("/dev/a")}}


def aged(days: int) -> SavedCalibration:
    return calibration((datetime.now(UTC) - timedelta(days=days)).isoformat())


@pytest.mark.parametrize(
    ("name", "reading", "verdict", "says"),
    [
        ("python", {"platform.python_version": always("3.10.2")}, MISSING, "3.10.2, needed <3.14,>=3.11"),
        ("disk space", {"shutil.disk_usage": always(SimpleNamespace(free=1e8))}, MISSING, "MB needed (min_free_mb)"),
        ("packages", {"installed": HAVE.get}, MISSING, "mcap is not installed, needed >=1.3"),
        ("packages", {"installed": always("999")}, MISSING, "opencv-python-headless 999, needed <5,>=4.13"),
        ("libraries", {"perception.raycasting.loads": always(True)}, OK, "find theirs"),
        ("libraries", {"perception.raycasting.loads": lambda name: "usb" not in name}, MISSING, "libusb-1.0-0"),
        ("libraries", {"installed": lambda name: "1" if name == "drake" else None}, OK, "Drake finds its"),
        ("libraries", {"installed": always(None)}, MISSING, "neither Open3D nor Drake is installed"),
        ("OpenCV", {"installed": lambda name: "4.13" if name == "opencv-python" else None}, OK, "opencv-python alone"),
        ("OpenCV", {"installed": always("4.13")}, ADVICE, "opencv-contrib-python write the same module cv2"),
        ("OpenCV", {"installed": always(None)}, MISSING, "no package with the module cv2"),
        ("driver", {"installed": HAVE.get}, OK, "speaks interface 10: arm system 5.9.0"),
        ("driver", {"installed": always("0.1")}, MISSING, "pylibfranka 0.1 is installed, but 0.21.3 was tested"),
        ("driver", {"installed": always(None)}, MISSING, "pylibfranka is not installed; it speaks interface 10"),
        ("disk speed", {"write_speed": always((300.0, 0.004))}, OK, "300 MB/s, a record is safe after 4 ms"),
        ("disk speed", {"write_speed": always((9.0, 0.004))}, ADVICE, "recommended: 20 MB/s"),
        ("disk speed", {"write_speed": always((300.0, 0.5))}, ADVICE, "safe after 500 ms"),
        ("disk speed", {"write_speed": read_only}, MISSING, "to: Read-only"),
        ("real-time kernel", {"kernel": always(("6.1-rt", True))}, OK, "6.1-rt"),
        ("real-time kernel", {"kernel": always(("6.1", False))}, MISSING, "communication_constraints_violation"),
        ("priorities", {"limits": always((99, float("inf"), False))}, OK, "may ask"),
        ("priorities", {"limits": always((0, 8.0, True))}, OK, "may ask"),
        ("priorities", {"limits": always((0, 8.0, False))}, MISSING, "rtprio 0, 99 needed; memlock 8 MB, 100 ne"),
        ("priorities", {"limits": always((99, 8.0, False))}, MISSING, "memlock 8 MB"),
        ("priorities", {"limits": always((80, 1e3, False))}, MISSING, "rtprio 80, 99 needed"),
        ("clock frequency", {"governors": always(())}, OK, "no frequency governor"),
        ("clock frequency", {"governors": always(("performance",) * 2)}, OK, "every core"),
        ("clock frequency", {"governors": always(("performance", "powersave"))}, ADVICE, "powersave on 1 of 2 cores"),
        ("network", {"round_trips": always(((0.2, 0.3, 0.2), 0, ""))}, OK, "0.20 ms, 0.30 ms at worst"),
        ("network", {"round_trips": always(((0.2, 3.0), 0, ""))}, ADVICE, "3.00 ms at worst, 0 of 2 lost"),
        ("network", {"round_trips": always(((0.2,), 1, "timed out"))}, ADVICE, "1 of 2 lost"),
        ("network", {"round_trips": always(((), 2, "timed out"))}, MISSING, "does not answer: timed out"),
        ("arm", {"arm": always(seen())}, OK, "fr3 answers over FCI, interface 5, mode Idle, joints 0.00 -0.79"),
        ("arm", {"arm": always(seen(missed=3))}, OK, "1000 states at 1 kHz, 3 missed, longest gap 1.2 ms"),
        ("arm", {"arm": always(seen(missed=80))}, ADVICE, "80 missed, longest gap 1.2 ms (at most 5 % and 20 ms)"),
        ("arm", {"arm": always(seen(gap_s=0.03))}, ADVICE, "longest gap 30.0 ms (at most"),
        ("arm", {"arm": always(seen(notes=("memory is not locked",)))}, ADVICE, "0 missed"),
        ("arm", {"arm": always(seen())}, OK, "the player runs at real-time priority 80"),
        ("arm", {"arm": always(seen(priority=99)), "kernel": always(("6.1-rt", True))}, MISSING,
         "longest gap 1.2 ms; a priority of 80 is needed"),
        ("arm", {"arm": always(seen(priority=0)), "kernel": always(("6.1", False))}, OK, "real-time priority 0"),
        ("arm", {"arm": always(seen(mode="UserStopped"))}, MISSING, "would not move: the stop button is pressed"),
        ("arm model", {"arm_report": always(reported("fr3"))}, OK, "an FR3: its mass matrix is that of fr3; its joint"),
        ("arm model", {"arm_report": always(reported("fr3v2"))}, MISSING, "says fr3, and it is an FR3 v2"),
        ("arm model", {"arm_report": always(ArmReport())}, ADVICE, "compare its type plate with the rig file"),
        ("arm model", {"arm_report": always(reported("fr3", NARROW))}, ADVICE, "joint 7: the arm says at most 2.0"),
        ("arm model", {"arm_report": always(reported("fr3", "<robot"))}, MISSING, "description cannot be read"),
        ("starts", {"rehearsal": always(Rehearsal(10, 0.05, 0.1, 60.0, 1e-6))}, OK, "10 starts and 60 s at rest:"),
        ("starts", {"rehearsal": always(Rehearsal(10, 0.2, 0.1, 60.0, 1e-6))}, ADVICE, "unwatched_s 0.2 s of 0.2"),
        ("starts", {"rehearsal": always(Rehearsal(10, 0.05, 0.1, 60.0, 5e-5))}, ADVICE, "held_rad 5e-05 rad of 3e-05"),
        ("starts", {"rehearsal": always(Rehearsal(10, 0.4, 0.1, 60.0, 1e-6))}, MISSING, "unwatched_s needs more than"),
        ("camera", {"cameras": always(kinect("12"))}, OK, "12, firmware colour 1.6, Microsoft library 1.4.1"),
        ("camera", {"cameras": always(bolt("1.1.1"))}, MISSING, "its maker withdrew 1.1.1, whose time stamps overflow"),
        ("camera", {"cameras": always(bolt("1.1.2"))}, OK, "firmware colour 1.1.2, depth 1.1.2, Orbbec library 2.0.11"),
        ("camera", {"cameras": always(kinect("12", "34"))}, MISSING, "several cameras are plugged in: 12, 34"),
        ("camera", {"cameras": always(kinect("12", engine=False))}, MISSING, "no depth engine"),
        ("camera", {"cameras": always(kinect(error="no camera is seen"))}, MISSING, "no camera is seen"),
        ("camera", {"cameras": always(kinect("12", "34")), "rig": {"camera": {"serial": "34"}}}, OK, "34"),
        ("camera", {"cameras": always(kinect("12")), "rig": {"camera": {"serial": "34"}}}, MISSING,
         "34 is not plugged in; found: 12"),
        ("pedal", {"port": always((False, "uucp")), **PEDAL}, MISSING, "belongs to the group uucp"),
        ("pedal", {"port": always((False, "uucp")), **PEDAL}, MISSING, "sudo usermod -aG uucp $USER"),
        ("pedal", {"port": always((False, None)), **PEDAL}, MISSING, "/dev/a is not there"),
        ("pedal", {"port": always((False, None)), **PEDAL}, MISSING, "there now: /dev/b"),
        ("calibration", {CALIBRATION: always(None)}, MISSING, "this rig has no calibration"),
        ("calibration", {CALIBRATION: always(aged(1))}, OK, "± 0.5 mm, ± 0.05°, 1 day old"),
        ("calibration", {CALIBRATION: always(aged(59))}, ADVICE, "59 days old"),
        ("calibration", {CALIBRATION: always(aged(-5))}, ADVICE, "in the future"),
    ],
)  # fmt: skip
def test_each_check_over_its_readings(
    name: str,
    reading: dict[str, Any],
    verdict: Severity,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A reading is that of `readings`, or a whole name; "rig" are parts of the rig file."""
    for what, made_up in reading.items():
        if what != "rig":
            monkeypatch.setattr(what if "." in what else f"adaptsim_cli.bench.doctor.readings.{what}", made_up)
    found = (CHECKS | checks.MEASUREMENTS)[name](lab_of(tmp_path, **reading.get("rig", {})))
    assert found.verdict is verdict
    assert says in f"{found.detail}; {found.fix}"
    assert bool(found.fix) == (verdict in (ADVICE, MISSING)), "a remedy for what needs one, and for nothing else"


@pytest.mark.long
@pytest.mark.parametrize(
    ("wrong", "verdicts", "says"),
    [
        ("", (OK, ADVICE), "synchronised frames in 0.5 s"),
        ("hangs 24", (MISSING,), "camera's driver has not answered for 3 s"),
    ],
)
def test_the_camera_streams_or_its_driver_is_given_up(
    wrong: str, verdicts: tuple[Severity, ...], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(__file__).parents[4]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(root / "tests" / "support"), str(root))))
    monkeypatch.setenv("ADAPTSIM_STAGED_KINECT", wrong)
    camera = CameraProcess(start=served("fake_k4a:live"), step_s=60.0)
    monkeypatch.setattr(CameraPart, "camera", always(camera))
    found = CHECKS["camera images"](lab_of(tmp_path))
    assert found.verdict in verdicts
    assert says in found.detail
    if not wrong:
        assert int(found.detail.split()[0]) >= 10


def test_a_device_that_does_not_answer_is_named_with_its_own_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def silent(*_: object) -> None:
        raise DeviceUnavailable("the arm has not sent anything")

    monkeypatch.setattr(readings, "arm", silent)
    found = CHECKS["arm"](lab_of(tmp_path))
    assert (found.verdict, found.detail) == (MISSING, "the arm has not sent anything")
    monkeypatch.setattr(readings, "arm", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):  # a defect of the program is not taken for a device
        CHECKS["arm"](lab_of(tmp_path))


def test_round_trips_to_a_port_that_listens_and_to_one_that_does_not() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        open_trips = readings.round_trips("127.0.0.1", port, tries=5)
    assert (len(open_trips[0]), open_trips[1]) == (5, 0)
    refused = readings.round_trips("127.0.0.1", port, tries=5)
    assert (len(refused[0]), refused[1]) == (5, 0), "a refusal is an answer"
    assert "no such address" in readings.round_trips("not an address", tries=5)[2]


def test_the_disk_is_measured_and_left_as_it_was(place: Path) -> None:
    assert min(readings.write_speed(place)) > 0.0
    assert list(place.iterdir()) == []
    with pytest.raises(OSError, match="No such"):
        readings.write_speed(place / "none")
    assert readings.existing(place / "a" / "b") == place


def test_ports_and_governors_are_read_from_the_file_system(tmp_path: Path) -> None:
    assert readings.port(tmp_path / "none") == (False, None)
    assert readings.port(tmp_path)[0]
    for core in (0, 1):
        (tmp_path / f"cpu{core}/cpufreq").mkdir(parents=True)
        (tmp_path / f"cpu{core}/cpufreq/scaling_governor").write_text("powersave\n")
    assert readings.governors(tmp_path) == ("powersave", "powersave")
    assert readings.installed("no-such-package") is None


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: the device's end, and the name of the program's."""
    device, end = pty.openpty()
    tty.setraw(device)
    tty.setraw(end)
    yield device, os.ttyname(end)
    os.close(device)
    os.close(end)


@pytest.mark.long
def test_a_pedal_that_speaks_is_heard_and_one_that_does_not_is_named(line: tuple[int, str], tmp_path: Path) -> None:
    device, port = line
    over = threading.Event()

    def speak() -> None:
        counter = 0
        while not over.wait(PERIOD_S):
            os.write(device, line_for(counter, False))
            counter += 1

    speaker = threading.Thread(target=speak)
    speaker.start()
    lab = lab_of(tmp_path, pedal=PedalPart(port))
    try:
        heard = CHECKS["pedal"](lab)
    finally:
        over.set()
        speaker.join()
    assert heard.verdict is OK
    assert "protocol version 1; the pedal is released" in heard.detail
    silent = CHECKS["pedal"](lab)
    assert silent.verdict is MISSING
    assert "has not sent anything" in silent.detail
    assert CHECKS["pedal"](lab_of(tmp_path, pedal=PedalPart("/dev/none"))).verdict is MISSING


def test_a_balance_that_speaks_is_heard(line: tuple[int, str], tmp_path: Path) -> None:
    device, port = line

    def answer() -> None:
        for _ in range(2):  # a mass is asked for twice
            if os.read(device, 16) == b"S\r\n":
                os.write(device, b"S S     12.345 g\r\n")

    scale = threading.Thread(target=answer, daemon=True)  # nobody may ask it
    scale.start()
    found = CHECKS["balance"](lab_of(tmp_path, balance=BalancePart(port, "mt-sics")))
    assert found.verdict is OK
    assert "0.0123 kg on it" in found.detail
    assert CHECKS["balance"](lab_of(tmp_path)).verdict is SKIPPED


@pytest.fixture
def place(place: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("COLUMNS", "80")
    return place


def test_the_simulated_lab_needs_no_device(place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert app.run(["doctor", "--json"]) == 0
    out, _ = capfd.readouterr()
    found = json.loads(out)
    verdicts = {check["name"]: check["verdict"] for check in found["checks"]}
    assert found["ready"]
    assert verdicts["checkpoint"] == verdicts["packages"] == "ok"
    assert {verdicts[name] for name in ("pedal", "camera", "network", "real-time kernel")} == {"skipped"}
    assert list(place.iterdir()) == [], "it leaves nothing behind"


def test_a_world_and_a_checkpoint_that_are_not_there(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_CHECKPOINT", str(place / "none"))
    found = tuple(checks.examine(config.load({"world": "narnia"})))
    wrong = {finding.name: finding for finding in found if finding.verdict is MISSING}
    assert set(wrong) == {"checkpoint", "world"}
    assert "no world 'narnia'" in wrong["world"].detail


@pytest.mark.long
def test_a_real_lab_is_looked_at_device_by_device(
    place: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert app.run(["doctor", "--hw", "panda", "--json"]) == 3
    out, err = capfd.readouterr()
    assert {c["name"]: c["verdict"] for c in json.loads(out)["checks"]}["rig file"] == "missing"
    assert "adaptsim setup --hw panda" in out
    assert "not ready:" in err
    write_rig(place.parent / "home", RIG.replace("172.16.0.2", "127.0.0.1"))
    monkeypatch.setenv("ADAPTSIM_K4A_LIBRARY", str(place / "none.so"))
    calibrated(config.load({"hw": "panda"}))
    assert app.run(["doctor", "--hw", "panda", "--json"]) == 3
    checks = {c["name"]: c for c in json.loads(capfd.readouterr().out)["checks"]}
    assert list(checks) == list(CHECKS)
    assert checks["rig file"]["verdict"] == "ok"
    assert checks["network"]["verdict"] in ("ok", "advice")
    assert checks["arm"]["verdict"] == "missing"
    assert "activate FCI in Desk" in checks["arm"]["fix"]
    assert checks["pedal"]["detail"] == "/dev/ttyACM0 is not there"
    assert checks["camera"]["verdict"] == "missing"
    assert checks["calibration"]["verdict"] in ("ok", "advice")
    assert checks["motion"]["verdict"] == "ok"
    assert "% of the tightest limit" in checks["motion"]["detail"]


def test_remedies_stand_whole_below_a_table_that_fits_the_screen(place: Path) -> None:
    file = io.StringIO()
    screen = Screen(console=Console(file=file, width=80, highlight=False, markup=False))
    found = (
        Finding(OK, "3.11", group="program", name="python"),
        Finding(MISSING, "it is not installed", "pip install panda-python==1.1.1", "program", "driver"),
        Finding(ADVICE, "slow", "sudo cpupower frequency-set -g performance", "machine", "clock frequency"),
        Finding(SKIPPED, "hw = fake needs none", group="devices", name="pedal"),
    )
    settings = config.load({}).config
    screen.print(table.checklist(found, settings))
    reply = table.reply(found, settings)
    with pytest.raises(PreflightFailed, match="not ready: driver"):
        screen.end("doctor", reply)
    shown, _, rest = file.getvalue().partition("Missing:")
    assert max(len(line.rstrip()) for line in shown.splitlines()) <= 80
    assert [line[0] for line in shown.splitlines() if line[:1].strip()] == ["✓", "✗", "!", "–"]
    assert "  driver: pip install panda-python==1.1.1\n" in rest
    assert "  clock frequency: sudo cpupower frequency-set -g performance\n" in rest
    assert "Ready:" not in rest
    assert not output("doctor", reply)["ready"]
    assert table.reply(found[:1], settings).failure is None
