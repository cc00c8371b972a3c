"""A sealed benchmark's summary: strata by need, and paired intervals over worlds."""

import numpy as np
import pytest
from scipy import stats

from sim.research.benchmark.jobs import BenchmarkRow
from sim.research.benchmark.strata import ALL, IN_NEED, OTHERS, by_strata, student_interval


def row(world, entry, reward, seed=0, shown=None):
    return BenchmarkRow("toy", "sealed", world, entry, seed, reward, (0.0, 1.0), 4, 0, 1.0, ((4, reward),), shown)


def rows():
    earned = {
        "udr": ((0.5, 0.8, 0.7), (0.4, 0.8, 0.7)),
        "second-action": ((0.6, 0.8, 0.8), (0.6, 0.8, 0.8)),
        "adaptsim": ((0.9, 0.8, 0.8), None),
        "random": ((0.7, 0.9, 0.7), None),
        "best-action": ((0.95, 0.7, 0.88), None),
        "oracle": ((0.6, 0.88, 0.8), None),
    }
    return [
        row(world, entry, rewards[i], seed, None if shown is None else shown[i])
        for entry, (rewards, shown) in earned.items()
        for i, world in enumerate(("a", "b", "c"))
        for seed in range(2)
    ]


def test_a_world_needs_its_own_action_if_the_better_limit_beats_the_best_fixed_rule():
    summary = by_strata(rows())
    assert summary.fixed_rule == "second-action"
    assert summary.need == ("a",)
    assert dict(summary.worth) == pytest.approx({"a": 0.35, "b": 0.08, "c": 0.08})
    counts = {one.stratum: one.worlds for one in summary.strata}
    assert counts == {ALL: 3, IN_NEED: 1, OTHERS: 2}


def test_differences_are_paired_by_world_and_repeats_count_once():
    one = next(s for s in by_strata(rows()).strata if (s.stratum, s.entry) == (ALL, "random"))
    difference = np.array([0.2, -0.1, 0.1])
    half = stats.t.ppf(0.975, 2) * difference.std(ddof=1) / 3**0.5
    assert one.behind == pytest.approx(difference.mean())
    assert one.behind_ci95 == pytest.approx((difference.mean() - half, difference.mean() + half))
    assert one.most_behind == pytest.approx(0.2)
    single = [r for r in rows() if r.seed == 0]
    assert by_strata(single) == by_strata(rows())


def test_without_a_limit_nobody_knows_the_need_and_all_worlds_are_one_stratum():
    summary = by_strata([r for r in rows() if r.method not in {"best-action", "oracle"}])
    assert (summary.need, summary.worth) == ((), ())
    whole = [one for one in by_strata(rows()).strata if one.stratum == ALL]
    assert list(summary.strata) == [one for one in whole if one.entry not in {"best-action", "oracle"}]


@pytest.mark.parametrize("missing", [{"adaptsim"}, {"udr", "second-action"}])
def test_without_the_default_or_a_fixed_rule_there_are_no_strata(missing):
    assert by_strata([r for r in rows() if r.method not in missing]) is None


def test_the_interval_of_a_mean_holds_it_as_often_as_it_says():
    rng = np.random.default_rng(0)
    held = [low <= 0.3 <= high for low, high in (student_interval(rng.normal(0.3, 1.0, 6)) for _ in range(2000))]
    assert np.mean(held) == pytest.approx(0.95, abs=0.015)
