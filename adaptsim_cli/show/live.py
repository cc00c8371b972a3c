"""A session, or one trial, on the live page: turns the watcher's calls into the page's state, which is plain JSON."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from importlib import resources
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from adaptsim_cli.bench.rig import Image
from adaptsim_cli.config import is_simulated
from adaptsim_cli.screen.console import Screen
from adaptsim_cli.screen.views import number, quantity, values
from adaptsim_cli.session.advice import best_in_words, check_first, compared_in_words, in_words
from adaptsim_cli.session.film import FILM
from adaptsim_cli.session.history import means_of, played_of, results_of
from adaptsim_cli.session.live_trial import MotionPreview, Placement, TrackedTrial
from adaptsim_cli.session.recording import encode_jpeg
from adaptsim_cli.session.records import MotionRecord, ResultRecord, TrialRecord
from adaptsim_cli.session.running import OpenView
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import SessionParts
from adaptsim_cli.session.watching import PosteriorSource, Watcher
from adaptsim_cli.show.server import Page, require_free
from sim.adaptation.posterior import Posterior
from sim.adaptation.stages import Role
from sim.tasks.task import Task
from sim.types import Space

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

    def proposed(self, trial: MotionRecord, planned: Placement) -> None:
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
    screen: Screen, parts: SessionParts, name: str, what: str, hw: str, port: int | None, particles: int = 0
) -> Iterator[LiveView]:
    """Serve the page of the session or rollout `name`; print its address, and how to reach it from another computer.

    `what` describes it in one line; `particles` of an iteration, 0: a single rollout. Raises UsageError if the wanted
    port is in use.
    """
    html = (resources.files("adaptsim_cli.show") / "live.html").read_text(encoding="utf-8")
    task = parts.task
    head = {
        "simulated": is_simulated(hw),
        "hardware": parts.target.title,
        "name": name,
        "what": what,
        "task": task.title[:1].upper() + task.title[1:],
        "object": task.object_name,
        "camera": parts.newest_picture is not None,
    }
    with Page(html, port, partial(newest_jpeg, parts.newest_picture)) as page:
        screen.plain(f"Live page: {page.address}")
        tunnel = f"ssh -L {page.port}:127.0.0.1:{page.port} {_here()}"
        screen.plain(f"From another computer: {tunnel}")
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


def _here() -> str:
    import getpass
    import socket

    return f"{getpass.getuser()}@{socket.gethostname()}"


BINS = 24
"""Number of bins of one parameter's posterior, over its range."""


def quantities(space: Space, point: Mapping[str, float]) -> list[dict[str, str]]:
    """Plain name, value with its unit, and meaning of each quantity."""
    return [
        {"name": d.name, "plain": d.plain_name, "value": quantity(point[d.name], d.unit), "meaning": d.meaning}
        for d in space.dimensions
    ]


def trial_shown(task: Task, particles: int, trial: MotionRecord, summary: str) -> dict[str, Any]:
    """A proposed trial in words."""
    return {
        "number": trial.trial,
        "attempt": trial.attempt,
        "iteration": trial.iteration,
        "particle": trial.particle,
        "particles": particles,  # 0: a single rollout
        "parameters": [] if trial.is_blind else quantities(task.parameters, trial.parameters),
        "context": quantities(task.context, trial.context),
        "action": quantities(task.action, trial.action),
        "expected": None if trial.is_blind else [trial.predicted_reward, trial.predicted_low, trial.predicted_high],
        "summary": summary,
    }


def motion_shown(preview: MotionPreview) -> dict[str, Any]:
    """The planned motion of the arm, and the marks on the table, in m."""
    return {
        "t_s": _rounded(preview.t_s, 3),
        "arm_m": _rounded(preview.arm_m, 4),
        "path_m": _rounded(preview.path_m, 4),
        "motion_s": list(preview.motion_s),
        "spot_m": _rounded(preview.spot_m, 4),
        "area_m": _rounded(preview.area_m, 4),
        "goal_m": None if preview.goal_m is None else _rounded(preview.goal_m, 4),
    }


