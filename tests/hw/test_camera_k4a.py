"""The live camera on a libk4a of C callbacks: pairs, times, losses, settings, and everything that fails."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from typing import Any

import fake_k4a
import numpy as np
import pytest
from camera_stage import DELAY_S, Shown, meanwhile
from fake_k4a import PERIOD_S, FakeK4a, camera_on, frames, running

from hw.camera import k4a_library as k4a
from hw.camera.k4a_device import ColourSettings, model_of
from hw.camera.k4a_library import PROTOTYPES
from hw.camera.process import CameraProcess
from hw.errors import CameraError, DeviceUnavailable
from hw.types import Frame

LATENCY_S = DELAY_S - 0.5 * 8330e-6
"""What is left of the delay when half of the exposure is taken off."""


def filmed(fake: FakeK4a, camera: CameraProcess, count: int, **what: Any) -> tuple[float, Sequence[Frame]]:
    """(middle of the first exposure, frames) of a recording of so many captures."""
    camera.start_recording()
    start_s = fake.clock.now_s() + 0.01
    fake.show(*frames(start_s, count, **what))
    return start_s, meanwhile(fake, camera.stop_recording, *frames(start_s + count * PERIOD_S, 3, **what))


def test_a_recording_has_every_frame_between_start_and_stop_at_its_time_on_the_arms_clock() -> None:
    fake = FakeK4a("A1")
    with running(fake, latency_s=LATENCY_S) as camera:
        start_s, found = filmed(fake, camera, 39, grey=50, depth_mm=800)
    assert [frame.t_s for frame in found] == pytest.approx([start_s + i * PERIOD_S for i in range(39)], abs=2e-6)
    assert found[0].colour.shape == (48, 64, 3) and found[0].colour.mean() == pytest.approx(50, abs=1)
    assert found[0].depth_mm.shape == (36, 40) and (found[0].depth_mm == 800).all()  # without the padding of the rows
    assert found[0].infrared is None
    assert camera.film is not None and camera.film.dropped == 0
    assert not fake.handles and not fake.open and fake.started is None  # everything given back


def test_the_cameras_are_asked_for_what_the_port_promises() -> None:
    fake = FakeK4a("A1")
    with running(fake) as camera:
        asked = fake.started
        assert asked is not None
        assert (asked.color_format, asked.color_resolution, asked.depth_mode, asked.camera_fps) == (0, 1, 2, 2)
        assert asked.synchronized_images_only and asked.depth_delay_off_color_usec == 0
        assert camera.model().serial == "A1"


def test_images_that_arrive_late_do_not_move_the_clock() -> None:
    fake = FakeK4a("A1")
    late_s = np.random.default_rng(3).exponential(0.02, 60)
    with running(fake, latency_s=LATENCY_S) as camera:
        camera.start_recording()
        start_s = fake.clock.now_s() + 0.01  # middle of the first exposure
        fake.show(*(Shown(start_s + i * PERIOD_S, late_s=float(late_s[i])) for i in range(60)))
        found = meanwhile(fake, camera.stop_recording, *frames(start_s + 60 * PERIOD_S, 9))
        assert camera.film is not None and camera.film.clock.spread_s > 0.001
    assert len(found) >= 60  # the clock ran on while images were late
    assert [frame.t_s for frame in found] == pytest.approx(
        [start_s + i * PERIOD_S for i in range(len(found))], abs=2e-6
    )


def test_a_recording_during_which_the_cameras_clock_jumps_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its images would come up to the jump too late, or too early, and nothing would show it."""
    fake = FakeK4a("A1")
    with running(fake, latency_s=LATENCY_S) as camera:
        camera.start_recording()
        start_s = fake.clock.now_s() + 0.01
        fake.show(*frames(start_s, 8))
        monkeypatch.setattr(fake_k4a, "BOOT_S", fake_k4a.BOOT_S - 0.05)
        fake.show(*frames(start_s + 8 * PERIOD_S, 22))
        with pytest.raises(CameraError, match="clock jumped or stood still during the recording"):
            meanwhile(fake, camera.stop_recording, *frames(start_s + 30 * PERIOD_S, 3))
        assert filmed(fake, camera, 20)[1]


def test_a_snapshot_was_exposed_after_it_was_asked_for() -> None:
    fake = FakeK4a("A1")
    with running(fake, latency_s=LATENCY_S) as camera:
        asked_s = fake.clock.now_s()
        old, new = frames(asked_s - 0.02, 1, grey=10), frames(asked_s + 0.01, 1, grey=200)
        frame = meanwhile(fake, camera.snapshot, *old, *new)
    assert frame.t_s == pytest.approx(asked_s + 0.01, abs=2e-6)
    assert frame.colour.mean() == pytest.approx(200, abs=1)


