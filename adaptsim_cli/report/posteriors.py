"""The posteriors of several sessions beside each other: in which parameter do they disagree?"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from adaptsim_cli.report.svg import plain

LEVELS = (0.05, 0.5, 0.95)
"""Lower end, median and upper end of the shown interval."""


@dataclass(frozen=True)
class Believed:
    """What one session believes of one parameter."""

    session: str
    parameter: str
    unit: str
    low: float
    median: float
    high: float

    @property
    def in_words(self) -> str:
        """The interval."""
        return f"{plain(self.low)} to {plain(self.high)} {self.unit}".rstrip()

    def is_apart(self, other: Believed) -> bool:
        """Whether the two intervals have nothing in common."""
        return self.high < other.low or other.high < self.low


def disagreements(found: Sequence[Believed]) -> tuple[str, ...]:
    """One sentence for each parameter whose 90 % intervals in two sessions do not overlap, or one if all overlap."""
    told = []
    for parameter in dict.fromkeys(one.parameter for one in found):
        mine = [one for one in found if one.parameter == parameter]
        apart = [(a, b) for a, b in itertools.combinations(mine, 2) if a.is_apart(b)]
        if apart:
            a, b = max(apart, key=lambda pair: max(pair[0].low - pair[1].high, pair[1].low - pair[0].high))
            count = f"; {len(apart)} pairs in all" if len(apart) > 1 else ""
            told.append(
                f"The posteriors disagree in {parameter}: {a.session} has {a.in_words}, {b.session} {b.in_words} "
                f"(90 %){count}."
            )
    if len({one.session for one in found}) < 2:
        return ()
    return tuple(told) or ("The posteriors disagree in no parameter: all 90 % intervals overlap.",)
