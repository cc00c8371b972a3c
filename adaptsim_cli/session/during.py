"""How a step that takes time says so: `with during("Finding the bottle", "finding"):` around it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol


class During(Protocol):
    """Tells the operator what is being done while it is done; `Screen.busy` is one."""

    def __call__(self, what: str, stage: str = "") -> AbstractContextManager[None]:
        """`what` for the operator; `stage`: one word under which its time is added up."""
        ...


@contextmanager
def silently(what: str, stage: str = "") -> Iterator[None]:
    """Nobody is told."""
    yield
