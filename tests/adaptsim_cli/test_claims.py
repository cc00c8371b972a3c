"""A drill: whatever forty sessions print and draw about their trials is checked against their records."""

from __future__ import annotations

import re

import numpy as np
import pytest

from adaptsim_cli import api
from adaptsim_cli.commands import app
from sim.adaptation.judging import SAME_ACTION
from sim.adaptation.method import FAILED
from sim.tasks import get_task

METHODS = ("adaptsim", "adaptsim", "adaptsim-belief", "random", "udr")
BEST = re.compile(
    r"Best policy so far(?:, (?:(not yet tried)|tried in trials? ([0-9, andto]+): mean reward ([\d.]+)))?; "
    r"(?:predicted|estimated) reward ([\d.]+) \(95 % (.+?), from (\d+) trials?\)"
)
STRANGE = re.compile(r"(\d+) of (\d+) trajectories lie outside")


def numbers(listed: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", listed)]


def trials_named(listed: str) -> list[int]:
    """The trials that a list such as "2, 5 and 7 to 9" names."""
    spans = re.findall(r"(\d+)(?: to (\d+))?", listed)
    return [trial for first, last in spans for trial in range(int(first), int(last or first) + 1)]


@pytest.mark.long
@pytest.mark.parametrize("number", range(40))
def test_every_claim_of_a_session_is_that_of_its_records(number: int, capfd: pytest.CaptureFixture[str]) -> None:
    iterations, method = 1 + number % 3, METHODS[number % len(METHODS)]
    world = ["wd", "ood-1", "ood-2", "ood-3", "ood-4"][number % 5] if number < 10 else "wd"
    run = ["run-iteration", "--task", "pendulum", "--world", world, "--method", method, "--seed", str(number)]
    assert app.run([*run, "--session", "s", "-n", str(iterations), "--yes"]) == 0
    said = " ".join(capfd.readouterr().out.split())
    session = api.open_session("s")
    trials, task = session.trials, get_task("pendulum")
    per = len(trials) // iterations

    claims = BEST.findall(said)
    assert len(claims) == iterations, "each iteration names its best policy once"
    for iteration, (untried, listed, mean, _, between, count) in enumerate(claims, start=1):
        known = trials[: iteration * per]
        assert 1 <= int(count) <= len(known)
        if method == "adaptsim":
            assert int(count) == len(known)
        low, _, high = between.partition(" to ")
        assert low != high, "an interval has a width, or is a dash"
        tried = trials_named(listed)
        assert bool(untried) == (not tried)
        if tried:
            rewards = [trial.reward for trial in known if trial.trial in tried]
            assert len(rewards) == len(tried)
            assert float(mean) == pytest.approx(np.mean(rewards), abs=0.0051)
    best = task.action.normalise(session.best_policy()(np.zeros(0)))
    off = [np.abs(task.action.normalise(trial.action_array) - best).max() for trial in trials]
    assert trials_named(claims[-1][1]) == [t.trial for t, far in zip(trials, off, strict=True) if far <= SAME_ACTION]
    for strange, of in STRANGE.findall(said):
        assert int(strange) <= int(of) <= len(trials)

    html = session.report().read_text(encoding="utf-8")
    successes = re.search(r"trials that succeeded</dt><dd>(\d+) <small>of (\d+)", html)
    assert successes is not None
    assert numbers(" ".join(successes.groups())) == [sum(t.reward > FAILED for t in trials), len(trials)]
    assert ("not yet tried" in html) == bool(claims[-1][0])
    newest = np.mean([trial.reward for trial in trials[-per:]])
    sentence = re.search(r"earns ([\d.]+) in \S+ \(\d+ simulated trials?\); (.*?\.) Report:", said)
    assert sentence is not None
    assert f"{newest:.2f}" in sentence[2]
    assert len(trials) in numbers(sentence[2])
