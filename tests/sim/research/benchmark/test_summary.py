import pytest

from sim.research.benchmark.jobs import BenchmarkRow
from sim.research.benchmark.summary import summarise


def row(target, method, seed, reward, shown=None, curve=((4, 0.1), (8, None)), set="drawn"):
    points = tuple((n, reward if r is None else r) for n, r in curve)
    return BenchmarkRow("toy", set, target, method, seed, reward, (0.0, 1.0), points[-1][0], 0, 1.0, points, shown)


def rows(rewards, shown=(0.2, 0.8)):
    """`rewards[method][world]`, the same for two seeds but for a hundredth."""
    found = []
    for method, by_world in rewards.items():
        for world, reward in by_world.items():
            said = {"udr": shown[0], "oracle": shown[1]}.get(method)
            found += [row(world, method, seed, reward + 0.01 * seed, said) for seed in range(2)]
    return found


REWARDS = {
    "udr": {"a": 0.2, "b": 0.6},
    "oracle": {"a": 0.8, "b": 0.8},
    "good": {"a": 0.5, "b": 0.7},
    "harmful": {"a": 0.2, "b": 0.4},
}


def test_methods_are_paired_with_udr_world_by_world():
    (summary,) = summarise(rows(REWARDS))
    by_name = {m.method: m for m in summary.methods}
    good, harmful = by_name["good"], by_name["harmful"]
    assert (summary.worlds, summary.seeds, summary.with_gap) == (2, 2, ("a", "b"))
    assert good.reward == pytest.approx(0.605)
    assert good.above_udr == pytest.approx(0.2)
    assert good.above_udr_ci95 == pytest.approx((0.1, 0.3))
    assert good.gap_closed == pytest.approx(0.4 / 0.8)
    assert (good.worse_worlds, harmful.worse_worlds) == (0, 1)
    assert (harmful.worst_world, harmful.worst_difference) == ("b", pytest.approx(-0.2))
    assert by_name["oracle"].gap_closed == pytest.approx(1.0)
    assert good.trials == (4, 8)
    assert good.curve == pytest.approx((0.1, 0.605))


def test_the_gap_is_decided_by_what_trials_showed_and_not_by_the_scores():
    (wide,) = summarise(rows(REWARDS, shown=(0.2, 0.8)))
    (none,) = summarise(rows(REWARDS, shown=(0.5, 0.55)))
    assert wide.with_gap == ("a", "b")
    assert none.with_gap == ()
    assert all(m.gap_closed is None for m in none.methods)


def test_without_udr_or_oracle_nothing_is_made_up():
    (summary,) = summarise(rows({"good": REWARDS["good"]}))
    (good,) = summary.methods
    assert summary.with_gap is None
    assert (good.above_udr, good.gap_closed, good.worst_world) == (None, None, None)


def test_sets_are_never_pooled_and_one_world_is_resampled_over_its_seeds():
    both = [*rows(REWARDS), *(row("wd", "udr", seed, 0.5 + 0.1 * seed, 0.5, set="named") for seed in range(3))]
    drawn, named = summarise(both)
    assert (drawn.set, named.set) == ("drawn", "named")
    low, high = named.methods[0].ci95
    assert 0.5 <= low < named.methods[0].reward < high <= 0.7
