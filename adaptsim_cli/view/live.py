"""A session, or one trial, on the live page: turns the watcher's calls into the page's state."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from threading import Lock
from typing import Any

from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.film import FILM
from adaptsim_cli.session.operator import Proposal
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import MotionPreview, Parts, TrackedTrial
from adaptsim_cli.session.watching import PosteriorSource
from adaptsim_cli.view import state
from adaptsim_cli.view.server import Page
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
        """See `Listener`: the answer stays in the terminal."""
        self.asking("")

    def noted(self, text: str) -> None:
        """See `Listener`: warnings are shown in the terminal, and with the trial."""

    def proposed(self, made: Proposal, preview: MotionPreview | None) -> None:
        """See `Watcher`."""
        parts: dict[str, Any] = {"trial": state.trial(self._task, self._particles, made), "judged": None}
        self._pictures, self._moves = {}, 0
        if preview is not None:
            name = self._picture(preview.picture)
            parts |= {"picture": state.picture(preview, name), "motion": state.motion(preview)}
        self._set(**parts)

    def tracked(self, record: TrialRecord, seen: TrackedTrial) -> None:
        """See `Watcher`."""
        url = "" if seen.film is None else f"picture/{self._picture(seen.files[FILM])}"
        self._set(judged=state.tracked(record, seen, url))

    def changed(self, store: SessionStore, posterior: PosteriorSource) -> None:
        """See `Watcher`."""
        self._set(**state.so_far(store, self._task, posterior()))

    def reported(self, path: Path) -> None:
        """See `Watcher`."""
        self._set(report=str(path))

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
    screen: Screen, parts: Parts, name: str, what: str, hw: str, port: int | None, particles: int = 0
) -> Iterator[LiveView]:
    """Serve the page of the session or rollout `name`; print its address, and how to reach it from another computer.

    `what` describes it in one line; `particles` of an iteration, 0: a single rollout. Raises UsageError if the wanted
    port is in use.
    """
    html = (resources.files("adaptsim_cli.view") / "page.html").read_text(encoding="utf-8")
    task = parts.task
    head = {
        "simulated": is_simulated(hw),
        "hardware": parts.target.title,
        "name": name,
        "what": what,
        "task": task.title[:1].upper() + task.title[1:],
        "object": task.object_name,
    }
    with Page(html, port) as page:
        screen.plain(f"Live page: {page.address}")
        tunnel = f"ssh -L {page.port}:127.0.0.1:{page.port} {_here()}"
        screen.plain(f"From another computer: {tunnel}")
        view = LiveView(page, task, head, particles)
        screen.tell(view)
        yield view


def _here() -> str:
    import getpass
    import socket

    return f"{getpass.getuser()}@{socket.gethostname()}"
