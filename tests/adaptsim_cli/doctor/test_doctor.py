"""Every check of the doctor, over readings that are made up; and the checklist as it is examination."""

from __future__ import annotations

import io
import json
import os
import pty
import socket
import threading
import tty
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from real_lab import READY_RAD, RIG, calibrated, calibration, write_rig
from rich.console import Console

from adaptsim_cli import app, config
from adaptsim_cli.devices.rig_file.description import BalancePart, PedalPart, RigDescription
from adaptsim_cli.devices.rig_file.reading import read
from adaptsim_cli.doctor import checks, examination, readings
from adaptsim_cli.doctor.checks import Finding, Severity, ok
from adaptsim_cli.doctor.readings import Limits, Port, RoundTrips, WriteSpeed
from adaptsim_cli.errors import PreflightFailed
from adaptsim_cli.screen.console import Screen
from hw.camera.k4a_device import ColourSettings
from hw.camera.probe import FoundDevice, ProbeReport
from hw.camera.process import CameraProcess
from hw.errors import DeviceUnavailable
from hw.franka.driver import Reading
from hw.franka.inspection import Inspection
from hw.franka.messages import Rhythm
from hw.serial.pedal_protocol import PERIOD_S, line_for

NOW = datetime(2026, 3, 1, tzinfo=UTC)
OK, ADVICE, MISSING, SKIPPED = Severity.OK, Severity.ADVICE, Severity.MISSING, Severity.SKIPPED


def absent(package: str) -> None:
    return None


def kinect(*serials: str, engine: bool = True, error: str | None = None) -> ProbeReport:
    devices = tuple(FoundDevice(i, serial, "colour 1.6") for i, serial in enumerate(serials))
    return ProbeReport("libk4a.so.1.4", "1.4.1", "Microsoft", engine, devices, error, "plug it in" if error else None)


def seen(mode: str = "Idle", missed: int = 0, gap_s: float = 0.0012, notes: tuple[str, ...] = ()) -> Inspection:
    q_rad = tuple(READY_RAD)
    return Inspection(Reading(q_rad, q_rad, (0.0,) * 7, mode), Rhythm(1000, missed, gap_s, 5), notes)


HAVE = {"numpy": "2.4.0", "torch": "2.13.0", "pylibfranka": "0.21.3", "panda-python": "1.0.0"}


