"""Asking for libk4a in a child process: nothing there, something else there, a crash, a hang, cameras."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from fake_k4a import FakeK4a

from hw.camera import k4a_library
from hw.camera.probe import look, probe_k4a
from hw.errors import DeviceUnavailable

NO_MAPS = ""


def child(program: str) -> list[str]:
    return [sys.executable, "-c", program]


def test_no_library_is_a_message_with_the_install_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(k4a_library, "library_file", lambda: None)
    report = probe_k4a()
    assert (report.library, report.error is None, report.serials) == (None, False, ())
    with pytest.raises(DeviceUnavailable, match=r"not installed\. Install .*apt-get install libk4a1\.4"):
        report.require()


def test_the_environment_names_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ADAPTSIM_K4A_LIBRARY", "/opt/k4a/libk4a.so")
    assert k4a_library.library_file() == "/opt/k4a/libk4a.so"


def test_a_file_that_is_missing_or_no_libk4a(tmp_path: Path) -> None:
    missing = probe_k4a(str(tmp_path / "libk4a.so.1.4.1"))
    assert missing.error is not None and "cannot be loaded" in missing.error
    assert missing.version == "1.4.1"
    broken = tmp_path / "libk4a.so"
    broken.write_bytes(b"not a library")
    report = probe_k4a(str(broken))
    assert report.error is not None and "cannot be loaded" in report.error and report.fix is not None
    other = probe_k4a("libm.so.6")
    assert other.error is not None and "it is not libk4a 1.4" in other.error


def test_a_library_that_crashes_takes_only_the_child_along() -> None:
    crash = child("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    report = probe_k4a("/usr/lib/libk4a.so", child=crash)
    assert report.error == "/usr/lib/libk4a.so ended its process (signal 11) while it listed the cameras"
    assert report.fix is not None and "does not fit this machine" in report.fix


def test_a_library_that_hangs_is_given_up() -> None:
    report = probe_k4a("/usr/lib/libk4a.so", patience_s=0.3, child=child("import signal; signal.pause()"))
    assert report.error == "/usr/lib/libk4a.so did not answer within 0.3 s"


def test_what_the_library_prints_is_no_answer() -> None:
    found = look(FakeK4a("A1", "B2", busy=("A1",)), "libk4a.so.1.4.1", NO_MAPS)
    program = (
        f"print('[error] something'); print('K4A-PROBE ' + {json.dumps(json.dumps(found.as_json()))}); print('bye')"
    )
    assert probe_k4a("libk4a.so.1.4.1", child=child(program)) == found


def test_cameras_are_listed_with_serial_and_firmware_and_given_back() -> None:
    fake = FakeK4a("A1", "B2", busy=("A1",))
    report = look(fake, "/usr/lib/libk4a.so.1.4.1", NO_MAPS)
    busy, free = report.devices
    assert (busy.serial, free.serial) == ("", "B2") and busy.error is not None and "cannot be opened" in busy.error
    assert free.firmware == "colour 1.6.110, depth 1.6.80"
    assert (report.error is None, report.serials, report.version, report.maker) == (True, ("B2",), "1.4.1", "Microsoft")
    assert not fake.open
    assert look(fake, "libk4a.so", "7f00 /opt/lib/libOrbbecSDK.so.1.10").maker == "Orbbec"


def test_no_camera_and_none_that_can_be_opened() -> None:
    none = look(FakeK4a(), "libk4a.so", NO_MAPS)
    assert none.error == "libk4a.so finds no camera" and none.fix is not None and "udev" in none.fix
    taken = look(FakeK4a("A1", busy=("A1",)), "libk4a.so", NO_MAPS)
    with pytest.raises(DeviceUnavailable, match="another program"):
        taken.require()
