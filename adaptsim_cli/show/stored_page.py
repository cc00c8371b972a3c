"""The live page of a session that another command runs, made from the files that this command writes."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from adaptsim_cli.config import is_simulated
from adaptsim_cli.errors import SessionError
from adaptsim_cli.screen import log
from adaptsim_cli.screen.log import LogLine
from adaptsim_cli.session.folders import FILM
from adaptsim_cli.session.history import played_of
from adaptsim_cli.session.records import TrialRecord
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show.live_state import head_of, live_html, so_far, trial_shown
from adaptsim_cli.show.running_sessions import running
from adaptsim_cli.show.server import HTML, JPEG, KEEP_ALIVE, OVER, Answer, Content, event
from adaptsim_cli.storage import durable
from hw.bounded import Unreadable
from sim.tasks import known_task

POLL_S = 1.0
QUIET = 5
"""Polls without news after which a comment is sent, to notice a closed page."""


class StoredPage:
    """The page of one session; its state is read again whenever its log grows."""

    def __init__(self, root: Path, name: str) -> None:
        """Raises SessionError if the session cannot be read, UsageError for an impossible name."""
        self._root, self._name = root, name
        self._store = SessionStore.open(root, name)

    def get(self, path: str) -> Answer | None:
        """The page at "", or its stream of states; the camera belongs to the command that runs."""
        if path == "":
            return Content(HTML, live_html().encode())
        if path == "state":
            return self._states()
        if path == "camera":
            return Content(JPEG, None)
        return None

    def state(self) -> dict[str, Any]:
        """The state according to the files as they are now. Raises SessionError."""
        store, facts = self._store, self._store.facts
        if (task := known_task(facts.task)) is None:
            sentence = f"The task {facts.task} cannot be loaded here, so the page shows nothing of this session."
            return {"now": {"doing": sentence, "question": "", "since_s": time.time()}}
        what = f"session {facts.name}, method {facts.method}"
        simulated = is_simulated(facts.hw)
        hardware = f"simulated world {facts.world}" if simulated else facts.hw
        head = head_of(task, facts.name, what, hardware, simulated=simulated, camera=False)
        state: dict[str, Any] = {"head": head, "now": now_of(self._log()), **so_far(store, task, None)}
        if played := played_of(store):
            newest = played[-1]
            state["trial"] = trial_shown(task, facts.particles, newest, "")
            state["judged"] = self._judged(newest)
        return state

    def _judged(self, trial: TrialRecord) -> dict[str, Any]:
        film = self._store.trial_folder(*trial.position) / FILM
        address = f"../../{film.relative_to(self._root).as_posix()}"
        shown = trial.film is not None and film.is_file()
        return {
            "outcome": trial.outcome_words,
            "reward": trial.reward,
            "flags": list(trial.track.flags),
            "track_px": [],
            "track_m": [],
            "film": {"url": address, "end_s": trial.film.end_s} if shown and trial.film is not None else None,
        }

    def _log(self) -> Sequence[LogLine]:
        try:
            return log.read(self._store.folder)
        except (OSError, Unreadable):
            return ()

    def _states(self) -> Iterator[bytes]:
        last: object = None
        quiet = 0
        while True:
            is_running = self._name in running(self._root)
            now = durable.version_of(self._store.folder / log.FILE)
            if now != last:
                last, quiet = now, 0
                try:
                    yield event(json.dumps(self.state(), allow_nan=False).encode())
                except SessionError:  # between two files of a record: the next poll reads it
                    last = None
            elif (quiet := quiet + 1) % QUIET == 0:
                yield KEEP_ALIVE
            if not is_running:
                yield OVER
                return
            time.sleep(POLL_S)


def now_of(lines: Sequence[LogLine]) -> dict[str, Any]:
    """The present step according to the log: the open question, or the last completed step."""
    if not lines:
        return {"doing": "", "question": ""}
    last = lines[-1]
    since_s = datetime.fromisoformat(last.at).timestamp()
    if last.event == "asked":
        return {"doing": "", "question": last.text, "since_s": since_s}
    last_step = next((line.text for line in reversed(lines) if line.event == "done"), "")
    return {
        "doing": f"Running; the last step: {last_step}" if last_step else "Running",
        "question": "",
        "since_s": since_s,
    }
