"""A session, or one trial, on the live page: turns the watcher's calls into the page's state, which is plain JSON."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import cv2

from adaptsim_cli.bench.rig import Image
from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.views import place
from adaptsim_cli.session.folders import FILM
from adaptsim_cli.session.live_trial import PlannedTrial, TrackedTrial
from adaptsim_cli.session.recording import encode_jpeg
from adaptsim_cli.session.records import MotionRecord, TrialRecord
from adaptsim_cli.session.running import OpenView
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.watching import PosteriorSource, Watcher
from adaptsim_cli.show.dashboard import Dashboard
from adaptsim_cli.show.live_state import (
    head_of,
    live_html,
    motion_shown,
    picture_shown,
    so_far,
    tracked_shown,
    trial_shown,
)
from adaptsim_cli.show.server import LocalServer, Page, require_free
from sim.tasks.task import Task

MOVES = ("approach", "motion", "way back")
"""The motions of a trial, in order."""


class LiveView:
    """`session.watching.Watcher` and `screen.console.Listener` that show everything on one page."""

    def __init__(self, page: Page, task: Task, head: Mapping[str, Any], particles: int) -> None:
        self._page, self._lock = page, Lock()
        self._task, self._particles = task, particles
        self._state: dict[str, Any] = {"now": {"doing": "", "question": ""}}
        self._pictures: dict[str, bytes] = {}
        self._count = 0
        self._moves = 0  # of the trial's `MOVES`, those that have begun
        self._set(head=head)

    def doing(self, what: str, stage: str) -> None:
        """See `Listener`."""
        now: dict[str, Any] = {"doing": what, "since_s": time.time(), "question": ""}
        if stage == "moving" and self._moves < len(MOVES):
            now["move"], self._moves = self._moves, self._moves + 1
        self._set(now=now)

    def asking(self, question: str) -> None:
        """See `Listener`."""
        self._set(now={"doing": "", "question": question, "since_s": time.time()})

    def did(self, what: str, stage: str, took_s: float) -> None:
        """See `Listener`."""
        self.doing("", "")

    def answered(self, question: str, answer: str, took_s: float) -> None:
        """See `Listener`. The answer is shown only in the terminal."""
        self.asking("")

    def noted(self, text: str) -> None:
        """See `Listener`. Warnings are shown in the terminal, and beside the trial."""

    def proposed(self, trial: MotionRecord, planned: PlannedTrial) -> None:
        """See `Watcher`."""
        parts: dict[str, Any] = {
            "trial": trial_shown(self._task, self._particles, trial, planned.summary),
            "judged": None,
        }
        self._pictures, self._moves = {}, 0
        if (preview := planned.preview) is not None:
            name = self._picture(preview.picture)
            parts |= {"picture": picture_shown(preview, name), "motion": motion_shown(preview)}
        self._set(**parts)

    def tracked(self, record: TrialRecord, tracked_trial: TrackedTrial) -> None:
        """See `Watcher`."""
        url = "" if tracked_trial.film is None else f"picture/{self._picture(tracked_trial.files[FILM])}"
        self._set(judged=tracked_shown(record, tracked_trial, url))

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""
        self._set(**so_far(store, self._task, posterior()))

    def reported(self, path: Path) -> None:
        """See `Watcher`."""
        self._set(report=place(path))

    def _picture(self, jpeg: bytes) -> str:
        self._count += 1
        name = f"{self._count}.jpg"
        self._pictures[name] = jpeg
        return name

    def _set(self, **parts: Any) -> None:
        with self._lock:
            self._state |= parts
            self._page.show(self._state, self._pictures)


@contextmanager
def live_view(
    screen: Screen,
    parts: SessionParts,
    name: str,
    what: str,
    hw: str,
    port: int | None = None,
    particles: int = 0,
    root: Path | None = None,
) -> Iterator[LiveView]:
    """Serve the page of the session or rollout `name`; print its address, and how to reach it from another computer.

    `what` describes it in one line. `particles` is their number in an iteration, 0 for a single rollout. The page
    belongs to the dashboard of the sessions below `root`; with None it stands alone. Raises UsageError if the wanted
    port is in use.
    """
    task = parts.task
    has_camera = parts.newest_picture is not None
    head = head_of(task, name, what, parts.target.title, simulated=is_simulated(hw), camera=has_camera)
    page = Page(live_html(), partial(newest_jpeg, parts.newest_picture))
    with LocalServer(Dashboard(root, {name: page}), port) as server, page:
        screen.plain(f"Live page: {server.address}live/{name}/")
        screen.plain(f"From another computer: {server.tunnel}")
        view = LiveView(page, task, head, particles)
        screen.add_listener(view)
        yield view


WIDTH_PX = 960
"""Width of the camera's newest picture on the page."""


def newest_jpeg(newest_picture: Callable[[], Image | None] | None) -> bytes | None:
    """The camera's newest picture for the page; None without one."""
    picture = None if newest_picture is None else newest_picture()
    if picture is None:
        return None
    height, width = picture.shape[:2]
    if width > WIDTH_PX:
        picture = cv2.resize(picture, (WIDTH_PX, round(height * WIDTH_PX / width)), interpolation=cv2.INTER_AREA)
    return encode_jpeg(picture, quality=80)


def live_page(port: int | None) -> OpenView:
    """A page at `port`, or at any free port. Raises UsageError, before anything begins, if the port is in use."""
    if port is not None:
        require_free(port)

    def open_view(screen: Screen, store: SessionStore, parts: SessionParts) -> AbstractContextManager[Watcher]:
        name, facts = store.facts.name, store.facts
        what = f"session {name}, method {facts.method}"
        return live_view(screen, parts, name, what, facts.hw, port, facts.particles, store.folder.parent)

    return open_view
