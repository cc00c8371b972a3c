"""Summary of a sealed benchmark: every entry against `adaptsim`, paired by world, in all worlds and by need.

A world *needs* an action of its own if its best action earns more by `NEED` than the best fixed rule. The best fixed
rule is the one with the highest mean over all worlds, according to the trials for choices. The limit of a world is the
better of `best-action` and `oracle`. Worlds are the units; an entry's reward in a world is its mean over seeds, so
deterministic repeats count once. Intervals are Student's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hw.types import Array
from sim.research.benchmark.entries import ABLATIONS, BASELINES, BEST_ACTION, FIXED_RULES, LIMITS, ORACLE, Entry
from sim.research.benchmark.jobs import DEFAULT, BenchmarkRow

NEED = 0.1

SEALED_ENTRIES = (
    *FIXED_RULES,
    DEFAULT,
    f"{DEFAULT}@omega",
    *ABLATIONS,
    *BASELINES,
    "least-squares@omega",
    "simopt@margin",
    "sysid-bayes",
    "sysid-bayes@margin",
    "bo-prior",
    "bo-prior@margin",
    "random",
    "random@margin",
    "learn-in-target",
    "adaptsim-iteration",
    *LIMITS,
    f"{ORACLE}@margin",
)
"""What a sealed benchmark compares unless methods are named."""

Interval = tuple[float, float]

ALL, IN_NEED, OTHERS = "all", "in need", "others"
STRATA = (ALL, IN_NEED, OTHERS)


@dataclass(frozen=True)
class StratumSummary:
    """One entry in one stratum of worlds."""

    stratum: str
    entry: str
    worlds: int
    reward: float
    ci95: Interval
    behind: float  # mean of `adaptsim` minus this entry
    behind_ci95: Interval  # paired by world
    most_behind: float  # largest difference in a world


@dataclass(frozen=True)
class SealedSummary:
    """A sealed benchmark."""

    fixed_rule: str  # the best one
    need: tuple[str, ...]  # worlds that need an action of their own
    worth: tuple[tuple[str, float], ...]  # world -> limit minus best fixed rule; empty where no limit was run
    strata: tuple[StratumSummary, ...]


def by_strata(rows: Sequence[BenchmarkRow]) -> SealedSummary | None:
    """The summary; None without `adaptsim` or a fixed rule; one stratum without a limit. Entries have all worlds."""
    worlds = list(dict.fromkeys(row.target for row in rows))
    entries = list(dict.fromkeys(row.method for row in rows))
    rules = [entry for entry in entries if Entry.parse(entry).name in FIXED_RULES]
    limits = [entry for entry in (BEST_ACTION, ORACLE) if entry in entries]
    if DEFAULT not in entries or not rules:
        return None
    earned = {entry: _by_world(rows, entry, worlds, "reward") for entry in entries}
    shown = {entry: _by_world(rows, entry, worlds, "shown") for entry in rules}
    fixed_rule = max(rules, key=lambda rule: float(shown[rule].mean()))
    everywhere = np.full(len(worlds), fill_value=True)
    if not limits:
        return SealedSummary(fixed_rule, (), (), tuple(_stratum(ALL, one, earned, everywhere) for one in entries))
    worth = np.max([earned[entry] for entry in limits], axis=0) - shown[fixed_rule]
    need = worth >= NEED
    strata = [
        _stratum(stratum, entry, earned, chosen)
        for stratum, chosen in zip(STRATA, (everywhere, need, ~need), strict=True)
        if chosen.any()
        for entry in entries
    ]
    named = tuple(world for world, is_in_need in zip(worlds, need, strict=True) if is_in_need)
    listed = tuple((world, round(float(value), 4)) for world, value in zip(worlds, worth, strict=True))
    return SealedSummary(fixed_rule, named, listed, tuple(strata))


def _by_world(rows: Sequence[BenchmarkRow], entry: str, worlds: Sequence[str], column: str) -> Array:
    """(worlds,) means over seeds."""
    values: dict[str, list[float]] = {world: [] for world in worlds}
    for row in rows:
        if row.method == entry:
            values[row.target].append(getattr(row, column))
    return np.array([np.mean(values[world]) for world in worlds])


def _stratum(stratum: str, entry: str, earned: Mapping[str, Array], chosen: NDArray[np.bool_]) -> StratumSummary:
    mine = earned[entry][chosen]
    behind = earned[DEFAULT][chosen] - mine
    return StratumSummary(
        stratum,
        entry,
        len(mine),
        float(mine.mean()),
        student_interval(mine),
        float(behind.mean()),
        student_interval(behind),
        float(behind.max()),
    )


def student_interval(values: Array) -> Interval:
    """The 95 % interval of the mean of values (n,), by Student's t; a single value has no width."""
    mean = float(np.mean(values))
    if len(values) < 2:
        return mean, mean
    half = float(stats.t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / len(values) ** 0.5)
    return mean - half, mean + half