@pytest.mark.parametrize(
    ("finding", "verdict", "says"),
    [
        (checks.python("3.11.7", "<3.13,>=3.11"), OK, "3.11.7"),
        (checks.python("3.10.2", "<3.13,>=3.11"), MISSING, "3.10.2, needed <3.13,>=3.11"),
        (checks.packages(["numpy<2.5,>=2.2", "dask; extra == 'cluster'"], HAVE.get), OK, "with the required versions"),
        (checks.packages(["numpy<2.3", "mcap>=1.3"], HAVE.get), MISSING, "numpy 2.4.0, needed <2.3; mcap is not inst"),
        (checks.libraries(lambda _: True), OK, "find theirs"),
        (checks.libraries(lambda name: "usb" not in name), MISSING, "libusb-1.0-0"),
        (checks.driver("fr3", HAVE.get), OK, "speaks interface 10: arm system 5.9.0"),
        (checks.driver("panda", HAVE.get), MISSING, "panda-python 1.0.0 is installed, tested is 1.1.1"),
        (checks.driver("fr3", absent), MISSING, "pylibfranka is not installed; it speaks interface 10"),
        (checks.disk("/data", 900, 500), OK, "0.9 GB free"),
        (checks.disk("/data", 100, 500), MISSING, "100 MB free in /data, 500 MB needed (min_free_mb)"),
        (checks.disk_speed("/data", WriteSpeed(300.0, 0.004)), OK, "300 MB/s, a record is safe after 4 ms"),
        (checks.disk_speed("/data", WriteSpeed(9.0, 0.004)), ADVICE, "recommended: 20 MB/s"),
        (checks.disk_speed("/data", WriteSpeed(300.0, 0.5)), ADVICE, "safe after 500 ms"),
        (checks.disk_speed("/data", WriteSpeed(None, problem="Read-only")), MISSING, "written to: Read-only"),
        (checks.realtime_kernel("6.1-rt", True), OK, "6.1-rt"),
        (checks.realtime_kernel("6.1", False), MISSING, "communication_constraints_violation"),
        (checks.priorities(Limits(99, float("inf"), False)), OK, "may ask"),
        (checks.priorities(Limits(0, 8e6, True)), OK, "may ask"),
        (checks.priorities(Limits(0, 8e6, False)), MISSING, "rtprio 0, 80 needed; memlock 8 MB, 100 needed"),
        (checks.priorities(Limits(99, 8e6, False)), MISSING, "memlock 8 MB"),
        (checks.governor(()), OK, "no frequency governor"),
        (checks.governor(("performance",) * 2), OK, "every core"),
        (checks.governor(("performance", "powersave")), ADVICE, "powersave on 1 of 2 cores"),
        (checks.network("arm", RoundTrips((0.2, 0.3, 0.2), 0)), OK, "answers in 0.20 ms, 0.30 ms at worst"),
        (checks.network("arm", RoundTrips((0.2, 3.0), 0)), ADVICE, "3.00 ms at worst, 0 of 2 lost"),
        (checks.network("arm", RoundTrips((0.2,), 1)), ADVICE, "1 of 2 lost"),
        (checks.network("arm", RoundTrips((), 2, "timed out")), MISSING, "arm does not answer: timed out"),
        (checks.serial_port("pedal", "/dev/a", Port(True, True, "dialout"), ()), OK, "may be used"),
        (checks.serial_port("pedal", "/dev/a", Port(True, False, "uucp"), ()), MISSING, "belongs to the group uucp"),
        (checks.serial_port("pedal", "/dev/a", Port(False, False, ""), ("/dev/b",)), MISSING, "/dev/a is not there"),
        (checks.calibration(None, 30, NOW, "fr3"), MISSING, "this rig has no calibration: the camera pose is unknown"),
        (checks.calibration(calibration("2026-02-28T00:00:00+00:00"), 30, NOW, "fr3"), OK, "± 0.5 mm, ± 0.05°, 1 day"),
        (checks.calibration(calibration("2026-01-01T00:00:00+00:00"), 30, NOW, "fr3"), ADVICE, "59 days old"),
        (checks.calibration(calibration("2026-03-05T00:00:00+00:00"), 30, NOW, "fr3"), ADVICE, "made 4 days in"),
        (checks.camera(kinect("12"), ""), OK, "12, Microsoft library 1.4.1"),
        (checks.camera(kinect("12", "34"), "34"), OK, "34"),
        (checks.camera(kinect("12", "34"), ""), MISSING, "several cameras are plugged in: 12, 34"),
        (checks.camera(kinect("12"), "34"), MISSING, "34 is not plugged in; found: 12"),
        (checks.camera(kinect("12", engine=False), "12"), MISSING, "no depth engine"),
        (checks.camera(kinect(error="no camera is seen"), ""), MISSING, "no camera is seen"),
        (checks.arm(seen(), "panda"), OK, "panda answers over FCI, interface 5, mode Idle, joints 0.00 -0.79"),
        (checks.arm(seen(missed=3), "panda"), OK, "1000 states at 1 kHz, 3 missed, longest gap 1.2 ms"),
        (checks.arm(seen(missed=80), "panda"), ADVICE, "80 missed, longest gap 1.2 ms (at most 5 % and 20 ms)"),
        (checks.arm(seen(gap_s=0.03), "panda"), ADVICE, "longest gap 30.0 ms (at most"),
        (checks.arm(seen(notes=("memory is not locked",)), "panda"), ADVICE, "0 missed"),
        (checks.arm(seen(mode="UserStopped"), "panda"), MISSING, "it would not move: the stop button is pressed"),
        (checks.stream({"recording": {"frames": 15, "dropped": 0}}, 0.5), OK, "15 synchronised frames in 0.5 s, 0"),
        (checks.stream({"recording": {"frames": 12, "dropped": 3}}, 0.5), ADVICE, "3 dropped"),
        (checks.stream({"recording": {"frames": 4, "dropped": 0}}, 0.5), MISSING, "at least 10 are needed"),
        (checks.stream({"recording": None}, 0.5), MISSING, "0 synchronised frames"),
    ],
)  # fmt: skip
def test_each_check_over_its_readings(finding: Finding, verdict: Severity, says: str) -> None:
    assert finding.verdict is verdict
    assert says in finding.detail
    assert bool(finding.fix) == (verdict in (ADVICE, MISSING)), "a remedy for what needs one, and for nothing else"


