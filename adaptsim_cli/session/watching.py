"""The interface to watchers: views of a running session besides the terminal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from adaptsim_cli.session.operator import Judged, Proposal
from adaptsim_cli.session.records import Facts, KeyMoment
from adaptsim_cli.session.store import SessionStore
from hw.types import Array
from perception.types import ObjectTrack
from sim.adaptation.posterior import Posterior

Telling = Callable[[], Posterior | None]
"""Computes the belief about the true parameters on request; None if the method has none."""


@dataclass(frozen=True)
class Occasion:
    """The session or rollout that a watcher shows."""

    name: str  # of the session or rollout
    what: str  # one line: the session and its method, or the rollout
    hw: str
    particles: int = 0  # 0: a single rollout

    @classmethod
    def session(cls, facts: Facts) -> Occasion:
        """A session."""
        return cls(facts.name, f"session {facts.name}, method {facts.method}", facts.hw, facts.particles)


@dataclass(frozen=True, eq=False)
class Sight:
    """One planned trial to look at, before anything moves."""

    picture: bytes  # JPEG: start area, goal, and the object found
    size_px: tuple[int, int]  # of the picture: width, height
    path_px: Array  # (M, 2) path of the tool in the picture, during its motion
    path_m: Array  # (M, 3) the same in the base frame
    t_s: Array  # (K,) from the start of the approach to the end of the way back
    arm_m: Array  # (K, J, 3) base, joints, flange and tool at these times, in the base frame
    motion_s: tuple[float, float]  # start and end of the tool's own motion
    spot_m: Array  # (2,) the object's measured place
    area_m: Array  # (4,) allowed area: low x, high x, low y, high y
    goal_m: Array | None  # (2,) where it should come to rest, for a task with such a goal


@dataclass(frozen=True, eq=False)
class Seen:
    """One tracked trial to look at, before the operator reviews it."""

    track_px: Array  # (N, 2) the object's centre in the picture; (0, 2) without a camera
    moments: tuple[KeyMoment, ...]
    files: Mapping[str, bytes]  # name -> JPEG of the moments


class Watcher(Protocol):
    """A view of a session. Each call returns at once, and never raises because it cannot show something."""

    def proposed(self, made: Proposal, sight: Sight | None) -> None:
        """A trial is planned; the operator is asked next."""
        ...

    def tracked(self, judged: Judged, track: ObjectTrack, seen: Seen) -> None:
        """A trial is tracked; the operator reviews it next."""
        ...

    def changed(self, store: SessionStore, posterior: Telling) -> None:
        """A trial or a result was stored."""
        ...

    def reported(self, path: Path) -> None:
        """The report of the session was drawn."""
        ...


class Unwatched:
    """`Watcher` that shows nothing."""

    def proposed(self, made: Proposal, sight: Sight | None) -> None:
        """See `Watcher`."""

    def tracked(self, judged: Judged, track: ObjectTrack, seen: Seen) -> None:
        """See `Watcher`."""

    def changed(self, store: SessionStore, posterior: Telling) -> None:
        """See `Watcher`."""

    def reported(self, path: Path) -> None:
        """See `Watcher`."""


class AllOf:
    """`Watcher` that forwards to several."""

    def __init__(self, watchers: Sequence[Watcher]) -> None:
        self._watchers = tuple(watchers)

    def proposed(self, made: Proposal, sight: Sight | None) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.proposed(made, sight)

    def tracked(self, judged: Judged, track: ObjectTrack, seen: Seen) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.tracked(judged, track, seen)

    def changed(self, store: SessionStore, posterior: Telling) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.changed(store, posterior)

    def reported(self, path: Path) -> None:
        """See `Watcher`."""
        for watcher in self._watchers:
            watcher.reported(path)
