"""One page of all sessions: grouped by task, place and method, each with its report and its film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.screen.html import fill
from adaptsim_cli.session.film import FILM
from adaptsim_cli.session.folders import names
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show.comparison import ComparedSession, compared_session, interval_over
from adaptsim_cli.storage import durable

PAGE = "index.html"
REPORT = "report.html"


@dataclass(frozen=True)
class IndexedSession:
    """One row of the page."""

    session: ComparedSession
    report: str  # the link to its page; "": it has none yet
    film: str  # the link to the pictures of its newest trial with a camera; "": it has none


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
    rows, left_out = list[IndexedSession](), list[str]()
    for name in every:
        try:
            store = SessionStore.open(root, name)
            rows.append(_indexed(store, path.absolute().parent))
        except (SessionError, UsageError) as error:
            left_out.append(str(error))
    durable.make_folder(path.absolute().parent)
    durable.replace_file(path, render(rows, left_out).encode())
    return path, len(rows)


def render(rows: Sequence[IndexedSession], left_out: Sequence[str] = ()) -> str:
    """The page as HTML."""
    return fill("show/index.html.j2", rows=rows, groups=grouped(rows), left_out=left_out)


def grouped(rows: Sequence[IndexedSession]) -> tuple[IndexedGroup, ...]:
    """The sessions by task, place and method, in the order of their names."""
    groups: dict[tuple[str, str, str], list[IndexedSession]] = {}
    for row in rows:
        facts = row.session.facts
        groups.setdefault((facts.task, row.session.target_name, facts.method), []).append(row)
    return tuple(IndexedGroup(*key, tuple(members)) for key, members in sorted(groups.items()))


def _indexed(store: SessionStore, beside: Path) -> IndexedSession:
    films = sorted(store.folder.glob(f"iteration-*/trial-*/{FILM}"))
    page = store.folder / REPORT
    return IndexedSession(
        compared_session(store),
        _link(page, beside) if page.is_file() else "",
        _link(films[-1], beside) if films else "",
    )


def _link(path: Path, beside: Path) -> str:
    """The link to a file from a page in the folder `beside`: relative where the file lies below it."""
    path = path.absolute()
    return quote(path.relative_to(beside).as_posix()) if path.is_relative_to(beside) else path.as_uri()