@pytest.mark.parametrize(
    ("finding", "fix"),
    [
        (checks.driver("panda", absent), "pip install panda-python==1.1.1"),
        (checks.libraries(lambda _: False), "sudo apt-get install -y libegl1 libgl1 libusb-1.0-0 libglib2.0-0"),
        (checks.serial_port("pedal", "/dev/a", Port(True, False, "dialout"), ()), "sudo usermod -aG dialout $USER"),
        (checks.calibration(None, 30, NOW, "fr3"), "adaptsim calibrate --hw fr3"),
        (checks.serial_port("pedal", "/dev/a", Port(False, False, ""), ("/dev/b",)), "there now: /dev/b"),
    ],
)
def test_a_fix_is_a_line_to_run(finding: Finding, fix: str) -> None:
    assert fix in finding.fix


@pytest.mark.long
@pytest.mark.parametrize(
    ("wrong", "verdicts", "says"),
    [
        ("", (OK, ADVICE), "synchronised frames in 0.5 s"),
        ("hangs 24", (MISSING,), "camera's driver has not answered for 3 s"),
    ],
)
def test_the_camera_streams_or_its_driver_is_given_up(
    wrong: str, verdicts: tuple[Severity, ...], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(__file__).parents[3]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(root / "tests" / "support"), str(root))))
    monkeypatch.setenv("ADAPTSIM_STAGED_KINECT", wrong)
    found = examination._stream(CameraProcess(None, ColourSettings(), maker="staged_kinect:live", step_s=60.0))
    assert found.verdict in verdicts
    assert says in found.detail
    if not wrong:
        assert int(found.detail.split()[0]) >= 10


def test_a_device_that_does_not_answer_is_named_with_its_own_words() -> None:
    def silent() -> str:
        raise DeviceUnavailable("the pedal has not sent anything")

    found = checks.answers("pedal", silent, (DeviceUnavailable,), "docs/guide/enable-pedal.md")
    assert (found.verdict, found.detail) == (MISSING, "the pedal has not sent anything")
    with pytest.raises(ZeroDivisionError):  # a defect of the program is not taken for a device
        checks.answers("pedal", lambda: str(1 / 0), (DeviceUnavailable,), "")


def test_round_trips_to_a_port_that_listens_and_to_one_that_does_not() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        open_trips = readings.round_trips("127.0.0.1", port, tries=5)
    assert (len(open_trips.times_ms), open_trips.lost) == (5, 0)
    refused = readings.round_trips("127.0.0.1", port, tries=5)
    assert (len(refused.times_ms), refused.lost) == (5, 0), "a refusal is an answer"
    assert "no such address" in readings.round_trips("not an address", tries=5).problem


def test_the_disk_is_measured_and_left_as_it_was(tmp_path: Path) -> None:
    speed = readings.write_speed(tmp_path)
    assert speed.mb_s is not None and speed.mb_s > 0.0
    assert speed.flush_s > 0.0
    assert list(tmp_path.iterdir()) == []
    assert readings.write_speed(tmp_path / "none").mb_s is None
    assert readings.existing(tmp_path / "a" / "b") == tmp_path


