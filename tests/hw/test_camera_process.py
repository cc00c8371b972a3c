"""The camera in a process of its own: its answers, and a driver that hangs or ends the process."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hw.camera.process import ANSWER_S, CameraProcess, served
from hw.errors import CameraError

SUPPORT = Path(__file__).parents[1] / "support"
SLACK_S = 3.0
"""For a busy machine."""

Staged = Callable[..., CameraProcess]


@pytest.fixture
def hang(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A FIFO that the staged driver opens as it hangs: reading it waits for that."""
    fifo = tmp_path / "hang"
    os.mkfifo(fifo)
    monkeypatch.setenv("ADAPTSIM_STAGED_HANG", str(fifo))
    return fifo


@pytest.fixture
def staged(monkeypatch: pytest.MonkeyPatch, hang: Path) -> Staged:
    def camera(wrong: str = "", step_s: float = 60.0) -> CameraProcess:
        paths = [str(SUPPORT), str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
        monkeypatch.setenv("ADAPTSIM_STAGED_KINECT", wrong)
        return CameraProcess(start=served("fake_k4a:live"), step_s=step_s)

    return camera


def test_it_shows_and_records_and_leaves_no_process(staged: Staged) -> None:
    with staged() as camera:
        assert camera._child is not None
        pid = camera._child.pid
        before_s = time.monotonic()
        frame = camera.snapshot()
        assert frame.t_s > before_s
        assert (frame.colour.shape, frame.depth_mm.shape) == ((48, 64, 3), (36, 40))
        camera.start_recording()
        for _ in range(12):
            camera.snapshot()  # each waits for the next frame
        frames = camera.stop_recording()
        assert len(frames) >= 8
        facts = camera.facts()
        assert facts["serial"] == "A1"
        assert facts["recording"]["frames"] == len(frames)
    assert not Path(f"/proc/{pid}").exists()


def test_whoever_watches_takes_nothing_from_a_recording(staged: Staged) -> None:
    with staged() as camera, ThreadPoolExecutor(3) as watchers:
        camera.start_recording()
        looks = [watchers.submit(lambda: [camera.newest() for _ in range(40)]) for _ in range(3)]
        for _ in range(12):
            camera.snapshot()  # each waits for the next frame
        frames = camera.stop_recording()
        pictures = [picture for look in looks for picture in look.result() if picture is not None]
        assert len(frames) >= 8
        assert camera.film is not None and camera.film.dropped == 0
        assert pictures and {picture.shape for picture in pictures} == {(48, 64, 3)}
    assert camera.newest() is None


@pytest.mark.long
def test_a_camera_that_exposes_otherwise_half_way_says_so(staged: Staged) -> None:
    with staged("dim 40") as camera:
        camera.start_recording()
        for _ in range(60):
            camera.snapshot()
        camera.stop_recording()
        seen = camera.facts()["recording"]["exposure_us_and_white_balance_K"]
    assert len(seen) == 2
    assert seen[0][0] == 2500 < seen[1][0]


@pytest.mark.long
def test_a_driver_that_hangs_is_a_message_and_the_camera_can_be_entered_again(
    staged: Staged, hang: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = staged("hangs 40")
    with camera:
        camera.start_recording()
        assert camera._child is not None
        pid = camera._child.pid
        hang.read_text()
        began_s = time.monotonic()
        with pytest.raises(CameraError, match="driver has not answered for 3 s, and was ended"):
            camera.stop_recording()
        assert time.monotonic() - began_s < ANSWER_S + SLACK_S
        assert ANSWER_S <= 3.0
        assert not Path(f"/proc/{pid}").exists()
        assert camera.model().serial == "A1"
        assert "driver has not answered" in camera.facts()["ended"]
        began_s = time.monotonic()
        with pytest.raises(CameraError, match="run the command again"):
            camera.stop_recording()
        assert time.monotonic() - began_s < 0.5
    monkeypatch.setenv("ADAPTSIM_STAGED_KINECT", "")
    with camera:
        camera.snapshot()


@pytest.mark.long
def test_a_driver_that_hangs_while_it_opens_says_so_and_ends(staged: Staged, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(CameraError, match=r"has not answered for 15 s while .*, and was ended"):
        staged("hangs open", step_s=15.0).__enter__()
    assert "silent for 3 s while opening the camera" in caplog.text


def test_a_driver_that_ends_its_process_takes_only_that_along(staged: Staged) -> None:
    with staged("dies 40") as camera, pytest.raises(CameraError, match="process was ended with status 7"):
        for _ in range(60):
            camera.snapshot()


@pytest.mark.long
def test_leaving_never_waits_for_a_driver_that_hangs(staged: Staged, hang: Path) -> None:
    with staged("hangs 40"):
        hang.read_text()
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 1.0 + SLACK_S


@pytest.mark.long
def test_a_killed_program_takes_a_hanging_camera_along(staged: Staged, hang: Path) -> None:
    with staged("hangs 40") as camera:
        assert camera._child is not None
        keeper = camera._child
        hang.read_text()
        os.close(keeper._say)  # what the system does with a program that was killed
        began_s = time.monotonic()
        while keeper.alive:
            assert time.monotonic() - began_s < 20.0
            time.sleep(0.05)
        keeper._say = os.open(os.devnull, os.O_WRONLY)
    assert keeper._process.returncode in (1, -signal.SIGKILL)


@pytest.mark.long
def test_a_driver_that_freezes_while_it_is_stopped_is_ended(staged: Staged) -> None:
    """Seen in the field with Orbbec's wrapper."""
    camera = staged("hangs stop")
    with camera:
        assert camera._child is not None
        pid = camera._child.pid
        camera.snapshot()
        left_s = time.monotonic()
    assert time.monotonic() - left_s < 1.0 + SLACK_S
    assert not Path(f"/proc/{pid}").exists()
    with camera:
        camera.snapshot()
