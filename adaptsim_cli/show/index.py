"""One page of all sessions, with a search, tags, learning curves side by side, and the report and film of each session.

`adaptsim dashboard` serves it and `adaptsim sessions index` writes it: the same page, whose links lead to files below
the folder of all sessions.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.screen.html import fill
from adaptsim_cli.session.about import about
from adaptsim_cli.session.advice import HEADLINES
from adaptsim_cli.session.folders import FILM, REPORT, names
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show.comparison import ComparedSession, compared_session, interval_over
from adaptsim_cli.storage import durable

PAGE = "index.html"
_TAG = re.compile(r"(?:^|\s)#([\w.-]+)")


@dataclass(frozen=True)
class IndexedSession:
    """One row of the page."""

    session: ComparedSession
    report: str  # the link to its page; "": it has none yet
    film: str  # the link to the pictures of its newest trial with a camera; "": it has none
    note: str  # of the operator

    @property
    def tags(self) -> tuple[str, ...]:
        """The words of the note that begin with #, without it."""
        return tuple(dict.fromkeys(_TAG.findall(self.note)))

    @property
    def verdict(self) -> str:
        """The headline of its newest verdict; "" before the first one."""
        result = self.session.result
        return HEADLINES[result.verdict.kind] if result else ""

    @property
    def curve(self) -> str:
        """Trials so far, mean reward, and its 95 % interval for every complete iteration, as JSON."""
        rows, so_far = list[tuple[float, ...]](), 0
        for one in self.session.iterations:
            so_far += one.trials
            rows.append((so_far, *(round(value, 4) for value in (one.mean, one.low, one.high))))
        return json.dumps(rows)


@dataclass(frozen=True)
class IndexedGroup:
    """The sessions of one method in one place, with the mean of their last iterations."""

    task: str
    place: str
    method: str
    sessions: tuple[IndexedSession, ...]

    @property
    def reward(self) -> float:
        """The mean over its sessions."""
        ends = [one.session.iterations[-1].mean for one in self.sessions]
        return sum(ends) / len(ends)

    @property
    def ci95(self) -> tuple[float, float] | None:
        """The 95 % interval of that mean over sessions; None with fewer than two."""
        interval = interval_over([one.session.iterations[-1].mean for one in self.sessions])
        return None if interval is None else interval[1:]


def write(root: Path, out: Path | None = None) -> tuple[Path, int]:
    """Write the page of all sessions below `root` (default: there) -> its path, and how many sessions it shows.

    Damaged sessions and those without a trial are named on it. Raises UsageError without any session, SessionError.
    """
    every = names(root)
    if not every:
        raise UsageError(f"there are no sessions in {root}: begin one with adaptsim run-iteration --task scooping")
    path = out or root / PAGE
    rows, left_out = listed(root, every, path.absolute().parent)
    durable.make_folder(path.absolute().parent)
    durable.replace_file(path, render(rows, left_out).encode())
    return path, len(rows)


def listed(root: Path, every: Sequence[str], beside: Path) -> tuple[list[IndexedSession], list[str]]:
    """The rows of these sessions for a page in the folder `beside`, and a sentence for each that has none."""
    rows, left_out = list[IndexedSession](), list[str]()
    for name in every:
        try:
            rows.append(indexed(SessionStore.open(root, name), beside))
        except (SessionError, UsageError) as error:
            left_out.append(str(error))
    return rows, left_out


def render(
    rows: Sequence[IndexedSession],
    left_out: Sequence[str] = (),
    running: Sequence[str] = (),
    *,
    is_served: bool = False,
) -> str:
    """The page as HTML; `running` are sessions with a live page. A served page follows the sessions by itself."""
    return fill(
        "show/index.html.j2",
        rows=rows,
        groups=grouped(rows),
        left_out=left_out,
        running=running,
        tags=sorted({tag for row in rows for tag in row.tags}),
        is_served=is_served,
    )


def grouped(rows: Sequence[IndexedSession]) -> tuple[IndexedGroup, ...]:
    """The sessions by task, place and method, in the order of their names."""
    groups: dict[tuple[str, str, str], list[IndexedSession]] = {}
    for row in rows:
        facts = row.session.facts
        groups.setdefault((facts.task, row.session.target_name, facts.method), []).append(row)
    return tuple(IndexedGroup(*key, tuple(members)) for key, members in sorted(groups.items()))


def indexed(store: SessionStore, beside: Path) -> IndexedSession:
    """One row. Raises UsageError without a completed trial, SessionError on damage."""
    films = sorted(store.folder.glob(f"iteration-*/trial-*/{FILM}"))
    page = store.folder / REPORT
    return IndexedSession(
        compared_session(store),
        _link(page, beside) if page.is_file() else "",
        _link(films[-1], beside) if films else "",
        about(store.folder).note,
    )


def _link(path: Path, beside: Path) -> str:
    """The link to a file from a page in the folder `beside`: relative where the file lies below it."""
    path = path.absolute()
    return quote(path.relative_to(beside).as_posix()) if path.is_relative_to(beside) else path.as_uri()
