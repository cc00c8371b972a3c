"""The site of all sessions: the index, the live page of each that runs, reports and films. It changes nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from threading import Lock
from urllib.parse import quote

from adaptsim_cli.errors import SessionError, UsageError
from adaptsim_cli.screen import log
from adaptsim_cli.session.about import ABOUT
from adaptsim_cli.session.folders import REPORT, names
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import index
from adaptsim_cli.show.index import IndexedSession
from adaptsim_cli.show.running_sessions import running
from adaptsim_cli.show.server import HTML, JPEG, KEEP_ALIVE, Answer, Content, Page, event
from adaptsim_cli.show.stored_page import POLL_S, QUIET, StoredPage
from adaptsim_cli.storage.durable import version_of

KINDS = {".html": HTML, ".jpg": JPEG, ".png": "image/png"}
"""The files of a session that are served, by suffix."""


class Dashboard:
    """`server.Site` of the sessions below `root`. `pages` are live pages of this process, by name of their session."""

    def __init__(self, root: Path | None, pages: Mapping[str, Page] | None = None) -> None:
        self._root, self._pages = root, pages or {}
        self._lock = Lock()
        self._rows: dict[str, tuple[object, IndexedSession | str]] = {}  # version of the files, and their row

    def __call__(self, path: str) -> Answer | None:
        """See `server.Site`."""
        if path.startswith("/live/"):
            return self._live(path.removeprefix("/live/"))
        if self._root is None:
            return None
        if path == "/":
            return Content(HTML, self.index(self._root).encode())
        if path == "/changes":
            return self._changes(self._root, _state(self._root))  # now: a stream begins only once it is read
        return _file(self._root, path)

    def index(self, root: Path) -> str:
        """The page of all sessions."""
        every = [self._row(root, name) for name in names(root)]
        rows = [one for one in every if isinstance(one, IndexedSession)]
        left_out = [one for one in every if isinstance(one, str)]
        live = dict.fromkeys((*running(root), *self._pages))
        return index.render(rows, left_out, tuple(map(quote, live)), is_served=True)

    def _live(self, path: str) -> Answer | None:
        name, slash, rest = path.partition("/")
        if not slash:
            return None
        if (page := self._pages.get(name)) is not None:
            return page.get(rest)
        if self._root is None or name not in names(self._root):
            return None
        try:
            return StoredPage(self._root, name).get(rest)
        except SessionError:
            return None

    def _row(self, root: Path, name: str) -> IndexedSession | str:
        """The row of a session, or the reason why it has none; read again once its files have changed."""
        version = _version(root / name)
        with self._lock:
            row_and_version = self._rows.get(name)
            if row_and_version is None or row_and_version[0] != version:
                try:
                    row: IndexedSession | str = index.indexed(SessionStore.open(root, name), root)
                except (SessionError, UsageError) as error:
                    row = str(error)
                row_and_version = self._rows[name] = (version, row)
        return row_and_version[1]

    def _changes(self, root: Path, last: object) -> Iterator[bytes]:
        """An event whenever a session changes, begins or ends after the state `last`."""
        quiet = 0
        while True:
            time.sleep(POLL_S)
            if (now := _state(root)) != last:
                last, quiet = now, 0
                yield event(b"{}")
            elif (quiet := quiet + 1) % QUIET == 0:
                yield KEEP_ALIVE


def _state(root: Path) -> object:
    return running(root), {name: _version(root / name) for name in names(root)}


def _version(folder: Path) -> object:
    """A value that changes once a trial, a result, a report, a note or a correction was written."""
    parts = (log.FILE, ABOUT, REPORT)
    return tuple(version_of(path) for path in (*(folder / name for name in parts), *sorted(folder.glob("iteration-*"))))


def _file(root: Path, path: str) -> Content | None:
    """A page or a picture within a session's own folder; None for everything else, links too."""
    parts = PurePosixPath(path.lstrip("/")).parts
    file = root.joinpath(*parts)
    if len(parts) < 2 or ".." in parts or file.suffix not in KINDS or parts[0] not in names(root):
        return None
    if not file.is_file() or file.resolve() != root.resolve().joinpath(*parts):
        return None
    return Content(KINDS[file.suffix], file.read_bytes())