def picture_shown(preview: MotionPreview, name: str) -> dict[str, Any]:
    """The camera's picture, and its overlay in pixels."""
    width, height = preview.size_px
    return {"url": f"picture/{name}", "width": width, "height": height, "path_px": _rounded(preview.path_px, 1)}


def tracked_shown(record: TrialRecord, tracked_trial: TrackedTrial, url: str) -> dict[str, Any]:
    """A tracked trial, before its review; `url` is that of its film."""
    state = tracked_trial.track.state
    return {
        "outcome": record.outcome_words,
        "reward": record.reward,
        "flags": list(record.track.flags),
        "track_px": _rounded(tracked_trial.track_px, 1),
        "track_m": _rounded(state[:, :3], 4) if state.shape[1] >= 3 else [],
        "film": None if record.film is None else {"url": url, "end_s": record.film.end_s},
    }


def so_far(store: SessionStore, task: Task, posterior: Posterior | None) -> dict[str, Any]:
    """Rewards and parameters of the whole session."""
    results, facts, layout = results_of(store), store.facts, store.facts.layout
    first = check_first(facts.task, facts.hw, facts.calibration)
    return {
        "rewards": [_reward(record, len(results)) for record in played_of(store)],
        "ends": [layout.numbers(i).stop - 1 for i in range(max(1, store.iterations()))],
        "control": compared_in_words(results[-1].control) if results and results[-1].control is not None else "",
        "parameters": _parameters(store, task, results, posterior),
        "verdict": in_words(results[-1].verdict, store.facts.object_name, first=first) if results else "",
        "best": _best(task, results[-1]) if results else "",
    }


def _reward(record: TrialRecord, complete: int) -> dict[str, Any]:
    """A trial among all; whose policy acted is told once its iteration is among the `complete` ones."""
    is_control = record.role is Role.CONTROL and record.iteration <= complete
    return {
        "number": record.trial,
        "particle": record.particle,
        "reward": record.reward,
        "expected": None if record.is_blind else [record.predicted_low, record.predicted_high],
        "outcome": record.outcome_words + (", control" if is_control else ""),
        "control": is_control,
    }


def _best(task: Task, result: ResultRecord) -> str:
    params = result.best.params
    return best_in_words(result.best, values(task.parameters, np.array([params[n] for n in task.parameters.names])))


def _parameters(
    store: SessionStore, task: Task, results: Sequence[ResultRecord], posterior: Posterior | None
) -> list[dict[str, Any]]:
    """Each parameter with its range, the particles of every iteration as fractions of the range, and the posterior."""
    space = task.parameters
    means = means_of(store, results)
    unit = space.normalise(means)
    marginals = None if posterior is None or posterior.is_collapsed else _marginals(space, posterior)
    return [
        {
            "name": d.name,
            "plain": d.plain_name,
            "unit": d.unit,
            "meaning": d.meaning,
            "low": number(d.low),
            "high": number(d.high),
            "steps": _rounded(unit[:, :, k], 4),
            "now": [number(float(v)) for v in means[-1, :, k]],
            "posterior": None if marginals is None else marginals[k],
        }
        for k, d in enumerate(space.dimensions)
    ]


def _marginals(space: Space, posterior: Posterior) -> list[list[float]]:
    """The probability of each of `BINS` parts of every parameter's range; values beyond count at the ends."""
    unit = np.clip(space.normalise(posterior.samples), 0.0, 1.0 - 1e-9)
    return [
        _rounded(np.bincount((BINS * column).astype(int), weights=posterior.weights, minlength=BINS), 5)
        for column in unit.T
    ]


def _rounded(values: NDArray[Any], digits: int) -> list[Any]:
    rounded: list[Any] = np.round(np.nan_to_num(np.asarray(values, dtype=float)), digits).tolist()
    return rounded


def live_page(port: int | None) -> OpenView:
    """A page at `port`, or at any free port. Raises UsageError, before anything begins, if the port is in use."""
    if port is not None:
        require_free(port)

    def open_view(screen: Screen, store: SessionStore, parts: SessionParts) -> AbstractContextManager[Watcher]:
        name, facts = store.facts.name, store.facts
        what = f"session {name}, method {facts.method}"
        return live_view(screen, parts, name, what, facts.hw, port, facts.particles)

    return open_view