def test_infrared_comes_on_request_and_captures_without_it_are_passed_over() -> None:
    fake = FakeK4a("A1")
    with running(fake, infrared=True, latency_s=LATENCY_S) as camera:
        asked_s = fake.clock.now_s()
        lacking = frames(asked_s + 0.01, 1, has_infrared=False)
        frame = meanwhile(fake, camera.snapshot, *lacking, *frames(asked_s + 0.05, 1, depth_mm=500))
    assert frame.infrared is not None and (frame.infrared == 1500).all()
    assert frame.t_s == pytest.approx(asked_s + 0.05, abs=2e-6)


def test_dropped_frames_are_counted_and_too_many_are_refused(caplog: pytest.LogCaptureFixture) -> None:
    fake = FakeK4a("A1")
    with running(fake, latency_s=LATENCY_S) as camera:
        camera.start_recording()
        start_s = fake.clock.now_s() + 0.01  # middle of the first exposure
        shown = frames(start_s, 30)
        fake.show(*shown[:10], *shown[13:20], Shown(shown[20].t_s, has_colour=False), *shown[21:])
        found = meanwhile(fake, camera.stop_recording, *frames(start_s + 30 * PERIOD_S, 3))
        assert camera.film is not None
        assert (len(found), camera.film.dropped) == (26, 4)
        assert camera.film.longest_gap_s == pytest.approx(4 * PERIOD_S, abs=1e-5)
        assert "dropped 4 of 30" in caplog.text
        assert camera.facts()["recording"]["dropped"] == 4

        camera.start_recording()
        start_s = fake.clock.now_s() + 0.01  # middle of the first exposure
        fake.show(*frames(start_s, 30)[::2])
        with pytest.raises(CameraError, match=r"14 of 29 frames .*repeat the trial"):
            meanwhile(fake, camera.stop_recording, *frames(start_s + 29.5 * PERIOD_S, 3))


