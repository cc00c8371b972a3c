"""Work in the background of a session, such as its report: the session waits for it only where it needs the result."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Deferred(Generic[T]):
    """Work in the background. If it has not started when its result is needed, the caller runs it."""

    work: Callable[[], T]
    future: Future[T]

    def result(self) -> T:
        """The result. Raises the error of the work."""
        return self.work() if self.future.cancel() else self.future.result()

    def drop(self) -> None:
        """Nobody needs the result any more. Raises the error of work that has failed by now."""
        if not self.future.cancel() and self.future.done():
            self.future.result()

    def settle(self) -> None:
        """Return once the work has ended, by success or failure, or can no longer begin."""
        if not self.future.cancel():
            self.future.exception()


def submit(thread: Executor | None, work: Callable[[], T]) -> Deferred[T]:
    """Begin once the thread is free; without a thread, when the result is needed."""
    return Deferred(work, thread.submit(work) if thread else Future())
