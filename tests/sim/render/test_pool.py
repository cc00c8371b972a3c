"""Pictures rendered in the background: by a thread, and by processes."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest

from hw.errors import CameraError
from hw.types import CameraModel, Intrinsics
from sim.render.pool import Picture, ProcessPool, RenderPool, Scene, ThreadPool
from sim.render.sensor import SensorNoise
from sim.types import Visual

SQUARE = np.array([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]])
TILE = Visual("tile", SQUARE, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32), (0.6, 0.2, 0.1))
TINY = Intrinsics(32, 24, np.array([[30.0, 0, 15.5], [0, 30.0, 11.5], [0, 0, 1]]), np.zeros(8))


def scene() -> Scene:
    """A camera 0.6 m above a tile, looking down."""
    X_BC = np.diag([1.0, -1.0, -1.0, 1.0])
    X_BC[2, 3] = 0.6
    return Scene(CameraModel("tiny", TINY, TINY, np.eye(4)), X_BC, [TILE], SensorNoise())


def ask(studio: RenderPool, number: int = 0) -> Future[Picture]:
    X = np.eye(4)
    X[0, 3] = 0.01 * number
    return studio.render({"tile": X[None]}, np.random.default_rng(number))


def film(studio: RenderPool, count: int = 6) -> list[Picture]:
    return [soon.result() for soon in [ask(studio, i) for i in range(count)]]


@pytest.fixture
def processes() -> Iterator[ProcessPool]:
    studio = ProcessPool(scene(), 2)
    yield studio
    studio.close(finish=False)


def pids(studio: ProcessPool) -> list[int]:
    return [child.pid for child in studio._children]


def test_processes_and_a_thread_make_the_same_pictures_in_the_same_order(processes: ProcessPool) -> None:
    thread = ThreadPool(scene)
    expected = film(thread)
    thread.close(finish=True)
    assert len({colour.tobytes() for colour, _ in expected}) == len(expected)
    for (colour, depth), (same_colour, same_depth) in zip(film(processes), expected, strict=True):
        np.testing.assert_array_equal(colour, same_colour)
        np.testing.assert_array_equal(depth, same_depth)


def test_a_lost_process_costs_a_picture_and_the_next_one_is_rendered(processes: ProcessPool) -> None:
    film(processes, 2)
    lost = pids(processes)
    for pid in lost:
        os.kill(pid, signal.SIGKILL)
    for _ in lost:
        with pytest.raises(CameraError, match=r"was lost: killed by SIGKILL; redo the trial"):
            ask(processes).result()
    assert len(film(processes)) == 6
    assert not set(pids(processes)) & set(lost)


@pytest.mark.parametrize(
    "make", [ThreadPool, pytest.param(lambda scene: ProcessPool(scene(), 1), marks=pytest.mark.long)]
)
def test_closing_finishes_what_was_asked_for_or_cancels_it(make) -> None:
    studio = make(scene)
    asked = [ask(studio, i) for i in range(4)]
    studio.close(finish=True)
    assert all(soon.done() and not soon.cancelled() for soon in asked)
    studio = make(scene)
    asked = [ask(studio, i) for i in range(200)]
    studio.close(finish=False)
    assert asked[-1].cancelled()


def test_a_folder_of_the_user_is_not_taken_for_our_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "__init__.py").write_text("raise SystemExit(7)")
    monkeypatch.chdir(tmp_path)
    studio = ProcessPool(scene(), 1)
    film(studio, 1)
    studio.close(finish=True)


def test_no_process_outlives_its_studio() -> None:
    studio = ProcessPool(scene(), 2)
    started = pids(studio)
    film(studio, 1)
    studio.close(finish=True)
    for pid in started:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_process_ends_when_the_program_hangs_up() -> None:
    studio = ProcessPool(scene(), 1)
    film(studio, 1)
    (child,) = studio._children
    child.connection.close()
    child._process.wait(30.0)
    studio._threads.shutdown()
    os.close(child._say)
