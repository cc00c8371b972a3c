"""Sentences and tables about results say what `docs/results/sessions.csv` holds: every number is computed again."""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from collections.abc import Mapping

import numpy as np
import pytest
from documents import ROOT

FOODS = ("raisin", "carrot", "cucumber", "sprout", "mushroom-slice", "oreo")
TITLES = {"sprout": "Brussels sprout", "mushroom-slice": "mushroom slice", "oreo": "Oreo"}
OTHERS = ("bo-prior", "bo", "random", "sysid-bayes", "adaptsim-iteration")
GAIN = 0.05
README, RESULTS = "README.md", "docs/results.md"


def text(page: str) -> str:
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def readme() -> str:
    return text(README)


def short(value: float) -> str:
    """As 0.93."""
    return f"{value:.2f}"


class Sessions:
    """Mean rewards by part, method and world, at the end and after so many trials."""

    def __init__(self) -> None:
        ends, early = defaultdict(list), defaultdict(list)
        with (ROOT / "docs/results/sessions.csv").open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                key = row["part"], row["method"], row["world"]
                ends[key].append(float(row["reward"]))
                for pair in row["after"].split():
                    trials, reward = pair.split(":")
                    early[(*key, int(trials))].append(float(reward))
        self._ends = {key: float(np.mean(values)) for key, values in ends.items()}
        self._early = {key: float(np.mean(values)) for key, values in early.items()}

    def worlds(self, part: str, method: str) -> Mapping[str, float]:
        return {w: value for (p, m, w), value in self._ends.items() if (p, m) == (part, method)}

    def mean(self, part: str, method: str, after: int = 0) -> float:
        early = [v for (p, m, _, n), v in self._early.items() if (p, m, n) == (part, method, after)]
        return float(np.mean(early if after else list(self.worlds(part, method).values())))

    def early(self, part: str, method: str, world: str, after: int) -> float:
        return self._early[part, method, world, after]

    def gains(self, part: str) -> Mapping[str, float]:
        udr = self.worlds(part, "udr")
        return {world: value - udr[world] for world, value in self.worlds(part, "adaptsim").items()}

    def best_other(self, part: str) -> float:
        return max(self.mean(part, method) for method in OTHERS if self.worlds(part, method))


@pytest.fixture(scope="module")
def sessions() -> Sessions:
    return Sessions()


def test_the_table_of_the_foods_is_that_of_the_sessions(sessions: Sessions) -> None:
    page = text(RESULTS)
    for food in FOODS:
        values = [
            sessions.worlds("foods", "udr")[food],
            sessions.early("foods", "adaptsim", food, 4),
            *(sessions.worlds("foods", method)[food] for method in ("adaptsim", *OTHERS)),
        ]
        assert f"| {TITLES.get(food, food)} | {' | '.join(map(short, values))} |" in page
    four, end = short(sessions.mean("foods", "adaptsim", 4)), short(sessions.mean("foods", "adaptsim"))
    others = " | ".join(short(sessions.mean("foods", method)) for method in OTHERS)
    assert f"| six foods | {short(sessions.mean('foods', 'udr'))} | **{four}** | **{end}** | {others} |" in page


def test_after_four_trials_the_pages_say_how_far_each_method_is(sessions: Sessions) -> None:
    early = {method: short(sessions.mean("foods", method, 4)) for method in ("adaptsim", "bo-prior", "random", "bo")}
    assert early["adaptsim"] == early["bo-prior"]
    assert (
        f"after four it has {early['adaptsim']}, as `bo-prior` has; random search has {early['random']} and `bo` "
        f"{early['bo']} (by tables)"
    ) in text(RESULTS)
    assert f"`adaptsim` {early['adaptsim']} after four trials, as Bayesian optimisation" in readme()


