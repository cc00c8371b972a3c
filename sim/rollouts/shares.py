"""Shares of a piece of work for independent processes, such as those of a job array or of several computers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Share:
    """The `number`-th of `count` shares. Raises ValueError unless 1 <= `number` <= `count`."""

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise ValueError(f"{self.number}/{self.count} is not a share")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, items: Sequence[T], before: int = 0) -> list[T]:
        """Every `count`-th item, so that shares take about as long as each other.

        `before` is the number of items of the same work that precede these.
        """
        return list(items[(self.number - 1 - before) % self.count :: self.count])
