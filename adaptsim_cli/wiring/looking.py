"""Opens the live page beside the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from adaptsim_cli.screen.console import Screen
from adaptsim_cli.session.conduct import OpenView
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.session.target import Parts
from adaptsim_cli.session.watching import RunHeader, Watcher
from adaptsim_cli.view.live import live_view


def beside(port: int | None) -> OpenView:
    """A page at `port`, or at any free port. Opening it raises UsageError if the port is in use."""

    @contextmanager
    def open_view(screen: Screen, store: SessionStore, parts: Parts) -> Iterator[Watcher]:
        with live_view(screen, parts.task, RunHeader.session(store.facts), parts.target.title, port) as view:
            yield view

    return open_view


@contextmanager
def beside_one(screen: Screen, name: str, hw: str, parts: Parts, port: int | None) -> Iterator[Watcher]:
    """The same for the one trial of the rollout `name`."""
    with live_view(screen, parts.task, RunHeader(name, f"rollout {name}", hw), parts.target.title, port) as view:
        yield view
