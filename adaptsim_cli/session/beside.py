"""Work beside the operator: the one thread that draws reports and prepares a policy while a person reads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Ahead(Generic[T]):
    """Work that may be done before its result is needed. Work that has not begun is done by whoever needs it."""

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
        """Return once the work is not running: it has ended in any way, or it never begins."""
        if not self.future.cancel():
            self.future.exception()


@dataclass(frozen=True, eq=False)
class Beside:
    """Pieces of work, one after the other; without a thread, each is done when its result is needed."""

    thread: Executor | None = None

    def begin(self, work: Callable[[], T]) -> Ahead[T]:
        """Begin as soon as the thread is free."""
        return Ahead(work, self.thread.submit(work) if self.thread else Future())


@contextmanager
def one_thread() -> Iterator[Beside]:
    """A thread for one command; the command ends once the work that it began has ended."""
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="beside") as thread:
        yield Beside(thread)
