"""Summarises rows by method: means with intervals, paired differences, share of the gap closed, worst world.

Each set of worlds has its own summary. Worlds are the units: a method's reward in a world is its mean over seeds.
Intervals are bootstraps over worlds, or over seeds if there is only one world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hw.types import Array
from sim.research.benchmark.entries import ORACLE, UDR
from sim.research.benchmark.jobs import BenchmarkRow

LEAST_GAP = 0.1
"""A world has no gap if the difference between oracle and UDR, in the trials for choices, is smaller than this."""

WORSE_BY = 0.1
"""A method that earns this much less than UDR in a world does harm there."""

RESAMPLED = 2000

Interval = tuple[float, float]


@dataclass(frozen=True)
class MethodSummary:
    """One method in one set of worlds."""

    method: str
    reward: float
    ci95: Interval
    above_udr: float | None  # mean paired difference to UDR
    above_udr_ci95: Interval | None
    gap_closed: float | None  # share of the gap closed, over the worlds with a gap
    gap_closed_ci95: Interval | None
    worse_worlds: int | None  # number of worlds in which it earns less than UDR by `WORSE_BY`
    worst_world: str | None
    worst_difference: float | None  # its difference to UDR there
    trials: tuple[int, ...]  # real trials after each iteration
    curve: tuple[float, ...]  # mean reward after each iteration
    curve_ci95: tuple[Interval, ...]
    same_for_every_seed: bool  # several seeds gave the same rewards in every world: repetitions of one session


@dataclass(frozen=True)
class SetSummary:
    """One set of worlds."""

    set: str
    worlds: int
    seeds: int
    with_gap: tuple[str, ...] | None  # worlds with a gap between UDR and the oracle
    methods: tuple[MethodSummary, ...]  # in the order of the rows


@dataclass(frozen=True, eq=False)
class _Earned:
    """Rewards of one method: final (worlds, seeds), and after each iteration (worlds, seeds, iterations)."""

    final: Array
    curve: Array
    trials: tuple[int, ...]
    shown: Array | None


def summarise(rows: Sequence[BenchmarkRow]) -> tuple[SetSummary, ...]:
    """The summaries of rows in which every method of a set has every world and seed."""
    return tuple(
        _of_set(name, [row for row in rows if row.set == name]) for name in dict.fromkeys(row.set for row in rows)
    )


def _of_set(name: str, rows: Sequence[BenchmarkRow]) -> SetSummary:
    worlds = list(dict.fromkeys(row.target for row in rows))
    seeds = list(dict.fromkeys(row.seed for row in rows))
    methods = list(dict.fromkeys(row.method for row in rows))
    at = {(row.method, row.target, row.seed): row for row in rows}
    earned = {method: _earned(at, method, worlds, seeds) for method in methods}
    gap = _with_gap(earned)
    summaries = tuple(_of_method(method, earned, worlds, gap) for method in methods)
    named = None if gap is None else tuple(w for w, wide in zip(worlds, gap, strict=True) if wide)
    return SetSummary(name, len(worlds), len(seeds), named, summaries)


def _earned(
    at: dict[tuple[str, str, int], BenchmarkRow], method: str, worlds: Sequence[str], seeds: Sequence[int]
) -> _Earned:
    table = [[at[method, world, seed] for seed in seeds] for world in worlds]
    shown = np.array([[np.nan if row.shown is None else row.shown for row in line] for line in table])
    return _Earned(
        final=np.array([[row.reward for row in line] for line in table]),
        curve=np.array([[[reward for _, reward in row.curve] for row in line] for line in table]),
        trials=tuple(n for n, _ in table[0][0].curve),
        shown=None if np.isnan(shown).any() else shown,
    )


def _with_gap(earned: dict[str, _Earned]) -> Array | None:
    """(worlds,) whether a world has a gap. This is decided by the trials for choices, and not by the rollouts for
    scores.
    """
    udr, oracle = (earned[name].shown if name in earned else None for name in (UDR, ORACLE))
    if udr is None or oracle is None:
        return None
    return np.asarray(oracle.mean(axis=1) - udr.mean(axis=1) >= LEAST_GAP)


def _of_method(method: str, earned: dict[str, _Earned], worlds: Sequence[str], gap: Array | None) -> MethodSummary:
    mine, udr = earned[method], earned.get(UDR)
    drawn = _resampled(mine.final.shape)
    above = closed = above_ci = closed_ci = worse = worst = least = None
    if udr is not None:
        difference = mine.final - udr.final
        above, above_ci = float(difference.mean()), _interval(_means(difference, drawn))
        by_world = difference.mean(axis=1)
        worse = int((by_world <= -WORSE_BY).sum())
        worst, least = worlds[int(np.argmin(by_world))], float(by_world.min())
        if gap is not None and gap.any():
            room = (earned[ORACLE].final - udr.final)[gap]
            closed, closed_ci = _share(difference[gap], room)
    return MethodSummary(
        method=method,
        reward=float(mine.final.mean()),
        ci95=_interval(_means(mine.final, drawn)),
        above_udr=above,
        above_udr_ci95=above_ci,
        gap_closed=closed,
        gap_closed_ci95=closed_ci,
        worse_worlds=worse,
        worst_world=worst,
        worst_difference=least,
        trials=mine.trials,
        curve=tuple(float(m) for m in mine.curve.mean(axis=(0, 1))),
        curve_ci95=tuple(_interval(_means(mine.curve[..., k], drawn)) for k in range(mine.curve.shape[-1])),
        same_for_every_seed=mine.curve.shape[1] > 1 and bool((mine.curve == mine.curve[:, :1]).all()),
    )


def _share(difference: Array, room: Array) -> tuple[float | None, Interval | None]:
    """Share of the gap closed, pooled over worlds and seeds (W, S); None if fresh rollouts show no gap."""
    if room.sum() <= 0.0:
        return None, None
    drawn = _resampled(difference.shape)
    over = _means(room, drawn)
    ratios = _means(difference, drawn)[over > 0.0] / over[over > 0.0]
    return float(difference.sum() / room.sum()), _interval(ratios)


def _resampled(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """(RESAMPLED, n) draws of worlds, or of seeds if there is only one world; the same for every method."""
    n = shape[0] if shape[0] > 1 else shape[1]
    return np.random.default_rng(0).integers(n, size=(RESAMPLED, n))


def _means(values: Array, drawn: NDArray[np.int64]) -> Array:
    """(RESAMPLED,) means of (worlds, seeds)."""
    by_unit = values.mean(axis=1) if values.shape[0] > 1 else values[0]
    return np.asarray(by_unit[drawn].mean(axis=1))


def _interval(values: Array) -> Interval:
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)