def test_ports_and_governors_are_read_from_the_file_system(tmp_path: Path) -> None:
    assert readings.port(tmp_path / "none") == Port(False, False, "dialout")
    assert readings.port(tmp_path).may
    for core in (0, 1):
        (tmp_path / f"cpu{core}/cpufreq").mkdir(parents=True)
        (tmp_path / f"cpu{core}/cpufreq/scaling_governor").write_text("powersave\n")
    assert readings.governors(tmp_path) == ("powersave", "powersave")
    assert readings.installed("no-such-package") is None
    assert not readings.loads("libnosuch.so.9")


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: the device's end, and the name of the program's."""
    device, end = pty.openpty()
    tty.setraw(device)
    tty.setraw(end)
    yield device, os.ttyname(end)
    os.close(device)
    os.close(end)


def rig_with(**parts: object) -> RigDescription:
    return RigDescription("lab", {"model": "fr3", "address": "127.0.0.1"}, **parts)  # type: ignore[arg-type]


@pytest.mark.long
def test_a_pedal_that_speaks_is_heard_and_one_that_does_not_is_named(line: tuple[int, str]) -> None:
    device, port = line
    over = threading.Event()

    def speak() -> None:
        counter = 0
        while not over.wait(PERIOD_S):
            os.write(device, line_for(counter, False))
            counter += 1

    speaker = threading.Thread(target=speak)
    speaker.start()
    try:
        found = tuple(examination._pedal(rig_with(pedal=PedalPart(port))))
    finally:
        over.set()
        speaker.join()
    assert [finding.verdict for finding in found] == [OK, OK]
    assert "protocol version 1; the pedal is released" in found[1].detail
    (_, silent) = examination._pedal(rig_with(pedal=PedalPart(port)))
    assert silent.verdict is MISSING
    assert "has not sent anything" in silent.detail
    (gone,) = examination._pedal(rig_with(pedal=PedalPart("/dev/none")))
    assert gone.verdict is MISSING


def test_a_balance_that_speaks_is_heard(line: tuple[int, str]) -> None:
    device, port = line

    def answer() -> None:
        if os.read(device, 16) == b"S\r\n":
            os.write(device, b"S S     12.345 g\r\n")

    scale = threading.Thread(target=answer, daemon=True)  # nobody may ask it
    scale.start()
    found = tuple(examination._balance(rig_with(balance=BalancePart(port, "mt-sics"))))
    assert [finding.verdict for finding in found] == [OK, OK]
    assert "0.0123 kg on it" in found[1].detail
    (none,) = examination._balance(rig_with())
    assert none.verdict is SKIPPED


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in [name for name in os.environ if name.startswith("ADAPTSIM_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("ADAPTSIM_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    return tmp_path


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
    found = tuple(examination.examine(config.load({"world": "narnia"})))
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
    assert "adaptsim config init --arm panda" in out
    assert "not ready:" in err
    write_rig(place, RIG.replace("172.16.0.2", "127.0.0.1"))
    monkeypatch.setenv("ADAPTSIM_K4A_LIBRARY", str(place / "none.so"))
    calibrated(config.load({"hw": "panda"}))
    assert app.run(["doctor", "--hw", "panda", "--json"]) == 3
    checks = {c["name"]: c for c in json.loads(capfd.readouterr().out)["checks"]}
    assert checks["rig file"]["verdict"] == "ok"
    assert checks["network"]["verdict"] in ("ok", "advice")
    assert checks["arm"]["verdict"] == "missing"
    assert "activate FCI in Desk" in checks["arm"]["fix"]
    assert checks["pedal port"]["detail"] == "/dev/ttyACM0 is not there"
    assert checks["camera"]["verdict"] == "missing"
    assert checks["calibration"]["verdict"] in ("ok", "advice")
    assert checks["motion"]["verdict"] == "ok"
    assert "% of the tightest limit" in checks["motion"]["detail"]


def test_remedies_stand_whole_below_a_table_that_fits_the_screen(place: Path) -> None:
    file = io.StringIO()
    screen = Screen(console=Console(file=file, width=80, highlight=False, markup=False))
    found = (
        ok("program", "python", "3.11"),
        checks.driver("panda", absent),
        checks.governor(("powersave",)),
        *checks.not_needed(("pedal",)),
    )
    settings = config.load({}).config
    examination.show(found, settings, screen)
    table, _, rest = file.getvalue().partition("Missing:")
    assert max(len(line.rstrip()) for line in table.splitlines()) <= 80
    assert [line[0] for line in table.splitlines() if line[:1].strip()] == ["✓", "✗", "!", "–"]
    assert "  driver: pip install panda-python==1.1.1\n" in rest
    assert "  clock frequency: sudo cpupower frequency-set -g performance\n" in rest
    assert "Ready:" not in rest
    assert not examination.as_json(found, settings)["ready"]
    with pytest.raises(PreflightFailed, match="not ready: driver"):
        examination.require(found)
    examination.require(found[:1])


def test_the_rig_file_of_these_tests_is_one(tmp_path: Path) -> None:
    assert read(write_rig(tmp_path)).name == "lab-1"
