"""Announces and times a slow step: `with during("Finding the bottle", "finding"):` around it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class During(Protocol):
    """Tells the operator about a running step; `Screen.busy` is one."""

    def __call__(self, what: str, stage: str = "") -> AbstractContextManager[None]:
        """`what` is the sentence for the operator; `stage` is the word under which its time is added up."""
        ...


@contextmanager
def silently(what: str, stage: str = "") -> Iterator[None]:
    """A `During` that says nothing."""
    yield