def test_exposure_and_white_balance_are_fixed_and_what_the_device_made_of_them_is_kept() -> None:
    fake = FakeK4a("A1")
    wanted = ColourSettings(exposure_us=9000, white_balance_K=5200, gain=60, mains_hz=50)
    with running(fake, settings=wanted) as camera:
        assert camera.facts()["settings"] == asdict(replace(wanted, exposure_us=10000))
        assert fake.controls[k4a.EXPOSURE_TIME_ABSOLUTE] == (k4a.MODE_MANUAL, 10000)
    stubborn = FakeK4a("A1")
    stubborn.stuck.add(k4a.WHITEBALANCE)
    with pytest.raises(CameraError, match="white balance stayed automatic"):
        camera_on(stubborn).__enter__()
    assert not stubborn.open


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"exposure_us": 40000}, "exposure 40000 us"),
        ({"white_balance_K": 4505}, "white balance 4505 K"),
        ({"gain": 300}, "gain 300"),
        ({"mains_hz": 55}, "mains 55 Hz"),
    ],
)
def test_settings_that_no_device_takes_are_refused(wrong: dict[str, int], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        ColourSettings(**wrong)


def test_the_camera_is_chosen_by_its_serial_number() -> None:
    fake = FakeK4a("A1", "B2", "C3", busy=("C3",))
    with running(fake, "B2") as camera:
        assert camera.model().serial == "B2"
        assert fake.open == {2}
    with pytest.raises(
        DeviceUnavailable, match=r"no camera with serial number D4; plugged in: A1, B2, one that cannot"
    ):
        camera_on(fake, "D4").__enter__()
    with pytest.raises(DeviceUnavailable, match="several cameras are plugged in"):
        camera_on(fake).__enter__()
    with pytest.raises(DeviceUnavailable, match=r"no usable camera; plugged in: none"):
        camera_on(FakeK4a()).__enter__()
    assert not fake.open


@pytest.mark.parametrize(
    ("failing", "told"),
    [
        (
            "start",
            r"start to send images .*libk4a: Depth engine .* error code: 204",
        ),  # the cause, not its echo
        ("control", "mains frequency cannot be set to 2"),
        ("calibration", "factory calibration cannot be read"),
    ],
)
def test_a_camera_that_does_not_start_says_why_and_is_closed(failing: str, told: str) -> None:
    fake = FakeK4a("A1")
    fake.refused.add(failing)
    with pytest.raises(CameraError, match=told):
        camera_on(fake).__enter__()
    assert not fake.open and fake.started is None


def test_unplugged_while_recording() -> None:
    fake = FakeK4a("A1")
    with running(fake) as camera:
        camera.start_recording()
        fake.show(*frames(fake.clock.now_s(), 5))
        fake.fail("unplugged")
        with pytest.raises(CameraError, match=r"camera A1: it stopped answering.*device is gone.*USB 3 port"):
            camera.stop_recording()
        with pytest.raises(CameraError, match="stopped answering"):
            camera.snapshot()
        with pytest.raises(CameraError, match="stopped answering"):
            camera.start_recording()
    assert not fake.handles and not fake.open


def test_silence_ends_a_wait_for_a_frame() -> None:
    fake = FakeK4a("A1")
    with running(fake) as camera:
        for _ in range(4):
            fake.fail("timeout")
        with pytest.raises(CameraError, match="no complete image for 4 waits"):
            camera.snapshot()


def test_out_of_turn() -> None:
    for closed in (CameraProcess("A1"), camera_on(FakeK4a("A1"))):
        with pytest.raises(DeviceUnavailable, match="not connected"):
            closed.snapshot()
        with pytest.raises(DeviceUnavailable, match="not connected"):
            closed.model()
    fake = FakeK4a("A1")
    with running(fake) as camera:
        with pytest.raises(CameraError, match="not recording"):
            camera.stop_recording()
        camera.start_recording()
        with pytest.raises(CameraError, match="recording already"):
            camera.start_recording()
    with pytest.raises(ValueError, match="must be 0 or more"):
        CameraProcess(latency_s=-0.01)


def test_the_memory_layouts_are_those_of_the_maker() -> None:
    """Sizes as a 64-bit compiler gives them for k4atypes.h 1.4; test_camera_real_library.py reads real ones."""
    kinds = (k4a.DeviceConfiguration, k4a.Extrinsics, k4a.IntrinsicParameters, k4a.CalibrationCamera)
    sizes = [ctypes.sizeof(kind) for kind in (*kinds, k4a.K4aCalibration, k4a.HardwareVersion)]
    assert sizes == [36, 48, 68, 128, 1032, 56]
    assert k4a.DeviceConfiguration.depth_delay_off_color_usec.offset == 20
    assert k4a.K4aCalibration.depth_mode.offset == 1024


def test_calibration_in_the_order_of_the_header() -> None:
    raw = k4a.K4aCalibration()
    for number, camera in enumerate((raw.depth_camera_calibration, raw.color_camera_calibration)):
        camera.intrinsics.type = k4a.BROWN_CONRADY
        camera.intrinsics.parameters[:] = [100 * number + i for i in range(15)]
        camera.resolution_width, camera.resolution_height = (640, 576) if number == 0 else (1280, 720)
    quarter = raw.extrinsics[k4a.TYPE_DEPTH][k4a.TYPE_COLOUR]
    quarter.rotation[:] = [0, -1, 0, 1, 0, 0, 0, 0, 1]
    quarter.translation[:] = [-32.0, -2.0, 4.0]
    model = model_of(raw, "A1")
    assert model.colour.K.tolist() == [[102, 0, 100], [0, 103, 101], [0, 0, 1]]
    assert model.depth.distortion.tolist() == [4, 5, 13, 12, 6, 7, 8, 9]  # k1 k2 p1 p2 k3 k4 k5 k6
    assert (model.X_CD @ [1, 0, 0, 1]).tolist() == pytest.approx([-0.032, 0.998, 0.004, 1])
    raw.color_camera_calibration.intrinsics.type = 1
    with pytest.raises(CameraError, match="colour camera has lens model 1"):
        model_of(raw, "A1")


@pytest.mark.parametrize("boot_s", [fake_k4a.BOOT_S, 100.0 - 1.7e9, 100.0 - 300.0])
def test_without_stamps_of_arrival_the_hosts_clock_serves_wherever_the_devices_began(
    boot_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Orbbec's wrapper has stamped with the time since 1970, and minutes away from what it stamped before."""
    monkeypatch.setattr(fake_k4a, "BOOT_S", boot_s)
    fake = FakeK4a("A1")
    with running(fake, latency_s=LATENCY_S) as camera:
        start_s, found = filmed(fake, camera, 12, stamped=False)
    assert [frame.t_s for frame in found] == pytest.approx([start_s + i * PERIOD_S for i in range(12)], abs=2e-6)


def test_a_clock_that_settles_minutes_later_is_mapped_anew_before_the_camera_is_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fake, usual_s = FakeK4a("A1"), fake_k4a.BOOT_S
    camera = camera_on(fake, latency_s=LATENCY_S)
    with ThreadPoolExecutor(1) as pool:
        entering = pool.submit(camera.__enter__)
        monkeypatch.setattr(fake_k4a, "BOOT_S", usual_s - 240.0)
        fake.show(*frames(100.0, 6))
        monkeypatch.setattr(fake_k4a, "BOOT_S", usual_s)
        fake.show(*frames(100.0 + 6 * PERIOD_S, 16))
        entering.result()
    asked_s = fake.clock.now_s()
    frame = meanwhile(fake, camera.snapshot, *frames(asked_s + 0.01, 3))
    exposed_s = [asked_s + 0.01 + i * PERIOD_S for i in range(3)]  # on a busy computer it may not be the first
    assert min(abs(frame.t_s - t_s) for t_s in exposed_s) < 2e-6
    fake.end()
    camera.__exit__()


def test_no_transformation_of_the_library_is_used() -> None:
    """Its depth-to-colour transformation fails with Orbbec's wrapper; the program projects depth itself."""
    assert not [name for name in PROTOTYPES if "transformation" in name]
