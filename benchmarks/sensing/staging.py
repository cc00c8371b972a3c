"""The pictures of the lab's camera under one condition: its processes render them, and the condition changes them."""

from __future__ import annotations

import copy
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from sensing.conditions import Condition, Moment, knocked, seen_through
from sim.render.pool import Picture, Poses, ProcessPool, Scene


class StagedPool:
    """A `RenderPool` for one trial. It counts the pictures from the one before the motion, number 0."""

    def __init__(self, scene: Scene, condition: Condition, object_name: str, seed: tuple[int, ...]) -> None:
        self._condition, self._object, self._seed, self._number = condition, object_name, seed, 0
        rng = np.random.default_rng(seed)
        dressed = condition.scene(scene, object_name, rng)
        self._first = self._second = ProcessPool(dressed, 1)
        if condition.knocked_from is not None:
            self._second = ProcessPool(replace(dressed, X_BC=knocked(scene.X_BC, rng)), 1)
        elif condition.glass:
            bare = [visual for visual in dressed.visuals if visual.body != object_name]
            self._second = ProcessPool(replace(dressed, visuals=bare), 1)
        self._developing = ThreadPoolExecutor(1, thread_name_prefix="developing")

    def render(self, poses: Poses, rng: np.random.Generator) -> Future[Picture]:
        """See `RenderPool`."""
        moment = Moment(self._number, np.random.default_rng((*self._seed, self._number)))
        self._number += 1
        bodies = {**poses, **self._condition.bodies(poses, self._object, moment)}
        knocked_from = self._condition.knocked_from
        is_knocked = knocked_from is not None and moment.number >= knocked_from
        picture = (self._second if is_knocked else self._first).render(bodies, copy.deepcopy(rng))
        without = self._second.render(bodies, rng) if self._condition.glass else None
        return self._developing.submit(self._developed, picture, without, moment)

    def close(self, *, finish: bool) -> None:
        """See `RenderPool`."""
        self._developing.shutdown(cancel_futures=not finish)
        for pool in {self._first, self._second}:
            pool.close(finish=finish)

    def _developed(self, picture: Future[Picture], without: Future[Picture] | None, moment: Moment) -> Picture:
        taken = picture.result()
        if without is not None:
            taken = seen_through(taken, without.result(), moment)
        return self._condition.develop(taken, moment)