def test_the_drawn_foods_by_true_rollouts_are_those_of_their_sessions(sessions: Sessions) -> None:
    page, part = text(RESULTS), "foods-drawn-rollouts"
    methods = ("udr", "adaptsim", "random", "bo-prior")
    udr, adapted, drawn, other = (f"{sessions.mean(part, m):.3f}" for m in methods)
    gains = sessions.gains(part)
    worst = min(gains, key=lambda world: gains[world])
    gain = f"{np.mean(list(gains.values())):+.3f}".replace("+0.", "+.")
    assert f"UDR {udr}, `adaptsim` {adapted}, `random` {drawn}, `bo-prior` {other}. Minus UDR {gain}" in page
    share = f"0.05 or more in {sum(g >= GAIN for g in gains.values())} of the {len(gains)}"
    assert f"{share}, at least −{-gains[worst]:.3f} ({worst})" in page
    (row,) = [line for line in text("docs/results/methods.md").split("| `") if line.startswith("bo-prior` | 1 | 0.924")]
    lead = sessions.mean(part, "adaptsim") - sessions.mean(part, "bo-prior")
    assert f"{lead:+.3f} (+0.001 to +0.049)" in row
    assert "minus `bo-prior` +0.020 (0.001 to 0.049)" in page
    (row,) = [line for line in text("docs/results/methods.md").split("| `") if line.startswith("random` | 1 | 0.927")]
    lead = sessions.mean(part, "adaptsim") - sessions.mean(part, "random")
    assert f"{lead:+.3f} (-0.001 to +0.039)" in row
    assert "Minus `random` +0.017 (−0.001 to 0.039)" in page


def test_the_drawn_foods_are_those_of_their_sessions(sessions: Sessions) -> None:
    page, part = text(RESULTS), "foods-drawn"
    means = {m: f"{sessions.mean(part, m):.3f}" for m in ("udr", "adaptsim", "bo-prior", "random", "sysid-bayes")}
    first, best, *others = means.values()
    gains = sessions.gains(part)
    assert f"| {len(gains)} drawn foods | {first} | **{best}** | {' | '.join(others)} |" in page
    assert f"gains 0.05 or more in {sum(g >= GAIN for g in gains.values())} of the {len(gains)}" in page
    worst = min(gains, key=lambda world: gains[world])
    assert f"loses at most {-gains[worst]:.3f} ({worst})" in page
    early = {m: f"{sessions.mean(part, m, 4):.3f}" for m in ("bo-prior", "adaptsim")}
    assert f"`bo-prior` has {early['bo-prior']}, `adaptsim` {early['adaptsim']}" in page
    leads = text("docs/results/methods.md")
    for method in ("udr", "bo-prior", "random"):
        lead = sessions.mean(part, "adaptsim") - sessions.mean(part, method)
        (row,) = [
            line for line in leads.split("| `") if line.startswith(f"{method}` | 3 | {sessions.mean(part, method):.3f}")
        ]
        low, high = row.split(f"{lead:+.3f} (")[1].split(")")[0].split(" to ")
        short_low, short_high = (value.replace("-", "−").lstrip("+") for value in (low, high))
        assert f"{lead:+.3f} ({short_low} to {short_high})" in page


def test_the_whole_lab_says_what_its_sessions_earned(sessions: Sessions) -> None:
    udr, adapted = (short(sessions.mean("foods-lab", method)) for method in ("udr", "adaptsim"))
    assert f"UDR earns {udr} and `adaptsim` {adapted} after 20 trials" in text(RESULTS)


ROWS = {"foods-drawn": "scooping, 40 drawn foods", "pushing": "pushing, 40 drawn worlds"}
ROWS |= {"pendulum": "pendulum, 40 drawn worlds"}


@pytest.mark.parametrize("part", [*ROWS, "scooping"])
def test_the_rows_of_the_drawn_worlds_are_those_of_the_sessions(sessions: Sessions, part: str) -> None:
    udr, adapted, other, paper = (
        sessions.mean(part, "udr"),
        sessions.mean(part, "adaptsim"),
        sessions.best_other(part),
        sessions.mean(part, "adaptsim-iteration"),
    )
    name = next(method for method in OTHERS if sessions.worlds(part, method) and sessions.mean(part, method) == other)
    (lead,) = re.findall(rf"`{name}` \| \d \| {other:.3f}[^|]*\| (\S+ \(\S+) to", text("docs/results/methods.md"))
    tied = short(adapted) == short(other) or "(-" in lead
    shown = short(adapted) if tied else f"**{short(adapted)}**"
    share = np.mean([gain >= GAIN for gain in sessions.gains(part).values()])
    row = f"| {ROWS.get(part)} | {short(udr)} | {shown} | {short(other)} | {short(paper)} | in {share:.0%} |"
    assert part not in ROWS or row.replace("%", " %") in readme()
    for number in (udr, adapted, paper):
        assert f"{number:.3f}" in text(RESULTS)


