"""Work beside the operator: the one thread that draws reports and warms policies up while a person reads."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Task(Generic[T]):
    """A piece of work that may have been done by the time its result is needed."""

    work: Callable[[], T]
    future: Future[T]

    def result(self) -> T:
        """The result; work that has not begun is done here, at once. Raises the error of the work."""
        return self.work() if self.future.cancel() else self.future.result()

    def drop(self) -> None:
        """Nobody needs the result any more. Raises the error of work that has failed by now."""
        if not self.future.cancel() and self.future.done():
            self.future.result()

    def settle(self) -> None:
        """Return once the work is not running: ended in any way, or never begun."""
        if not self.future.cancel():
            self.future.exception()


class Beside:
    """One thread, so that pieces of work follow each other."""

    def __init__(self, pool: ThreadPoolExecutor) -> None:
        self._pool = pool

    def begin(self, work: Callable[[], T]) -> Task[T]:
        """Begin `work` as soon as the thread is free."""
        return Task(work, self._pool.submit(work))


@contextmanager
def beside() -> Iterator[Beside]:
    """The thread until the end of a command; work that has not begun by then is dropped."""
    pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="beside")
    try:
        yield Beside(pool)
    finally:
        pool.shutdown(cancel_futures=True)
