"""The paired comparison stays valid when one looks after every pair."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from sim.adaptation.paired import ALPHA, ALPHA_SHOWN, Claim, capital, compare, ends, is_gain_shown, power

SESSIONS, PAIRS = 10_000, 60


Pairs = tuple[np.ndarray, np.ndarray]
SHAPE = (SESSIONS, PAIRS)


def _coins(rng: np.random.Generator, p: float | np.ndarray) -> np.ndarray:
    return (rng.random(SHAPE) < p) * 1.0


def _places(rng: np.random.Generator) -> Pairs:
    """Both depend on the same place."""
    place = rng.beta(2, 2, SHAPE)
    return _coins(rng, place), _coins(rng, place)


def _ties(rng: np.random.Generator) -> Pairs:
    """In most places both succeed."""
    easy = _coins(rng, 0.7) > 0
    return np.where(easy, 1.0, 0.8 * _coins(rng, 0.5)), np.where(easy, 1.0, 0.8 * _coins(rng, 0.5))


def _dependent(rng: np.random.Generator) -> Pairs:
    """The level of both falls when the session earned something."""
    mine, theirs, level = np.empty(SHAPE), np.empty(SHAPE), np.full(SESSIONS, 0.7)
    for k in range(PAIRS):
        mine[:, k], theirs[:, k] = (rng.random((2, SESSIONS)) < level) * 1.0
        level = np.where(mine[:, k] > 0, 0.3, 0.8)
    return mine, theirs


NULLS: dict[str, Callable[[np.random.Generator], Pairs]] = {
    "coin": lambda rng: (_coins(rng, 0.5), _coins(rng, 0.5)),
    "rare failure": lambda rng: (_coins(rng, 0.97), _coins(rng, 0.97)),
    "ties": _ties,
    "skewed": lambda rng: (rng.beta(0.3, 0.3, SHAPE), np.full(SHAPE, 0.5)),
    "rarely much worse": lambda rng: (_coins(rng, 0.95), np.full(SHAPE, 0.95)),
    "rarely much better": lambda rng: (np.full(SHAPE, 0.95), _coins(rng, 0.95)),
    "places": _places,
    "dependent": _dependent,
}
"""Rewards of session and control trials without a difference of their means."""


@pytest.mark.parametrize("name", NULLS)
def test_without_a_difference_at_most_one_session_in_twenty_ever_claims_one(name):
    mine, theirs = NULLS[name](np.random.default_rng(list(NULLS).index(name)))
    d = mine - theirs
    is_worse = (capital(-d, np.zeros(SESSIONS)) >= 1.0 / (ALPHA - ALPHA_SHOWN)).any(axis=1)
    for planned in (16, PAIRS):
        is_better = is_gain_shown(d, planned)[:, -1]
        assert is_better.mean() <= ALPHA_SHOWN
        assert (is_better | is_worse).mean() <= ALPHA


@pytest.mark.parametrize(("p", "q"), [(0.9, 0.4), (0.5, 0.45), (0.2, 0.8), (1.0, 0.0), (0.99, 0.9)])
def test_the_interval_holds_the_true_difference_after_every_pair(p, q):
    rng = np.random.default_rng(7)
    d = (rng.random((SESSIONS, PAIRS)) < p) * 1.0 - (rng.random((SESSIONS, PAIRS)) < q) * 1.0
    true = np.full(SESSIONS, p - q)
    below = capital(d, np.minimum(true, 1.0)) >= 2.0 / ALPHA
    above = capital(-d, np.maximum(-true, -1.0 + 1e-12)) >= 2.0 / ALPHA
    assert (below | above).any(axis=1).mean() <= ALPHA


def test_the_ends_are_where_the_capital_refutes_a_mean():
    rng = np.random.default_rng(1)
    d = rng.beta(4, 2, (20, 12)) - rng.beta(2, 2, (20, 12))
    low, high = ends(-d)
    at_last = [capital(one[None], np.array([-end]))[0].max() for one, end in zip(d, high[:, -1], strict=True)]
    assert np.min(at_last) == pytest.approx(1.0 / (ALPHA - ALPHA_SHOWN), rel=1e-6)
    assert (np.diff(low, axis=1) >= 0.0).all(), "another pair never widens it"
    assert (np.diff(high, axis=1) <= 0.0).all()


@pytest.mark.parametrize(("p", "q"), [(0.9, 0.4), (0.5, 0.45), (0.2, 0.8), (0.9, 0.9)])
def test_the_stated_ends_hold_the_true_difference(p, q):
    rng = np.random.default_rng(8)
    d = ((rng.random((400, PAIRS)) < p) * 1.0) - ((rng.random((400, PAIRS)) < q) * 1.0)
    low, high = ends(d)
    assert ((low[:, -1] > p - q + 1e-9) | (high[:, -1] < p - q - 1e-9)).mean() <= ALPHA


def test_sixty_planned_pairs_show_a_gain_of_a_fifth_in_four_of_five_sessions():
    assert power(0.2, 60) >= 0.8
    assert power(0.2, 16) < 0.2 < power(0.4, 16), "sixteen pairs show large gains alone"
    assert power(0.4, 16) > power(0.4, 16, planned=60), "a plan that ends in time bets in time"


def test_when_policies_change_the_ends_bracket_the_largest_and_the_smallest_difference():
    rng = np.random.default_rng(3)
    mean = np.linspace(-0.3, 0.6, PAIRS)
    d = np.where(rng.random((SESSIONS, PAIRS)) < (1.0 + mean) / 2.0, 1.0, -1.0)
    low_missed = (capital(d, np.full(SESSIONS, 0.6)) >= 2.0 / ALPHA).any(axis=1)
    high_missed = (capital(-d, np.full(SESSIONS, 0.3)) >= 2.0 / ALPHA).any(axis=1)
    assert (low_missed | high_missed).mean() <= ALPHA


def test_a_clear_difference_is_shown_and_says_after_how_many_pairs():
    said = compare(np.full(16, 0.9), np.tile([0.0, 0.8], 8))
    assert said.claim is Claim.SHOWN
    assert said.decided_after is not None and said.decided_after < 16
    assert 0.0 < said.low < said.difference < said.high
    assert said.further is None
    mirrored = compare(np.tile([0.0, 0.8], 16), np.full(32, 0.9))
    assert mirrored.claim is Claim.WORSE
    assert mirrored.low < mirrored.difference < mirrored.high < 0.0


def test_equal_rewards_end_as_no_gain_worth_a_session():
    said = compare(np.full(200, 0.9), np.full(200, 0.9))
    assert (said.claim, said.difference) == (Claim.NO_GAIN, 0.0)
    assert said.decided_after is not None and said.decided_after > 40, "this many pairs it takes, and not fewer"


@pytest.mark.parametrize(("p", "q", "low", "high"), [(0.9, 0.4, 13, 17), (0.8, 0.6, 45, 60)])
def test_it_takes_as_many_pairs_as_the_operators_guide_says(p, q, low, high):
    rng = np.random.default_rng(2)
    d = (rng.random((1000, 200)) < p) * 1.0 - (rng.random((1000, 200)) < q) * 1.0
    is_shown = is_gain_shown(d, 60)
    first = np.where(is_shown.any(axis=1), is_shown.argmax(axis=1) + 1, 201)
    assert low <= np.median(first) <= high


def test_the_pairs_still_missing_come_true():
    """Of sessions that said "about N more pairs", half are shown by then."""
    rng = np.random.default_rng(5)
    known, ahead, early = 6, 100, list[bool]()
    for _ in range(50):
        d = (rng.random(known + ahead) < 0.9) * 1.0 - (rng.random(known + ahead) < 0.4) * 1.0
        said = compare(*_pairs(d[:known]))
        if said.claim is Claim.OPEN and said.further is not None:
            is_shown = is_gain_shown(d[None])[0, known:]
            early.append(bool(is_shown[: said.further].any()))
    assert len(early) > 25
    assert 0.3 <= np.mean(early) <= 0.7


def _pairs(d: np.ndarray) -> Pairs:
    return np.maximum(d, 0.0), np.maximum(-d, 0.0)


@pytest.mark.parametrize(
    ("mine", "theirs"), [([], []), ([0.5], [0.5, 0.5]), ([1.2], [0.5]), ([0.5], [-0.1]), ([np.nan], [0.5])]
)
def test_what_are_no_pairs_of_rewards_is_refused(mine, theirs):
    with pytest.raises(ValueError, match=r"pairs|between 0 and 1"):
        compare(np.array(mine), np.array(theirs))
