"""A running recording of the lab's camera. Its pictures are rendered while the motion is still being simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import overload

import numpy as np

from hw.types import Array, Frame
from sim.lab.cell import Cell, PlantMotion
from sim.lab.kinect import EXPOSURE_S
from sim.lab.rng_streams import RngStreams
from sim.lab.world import Sensing
from sim.render.pool import Picture, RenderPool
from sim.render.rays import held_still

FRAME_RATE_HZ = 30.0
SLICES = 4  # per exposure


class RenderedFilm(Sequence[Frame]):
    """Frames that may still be rendering: reading one waits until it is ready."""

    def __init__(self, times_s: Sequence[float], pictures: Sequence[Future[Picture]]) -> None:
        self._times_s, self._pictures = times_s, pictures

    def __len__(self) -> int:
        return len(self._pictures)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | Sequence[Frame]:
        if isinstance(index, slice):
            return RenderedFilm(self._times_s[index], self._pictures[index])
        return Frame(self._times_s[index], *self._pictures[index].result())


@dataclass(eq=False)
class Filming:
    """Asks for each picture as soon as its exposure has been simulated. A motion in pieces gives the same pictures."""

    studio: RenderPool
    cell: Cell
    sensing: Sensing
    chance: RngStreams
    t_placed_s: float
    since_s: float
    pictures: list[Future[Picture]] = field(default_factory=list)  # in order of time; some may still be rendering
    _motions: dict[float, PlantMotion] = field(default_factory=dict)  # by their starts, s
    _last: Mapping[str, Array] = field(default_factory=dict)  # pose (1, 4, 4) of every body in the latest slice
    _times_s: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._next = int(np.ceil(self._number_at(self.since_s + EXPOSURE_S / 2)))

    def saw(self, t_start_s: float, motion: PlantMotion) -> None:
        """The plant moves along `motion` from `t_start_s` on. May be called again, with more of the same motion."""
        self._motions[t_start_s] = motion
        end_s = t_start_s + float(motion.t_s[-1])
        numbers = range(self._next, int(np.floor(self._number_at(end_s - EXPOSURE_S / 2))) + 1)
        self._next = max(self._next, numbers.stop)
        for number in numbers:
            if not self._dropped(number):
                self._times_s.append(self._time_s(number))
                poses = self._poses(self._times_s[-1])
                self.pictures.append(self.studio.render(poses, self.chance.frame_stream(number)))

    def film(self) -> RenderedFilm:
        """The frames so far, on the camera's own clock."""
        return RenderedFilm([self.sensing.stamped(t_s) for t_s in self._times_s], self.pictures)

    def _number_at(self, t_s: float) -> float:
        """The number of the frame exposed at `t_s`, counted from the placing of the object; fractions lie between."""
        return (t_s - self.t_placed_s) * FRAME_RATE_HZ - self.chance.frame_phase

    def _time_s(self, number: int) -> float:
        return self.t_placed_s + (number + self.chance.frame_phase) / FRAME_RATE_HZ

    def _dropped(self, number: int) -> bool:
        return bool(self.chance.frame_stream(number).uniform() < self.sensing.frame_drop)

    def _poses(self, exposed_s: float) -> Mapping[str, Array]:
        """The poses (SLICES, 4, 4) of all visible bodies over the exposure around `exposed_s`."""
        slices_s = exposed_s + EXPOSURE_S * ((np.arange(SLICES) + 0.5) / SLICES - 0.5)
        poses = self.cell.poses(self._positions_at(slices_s))
        held = {name: held_still(np.concatenate([self._last.get(name, X[:1]), X]))[1:] for name, X in poses.items()}
        self._last = {name: X[-1:] for name, X in held.items()}
        return held

    def _positions_at(self, times_s: Array) -> Array:
        """(S, nq) of the plant at `times_s` (S,)."""
        first, *later = self._motions.items()
        rows = first[1].at(times_s - first[0])
        for t_start_s, motion in later:
            chosen = times_s >= t_start_s
            rows[chosen] = motion.at(times_s[chosen] - t_start_s)
        return rows