def test_the_worst_world_and_the_share_that_gains_are_over_all_sessions(sessions: Sessions) -> None:
    page = text(RESULTS)
    for part in ("pushing", "pendulum", "scooping"):
        gains = sessions.gains(part)
        worst = min(gains, key=lambda world: gains[world])
        assert f"{worst} of {'the ' * (part == 'pendulum')}{part} (−{-gains[worst]:.3f})" in page
        share = f"{np.mean([gain >= GAIN for gain in gains.values()]):.0%}".replace("%", " %")
        assert f"{share} of {'the ' * (part == 'pendulum')}{part}'s" in page
    foods = sessions.gains("foods")
    assert f"gains 0.05 or more over UDR in {sum(g >= GAIN for g in foods.values())} of the 6 foods" in page


def test_the_best_parameters_are_said_to_be_as_far_ahead_as_they_are(sessions: Sessions) -> None:
    ahead = sessions.mean("scooping", "oracle") - sessions.mean("scooping", "adaptsim")
    assert f"the best E earns {ahead:.3f} more than `adaptsim`" in text(RESULTS)


def test_a_second_training_of_scooping_earns_as_the_table_says(sessions: Sessions) -> None:
    page = text(RESULTS)
    for row, shipped, second in (
        ("six foods, three sessions each", "foods", "foods-training-11"),
        ("40 drawn foods, one session each", "foods-drawn-rollouts", "foods-drawn-training-11"),
    ):
        cells = (
            ", ".join(f"{sessions.mean(part, method):.3f}" for method in ("udr", "adaptsim"))
            for part in (shipped, second)
        )
        assert f"| {row} | {' | '.join(cells)} |" in page
        udr, adapted = (sessions.mean(second, m) - sessions.mean(shipped, m) for m in ("udr", "adaptsim"))
        assert f"{udr:+.2f}" in page
        assert f"−{-adapted:.3f}" in page
    parts = ("foods-training-11", "foods-drawn-training-11")
    six, drawn = (short(sessions.mean(part, "udr")) for part in parts)
    (both,) = {short(sessions.mean(part, "adaptsim")) for part in parts}
    assert f"UDR earns {six} and {drawn} in both rows of foods, `adaptsim` {both}" in readme()
    gains = sessions.gains("foods-drawn-training-11")
    worst = min(gains, key=lambda world: gains[world])
    assert f"+{np.mean(list(gains.values())):.3f} (0.123 to 0.270)" in page
    assert f"0.05 or more in {sum(g >= GAIN for g in gains.values())} of the {len(gains)} instead of 26" in page
    assert f"in {worst} the session lost {-gains[worst]:.3f}" in page


def test_a_second_training_earns_what_its_sessions_earn() -> None:
    rewards = defaultdict(list)
    with (ROOT / "docs/results/sessions.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["part"].startswith("pushing") and int(row["seed"]) < 3:
                rewards[row["part"], row["method"]].append(float(row["reward"]))
    second, shipped = (
        {m: np.mean(rewards[part, m]) for m in ("udr", "adaptsim")} for part in ("pushing-training-11", "pushing")
    )
    assert len(rewards["pushing-training-11", "adaptsim"]) == len(rewards["pushing", "adaptsim"]) == 120
    udr, adapted = ((f"{second[m]:.3f}", f"{shipped[m]:.3f}") for m in ("udr", "adaptsim"))
    difference = f"{second['adaptsim'] - shipped['adaptsim']:+.3f}"
    assert (
        f"UDR {udr[0]} (shipped: {udr[1]} in these sessions), `adaptsim` {adapted[0]} ({adapted[1]}), a difference of "
        f"{difference} (−0.001 to 0.010)"
    ) in text(RESULTS)
