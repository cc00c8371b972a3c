"""The lab's recording: pictures are asked for while the motion goes on, and are those of the whole motion."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, field

import numpy as np
import pytest
from slider import CELL, HOME_RAD, TASK, XY_M, shove, world

from hw.joint_limits import LIMITS
from hw.types import Array
from sim.lab.cell import Cell, PlantMotion
from sim.lab.film import SLICES, Filming
from sim.lab.rng_streams import RngStreams
from sim.lab.simulated import SimulatedLab
from sim.lab.world import Sensing
from sim.panda.moves import move_path
from sim.render.pool import Picture, Poses, ThreadPool

T_PLACED_S, T_START_S = 1000.0, 1003.21


@dataclass
class Notes:
    """A studio that renders nothing and remembers the poses and generators."""

    moments: list[tuple[Poses, np.random.Generator]] = field(default_factory=list)

    def render(self, poses: Poses, rng: np.random.Generator) -> Future[Picture]:
        self.moments.append((poses, rng))
        done: Future[Picture] = Future()
        done.set_result((np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1), np.uint16)))
        return done

    def close(self, *, finish: bool) -> None: ...


@pytest.fixture(scope="module")
def cell() -> Cell:
    return Cell(TASK, world())


def filming(cell: Cell, notes: Notes, sensing: Sensing) -> Filming:
    return Filming(notes, cell, sensing, RngStreams.draw(3, 1, 0), T_PLACED_S, T_START_S)


def slow(cell: Cell, duration_s: float = 0.8) -> PlantMotion:
    """The last joint creeps, at first under the renderer's tolerance in each slice."""
    t_s = np.linspace(0.0, duration_s, 161)
    q_rad = np.tile(HOME_RAD, (len(t_s), 1))
    q_rad[:, 6] += 2e-3 * t_s**3
    return cell.travel(t_s, q_rad)


def until(motion: PlantMotion, end_s: float) -> PlantMotion:
    kept = motion.t_s <= end_s
    return PlantMotion(motion.t_s[kept], motion.positions[kept], motion.q_rad[kept])


def stacked(notes: Notes) -> dict[str, Array]:
    return {name: np.array([poses[name] for poses, _ in notes.moments]) for name in notes.moments[0][0]}


@pytest.mark.parametrize("sensing", [Sensing(), Sensing(frame_drop=0.4, clock_offset_ms=20.0)])
def test_a_film_of_a_growing_motion_is_that_of_the_whole_one(cell: Cell, sensing: Sensing) -> None:
    motion, whole, piecewise = slow(cell), Notes(), Notes()
    at_once, growing = filming(cell, whole, sensing), filming(cell, piecewise, sensing)
    at_once.saw(T_START_S, motion)
    for end_s in (0.02, 0.11, 0.4, 0.41, 0.8):
        growing.saw(T_START_S, until(motion, end_s))
    waited = PlantMotion(np.array([0.0, 0.2]), motion.positions[[-1, -1]], motion.q_rad[[-1, -1]])
    for one in (at_once, growing):
        one.saw(T_START_S + 0.8, waited)
    assert 15 <= len(whole.moments) <= 30
    assert [frame.t_s for frame in at_once.film()] == [frame.t_s for frame in growing.film()]
    for name, poses in stacked(whole).items():
        assert poses.shape[1:] == (SLICES, 4, 4)
        np.testing.assert_array_equal(stacked(piecewise)[name], poses)
    drawn = [[rng.random() for _, rng in notes.moments] for notes in (whole, piecewise)]
    assert drawn[0] == drawn[1]


def test_a_picture_is_asked_for_once_its_exposure_is_over(cell: Cell) -> None:
    motion, notes = slow(cell), Notes()
    film = filming(cell, notes, Sensing())
    counts = []
    for end_s in (0.005, 0.2, 0.4, 0.8):
        film.saw(T_START_S, until(motion, end_s))
        counts.append(len(notes.moments))
        assert all(frame.t_s + 0.004 <= T_START_S + end_s + 1e-9 for frame in film.film())
    assert counts[0] == 0
    assert counts == sorted(set(counts))


def test_a_simulation_tells_of_its_motion_while_it_goes_on() -> None:
    cell, path, seen = Cell(TASK, world()), shove(), list[PlantMotion]()
    cell.reset(path.q_rad[0], np.eye(4))
    whole = cell.simulate(path.t_s, path.q_rad, seen.append)
    np.testing.assert_allclose([motion.t_s[-1] for motion in seen[:5]], [0.1, 0.2, 0.3, 0.4, 0.5], atol=1e-9)
    for motion in seen:
        np.testing.assert_array_equal(motion.positions, whole.positions[: len(motion.t_s)])
    assert len(seen[-1].t_s) == len(whole.t_s)


def test_the_camera_asks_for_pictures_during_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, render = list[Poses](), ThreadPool.render

    def noted(studio: ThreadPool, poses: Poses, rng: np.random.Generator) -> Future[Picture]:
        asked.append(poses)
        return render(studio, poses, rng)

    with SimulatedLab(TASK, world(), 7, CELL) as lab:
        path = shove()
        lab.bench.place(XY_M, 1, 0)
        lab.arm.execute(move_path(HOME_RAD, path.q_rad[0], LIMITS["panda"]))
        monkeypatch.setattr(ThreadPool, "render", noted)
        lab.camera.start_recording()
        lab.arm.execute(path)
        during = len(asked)
        assert len(lab.camera.stop_recording()) == during > 30
